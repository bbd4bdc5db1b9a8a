#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "experiment/ConfiguredCase.h"
#include "viable/link/viable_link.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** What a robot that is served by `viable robot` does, and what goes wrong with it. */
struct RobotServerOptions {
    std::string address = "127.0.0.1:47100";  ///< as vl_line_open() takes it
    vl_key key{};
    double duration_s = 0.0;  ///< of the robot's time; 0: until it is stopped
    int mostRepeats = 100;
    bool addsGravity = false;
    double clock = 1.0;           ///< its ticks per tick of the computer's clock
    std::int64_t brakeAfter = 0;  ///< ticks without commands after which it closes its brakes; 0: never

    // Of packets in both directions: shares, and ticks.
    double lose = 0.0, duplicate = 0.0, reorder = 0.0, corrupt = 0.0;
    int delay = 0;  ///< each comes 0 to so many ticks later
    std::uint64_t seed = 1;
};

/** Packets on their way, some of which meet a fault. */
class BadLine {
public:
    struct Packet {
        std::vector<std::uint8_t> bytes;
        std::uint64_t peer = 0;
        sockaddr_storage from{};
        socklen_t fromSize = 0;
        std::uint64_t due = 0;  // tick
    };

    BadLine(const RobotServerOptions& options, std::uint64_t seed) : options_(options), random_(seed) {}
    void put(const Packet& packet, std::uint64_t tick);
    /** The next one that has arrived by then. */
    std::optional<Packet> take(std::uint64_t tick);

private:
    bool happens(double share) { return share > 0.0 && std::uniform_real_distribution<double>()(random_) < share; }

    const RobotServerOptions& options_;
    std::mt19937_64 random_;
    std::vector<Packet> underWay_;
};

/** Serves the simulated real arm of a case over the link, by a clock of its own: what a robot's driver does, for tests.

Method: in each tick it takes the commands that came, sends its state, and moves by the torque of the last one (which so acts
in the tick after the state that it answers); then it sleeps to the tick's end. A computer that stands still lets its time
stand still: late ticks are not made up for. Without torques it comes to rest within the limits of acceleration and holds its
position. For each new host it stands at the start of the case. */
class RobotServer {
public:
    /** Throws Error (BadInput) for a case without a simulated arm and for an address that cannot be used. */
    RobotServer(std::unique_ptr<ConfiguredCase> configured, const RobotServerOptions& options);
    ~RobotServer();
    RobotServer(const RobotServer&) = delete;
    RobotServer& operator=(const RobotServer&) = delete;

    /** Where it listens, as a host calls it. */
    std::string address() const;

    /** Until the duration is over or `stop` becomes other than 0. Tells what happens on stdout. */
    void run(const std::atomic<int>& stop);

    /** What came of it, as lines of text. */
    std::string describe() const;

private:
    void poll();
    void tell(const char* what) const;
    void placeAtStart();
    void sendState();
    JointVector calcHold();
    void move(vl_mode mode, const double* torque);

    std::unique_ptr<ConfiguredCase> configured_;
    const RobotServerOptions options_;
    RealPlant& plant_;
    const int n_;
    const double tick_s_;
    RobotModel model_;
    Dynamics dynamics_;
    vl_line line_{};
    vl_robot robot_{};
    BadLine toHost_, fromHost_;

    JointVector applied_, holdPosition_, holdIntegral_;
    bool isHolding_ = false;  // at holdPosition_; otherwise still coming to rest
    bool isBraked_ = false, hasFault_ = false;
    std::int64_t ticksLapsed_ = 0, lateTicks_ = 0, hosts_ = 0;
};

}  // namespace viable
