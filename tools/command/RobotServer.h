#pragma once

#include "experiment/ConfiguredCase.h"
#include "viable/link/viable_link_linux.h"

namespace viable {

/** What a robot that is served by `viable robot` does, and what goes wrong with it. */
struct RobotServerOptions {
    std::string address = "127.0.0.1:47100";  ///< as vl_line_open() takes it
    vl_key key{};
    double duration_s = 0.0;  ///< of the robot's time; 0: until it is stopped
    bool stays = false;       ///< where a host has left it; else each one finds it at the start
    int mostRepeats = 100;
    bool addsGravity = false;
    double clock = 1.0;           ///< its ticks per tick of the computer's clock
    double torqueRate = 0.0;      ///< fastest change of torques [Nm/s]; 0: the motors', else to their limit in 25 ms
    std::int64_t brakeAfter = 0;  ///< ticks without commands after which it closes its brakes; 0: never
    double brakeAt_s = 0.0, faultAt_s = 0.0;  ///< after a host has come: closes its brakes, reports a fault; 0: never

    // Of packets in both directions: shares, and ticks.
    double lose = 0.0, duplicate = 0.0, reorder = 0.0, corrupt = 0.0;
    double from_s = 0.0;     ///< after a host has come: only then packets are lost, doubled, reordered, corrupt
    int burst = 1;           ///< packets in a row that are lost, where one is
    int delay = 0;           ///< each comes 0 to so many ticks later
    double latency_s = 0.0;  ///< each comes so much later, by the robot's clock
    std::uint64_t seed = 1;
};

/** Packets on their way, some of which meet a fault. Times are the robot's [ns]. */
class BadLine {
public:
    struct Packet {
        std::vector<std::uint8_t> bytes;
        std::uint64_t peer = 0;
        sockaddr_storage from{};
        socklen_t fromSize = 0;
        std::int64_t due = 0;
    };

    BadLine(const RobotServerOptions& options, std::int64_t tick_ns, std::uint64_t seed)
        : options_(options), tick_ns_(tick_ns), random_(seed) {}
    /** @param isGood  nothing but the delay meets it */
    void put(const Packet& packet, std::int64_t now, bool isGood);
    /** The next one that has arrived by then. */
    std::optional<Packet> take(std::int64_t now);
    /** When the next one arrives; far in the future: none is under way. */
    std::int64_t nextDue() const;

private:
    bool happens(double share) { return share > 0.0 && std::uniform_real_distribution<double>()(random_) < share; }

    const RobotServerOptions& options_;
    const std::int64_t tick_ns_;
    std::mt19937_64 random_;
    std::vector<Packet> underWay_;
    int toLose_ = 0;  // of a burst
};

/** Serves the simulated real arm of a case over the link, by a clock of its own: what a robot's driver does, for tests.

Method: in each tick it takes the commands that came, sends its state, and moves by the torque of the last one (which so acts
in the tick after the state that it answers); then it sleeps to the tick's end. A computer that stands still lets its time
stand still: late ticks are not made up for. Without torques it comes to rest within the limits of acceleration and holds its
position. No torque steps farther than --torque-rate allows. For each new host it stands at the start of the case. */
class RobotServer {
public:
    /** Throws Error (BadInput) for a case without a simulated arm and for an address that cannot be used. */
    RobotServer(std::unique_ptr<ConfiguredCase> configured, const RobotServerOptions& options);
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
    void receive(std::int64_t timeout_ns, std::int64_t begin);
    void awaitTick(std::int64_t next, const std::atomic<int>& stop);
    void sendDue(std::int64_t now);
    void tell(const std::string& what) const;
    void placeAtStart();
    void sendState();
    JointVector calcHold();
    JointVector calcGravityShare();
    void move(vl_mode mode, const double* torque);
    void write(JointVector torque, bool isOwn);
    void fail(bool& flag, const char* what);
    double sinceHost_s() const {
        return robot_.has_host ? static_cast<double>(robot_.tick - hostTick_) * tick_s_ : 0.0;
    }
    bool isLineGood() const { return sinceHost_s() < options_.from_s; }

    std::unique_ptr<ConfiguredCase> configured_;
    const RobotServerOptions options_;
    RealPlant& plant_;
    const int n_;
    const double tick_s_;
    RobotModel model_;
    Dynamics dynamics_;
    struct End {
        vl_line line{};
        End() { line.fd = -1; }
        ~End() { vl_line_close(&line); }
    } end_;
    vl_line& line_ = end_.line;
    vl_robot robot_{};
    const std::int64_t period_ns_;
    std::int64_t begin_ns_ = 0, now_ns_ = 0;  // of this tick: by the computer's clock, by the robot's
    BadLine toHost_, fromHost_;

    JointVector applied_, holdPosition_, holdIntegral_;
    JointVector settledIntegral_;  // holdIntegral_ at the start
    bool isHolding_ = false;       // at holdPosition_; otherwise still coming to rest
    bool isBraked_ = false, hasFault_ = false, reportsFault_ = false;
    std::int64_t ticksLapsed_ = 0, lateTicks_ = 0, hosts_ = 0;
    std::uint64_t hostTick_ = 0, holdTick_ = 0;
    JointVector holdBegin_, written_;  // where it began to hold itself; the torque of the last tick
    double largestStep_ = 0.0;         // of the torque in a tick [Nm]
    int largestStepJoint_ = 0;
};

}  // namespace viable
