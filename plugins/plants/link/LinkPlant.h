#pragma once

#include <array>

#include "viable/link/viable_link_linux.h"
#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotModel.h"
#include "viable/robot/TorqueSender.h"

namespace viable {

struct LinkPlantOptions {
    std::string address;
    std::filesystem::path keyFile;
    bool addsGravity = false, addsFriction = false, measuresExternal = false;
    int repeats = 5, delayTicks = 1;
    PerJoint motorRate = kInfinity, startTolerance = 0.02;
    double blend_s = 0.5, connectTimeout_s = 5.0, silenceTimeout_s = 0.2, restVelocity = 0.02, torqueShare = 0.5;

    template <class V>
    void describe(V& v) {
        v(address, "address",
          "Of the robot: numeric, as 127.0.0.1:47100 or \"[::1]:47100\" (UDP), or shm:NAME (shared memory of the same "
          "computer).")
            .required();
        v(keyFile, "key_file",
          "32 hexadecimal digits that the robot knows, too; packets of others are then dropped. None, or an empty "
          "name: whoever reaches the robot can command it.");
        v(addsGravity, "adds_gravity",
          "The robot adds the torque that holds the arm against gravity: it is sent the rest, and measures so.");
        v(addsFriction, "adds_friction",
          "The robot makes up for its own friction; give it none in its actuation.yaml, then.");
        v(measuresExternal, "external_torque",
          "The torque of the surroundings, as the robot measures it, is passed on.");
        v(repeats, "repeat_ticks", "Ticks for which the robot may repeat a torque when the next one is missing.")
            .atLeast(0)
            .upTo(1000);
        v(delayTicks, "delay_ticks", "Ticks from a state to the first one in which the torque that answers it acts.")
            .atLeast(0)
            .upTo(20);
        v(motorRate, "motor_rate_Nmps", "Nm/s", "Fastest change of torque that the robot accepts.")
            .above(0)
            .orInfinite();
        v(blend_s, "blend_s", "s",
          "The first torque is what the robot has held its arm with; by what that differs from the model's fades in "
          "this time.")
            .above(0)
            .upTo(30);
        v(connectTimeout_s, "connect_timeout_s", "s", "How long the robot is called before a run is refused.")
            .above(0)
            .upTo(30);
        v(silenceTimeout_s, "silence_timeout_s", "s",
          "A robot that sends nothing for so long is gone, and the run ends.")
            .above(0)
            .upTo(30);
        v(startTolerance, "start_tolerance_rad", "rad", "How far from the start of the file the robot may stand.")
            .above(0)
            .orInfinite();
        v(restVelocity, "rest_velocity_radps", "rad/s", "Joints that are slower in the mean rest.").above(0);
        v(torqueShare, "rest_torque_share", "",
          "Largest difference of the resting arm's measured torque from the model's: this share of the largest gravity "
          "torque, and 1.5 times the Coulomb friction. Infinite: it is not checked.")
            .above(0)
            .orInfinite();
    }
};

/** Compares a robot's clock with the tick that it claims, over windows of states. Wrong is a window in which most ticks and the
mean are: a robot that is late now and then, or makes up for it, is not meant. */
class ClockWatch {
public:
    explicit ClockWatch(double tick_s) : tick_s_(tick_s) {}
    /** A newer state came. */
    void add(std::uint64_t sequence, std::int64_t time_ns);
    bool isGood() const { return hasWindow_ && wrongWindows_ == 0; }
    bool isWrong() const;
    double measured_s() const { return measured_s_; }  ///< of the last whole window

private:
    double tick_s_;
    std::uint64_t sequence_ = 0;  // of the last state; 0: none
    std::int64_t time_ns_ = 0;
    int states_ = 0, off_ = 0, wrongWindows_ = 0;  // of this window; in a row
    double ticks_ = 0.0, seconds_ = 0.0, measured_s_ = 0.0;
    bool hasWindow_ = false;
};

/** A robot in another process or another computer, over the link of viable_link.h; its packets make the ticks.

Method: reset() calls the robot, and watches its states until the arm has rested for kRestStates of them; there it compares
what the robot says of itself with what the file says: joints, tick, flags, start, and the torque that carries the arm.
read() waits for the next state and takes the newest one that is there; advance() answers it. TorqueSender makes what is sent.
The destructor says stop. Assumes: the robot has a stop and a hold of its own, and takes them where commands are missing.
Guarantees: nothing that is not finite is sent; a state that is not whole, not of this session, not newer or not plausible
is dropped and counted; a robot that is silent, brakes, holds itself, reports a fault or has another tick by its own clock ends the run.
Real time: read(), advance() and measured() allocate, lock and throw nothing. read() waits up to silence_timeout_s. */
class LinkPlant : public RealPlant {
public:
    ~LinkPlant() override { disconnect(); }

    /** Throws Error (BadInput) for an address, a key or a start that cannot be used. */
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    /** Connects, which takes up to connect_timeout_s and begins with the end of an earlier connection. Throws Error (BadInput)
    where there is no robot, or it is not what the file says. */
    void reset(const MotionState& start) override;
    const JointState& measured() const override { return state_; }
    const JointState& actual() const override { return state_; }
    const JointVector* externalTorque() const override { return options_.measuresExternal ? &external_ : nullptr; }
    PlantTraits traits() const override { return {Encoder::Counts, options_.delayTicks, motorRate_, true}; }
    TickStatus read(std::int64_t& ticksPassed) override;
    TickStatus advance(const JointVector& torque, JointVector& applied) override;

private:
    using Delays = std::array<std::uint64_t, 64>;  ///< [ticks]

    void disconnect() noexcept;
    void open(std::int64_t end_ns);
    void awaitRest(std::int64_t end_ns);
    /** What the file and the robot disagree about; throws Error. */
    void checkRobot(const MotionState& start);
    void checkRestTorque();
    /** Of commands: ticks from a state to the one that shows its answer. */
    void checkDelay(Delays& ticks, std::size_t count) const;
    [[noreturn]] void refuse(const std::string& what, const std::string& remedy) const;
    [[noreturn]] void refuseSilence() const;
    void refuseIfStopped() const;
    /** Waits for a state and takes the newest that is there. False: none came. */
    bool receive(std::int64_t timeout_ns);
    void send(vl_mode mode, const double* torque = nullptr);
    void readState();
    /** Why the robot does not follow torques; null: it does. */
    const char* findTrouble() const;
    /** Whether it follows the torques; null: as far as can be told. */
    const char* checkFollowing() noexcept;
    /** Ticks from the state that the last torque heard answers to this one; -1: not known. */
    std::int64_t calcAge() const noexcept;
    /** Whether torques act as late in the mean that the gains do not hold any more; null: no. */
    const char* checkAge() noexcept;
    TickStatus fail(const char* why) noexcept;
    const char* writePackets() noexcept;

    const RobotDescription* robot_ = nullptr;
    int n_ = 0;
    double tick_s_ = 0.0;
    LinkPlantOptions options_;
    std::string place_;
    vl_key key_{};
    JointVector motorRate_;
    std::unique_ptr<TorqueSender> sender_;
    std::unique_ptr<RobotModel> model_;
    Dynamics dynamics_;

    vl_line line_{};
    vl_host host_{};
    bool isOpen_ = false, isGone_ = false;
    vl_state received_{};
    std::array<std::uint64_t, 64> answered_{};  // states, by the number of the command
    ClockWatch clock_{0.0};
    std::uint64_t readSequence_ = 0;              // of the last read(); 0: none since reset()
    std::uint64_t mostUnderWay_ = 0;              // commands that the robot had not heard yet, while it rested
    int ages_ = 0;                                // states of this window
    std::int64_t ageTicks_ = 0;                   // their sum
    std::uint64_t holdingTicks_ = 0;              // since the first torque was sent
    bool hasSent_ = false, hasFollowed_ = false;  // torques
    JointVector restVelocities_, restTorques_;    // means while it rested
    JointState state_;
    JointVector external_;
    char text_[512] = "", packets_[256] = "", why_[256] = "";
};

}  // namespace viable
