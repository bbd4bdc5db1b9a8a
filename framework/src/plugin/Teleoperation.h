#pragma once

#include <functional>
#include <memory>

#include "viable/plugin/CommandSource.h"

namespace viable {

/** How an operator's hand is just now. Whole messages only: the newest one replaces those before it. */
struct HandMessage {
    enum class Part : unsigned char { Both, Position, Rotation };  ///< what of the hand's motion counts

    /** Which press of the switch: a greater number, at least 1, each time that it is pressed; 0: it is released. */
    std::uint64_t engagement = 0;
    double sent_s = 0.0;     ///< by the sender's clock, rising within an engagement
    bool isTracked = false;  ///< the device sees the hand, and the operator sees the page
    Part part = Part::Both;
    double scale = 1.0;       ///< metres of the tool per metre of the hand, kLeastScale to kLargestScale
    Pose hand;                ///< tool space: pose in the device's axes
    JointVector joints = {};  ///< joint space: displacement of each joint since the engagement [rad]

    static constexpr double kLeastScale = 0.1, kLargestScale = 5.0;
};

enum class HandState : unsigned char {
    Released,  ///< the command rests
    Engaged,   ///< the command follows the hand
    Held,      ///< no fresh message: the command rests until the next one
    Refused,   ///< the command rests until the switch has been pressed anew
};
/** "released", "engaged", "held", "refused". */
const char* getName(HandState state);

/** Why an engagement was ended. */
enum class HandRefusal : unsigned char {
    None,
    NotFinite,   ///< a number was not finite, of the wrong size or beyond its range
    NotTracked,  ///< the device had lost the hand, or the page was not seen
    Jump,        ///< the hand was somewhere else, faster than a hand moves
    Silent,      ///< no fresh message for TeleoperationFeed::kSilent_s
    Paused,      ///< the command was not asked for so long: the loop was paused or missed ticks
};
/** "none", "not_finite", ... */
const char* getName(HandRefusal refusal);

/** Between an operator's page and a command source: the newest message of the hand one way, its state the other way. Neither
side waits for the other.
Threads: put() by one, status() by one, take() and tell() by one. Real time: take() and tell(). */
class TeleoperationFeed {
public:
    static constexpr double kHold_s = 0.1;    ///< after so long without a message the command rests,
    static constexpr double kSilent_s = 0.5;  ///< after so long the engagement is over

    /** @param clock  of receipt [s], rising; empty: the computer's steady clock */
    explicit TeleoperationFeed(std::function<double()> clock = {});
    ~TeleoperationFeed();

    double now() const { return clock_(); }

    struct Arrival {
        std::uint64_t number = 0;  ///< of the message, from 1; 0: none has come
        double received_s = 0.0;
        HandMessage message;
    };
    void put(const HandMessage& message);
    /** The newest; valid until the next call. */
    const Arrival& take();

    struct Status {
        HandState state = HandState::Released;
        HandRefusal refusal = HandRefusal::None;  ///< why the last engagement was ended by other than its switch
        std::uint64_t engagement = 0;             ///< the last one
        double age_s = 0.0;                       ///< of the newest message when it was used
        MotionCommand command;
    };
    void tell(const Status& status);
    const Status& status();

private:
    struct Impl;
    const std::function<double()> clock_;
    const std::unique_ptr<Impl> impl_;
};

/** A command source that an operator's hand moves. A live session that finds one connects its feed to the page, and tells it
in every tick how the nominal arm is. */
class TeleoperatedCommand : public CommandSource {
public:
    ~TeleoperatedCommand() override;

    /** The command space is that of traits(). Outlives the plugin. */
    virtual std::shared_ptr<TeleoperationFeed> feed() const = 0;

    /** After each tick. Real time.
    @param q     of the nominal arm [rad]
    @param rest  where the stop held ready would leave it [rad]; a joint without one: not a number */
    virtual void observe(const JointVector& q, const JointVector& rest) noexcept = 0;
};

}  // namespace viable
