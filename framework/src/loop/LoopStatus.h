#pragma once

#include "loop/LoopPlugins.h"
#include "plugin/FaultExplanation.h"

namespace viable {

/** Why the arm was braked to a stop before the end of the run. */
enum class StopReason : unsigned char {
    None,
    Requested,         ///< by the user (a signal)
    CommandFailed,     ///< no usable command for more than kMaxSubstitutedTicks, or it threw
    ControllerFailed,  ///< no usable torque for more than kMaxSubstitutedTicks, or it threw
    FilterFailed,      ///< no usable decision, or it threw
    FilterEnded,       ///< it ended the run itself after a tick without an admissible choice
    RobustLoopFailed,  ///< it threw or gave no usable torque
    GuaranteeBroken,   ///< a decision without a stop within the limits, from a filter that guarantees them
    TicksMissed,       ///< more than kMaxMissedTicks in a row were missed
    TrackingLost,      ///< the real arm, as measured, left the bound around the nominal one
    NotFollowing,      ///< a joint does not answer its motor; without a bound also: it ran away or oscillated
    PlantFailed,       ///< the real plant failed: the loop ends at once, there is nothing to brake
    /** A measured position jumped farther than a joint can move, or there was no usable external torque for
    more than kMaxSubstitutedTicks. */
    SensorFailed,
};

/** How many ticks in a row a missing or unusable command or torque is replaced by the last good
 * one. */
inline constexpr int kMaxSubstitutedTicks = 10;

/** What the author of a plugin can do that says itself that it cannot go on. */
inline constexpr char kOnGivingUp[] = "The plugin reports this itself: see its README, or its checks if it is yours.";

/** The tick that a loop is in, and why it brakes. Calls plugins so that their failures become such a reason.
Real time: no allocation, lock or throw after reset(). */
class LoopStatus {
public:
    static constexpr std::size_t kMessageSize = 512;

    LoopStatus(double tick_s, const PluginWatches& watches) : tick_s_(tick_s), watches_(watches) {}

    void reset();

    std::int64_t tick() const { return tick_; }
    double time() const { return static_cast<double>(tick_) * tick_s_; }  ///< of the tick [s]
    void nextTick() { ++tick_; }

    /** The first reason stays, unless it was Requested and a failure follows. @param remedy  a literal */
    void beginStop(StopReason reason, const char* message, const char* remedy = "") noexcept;
    /** There is nothing to brake any more, or nothing to brake with. */
    void end() noexcept { hasEnded_ = true; }
    void end(StopReason reason, const char* message, const char* remedy = "") noexcept;

    bool isStopping() const { return reason_ != StopReason::None; }
    bool hasEnded() const { return hasEnded_; }
    StopReason reason() const { return reason_; }
    const char* message() const { return message_; }
    const char* remedy() const { return remedy_; }
    double stopTime() const { return stopTime_; }

    /** Runs `call`, the work of a plugin of that kind, and returns its status; that of a call without one is Ok. An exception
    becomes Faulted, and its text the message of a stop. */
    template <class Call>
    auto contain(PluginKind kind, const Call& call) noexcept;
    PluginWatch* findWatch(PluginKind kind) const { return watches_[static_cast<std::size_t>(kind)]; }

private:
    const double tick_s_;
    const PluginWatches watches_;
    std::int64_t tick_ = 0;
    StopReason reason_ = StopReason::None;
    double stopTime_ = 0.0;
    char message_[kMessageSize] = "";
    const char* remedy_ = "";
    bool hasEnded_ = false;
};

/** Why the arm is braked when a plugin of the kind fails. */
StopReason getStopReason(PluginKind kind);

template <class Call>
auto LoopStatus::contain(PluginKind kind, const Call& call) noexcept {
    constexpr bool hasStatus = !std::is_void_v<decltype(call())>;
    using Status = std::conditional_t<hasStatus, decltype(call()), TickStatus>;
    PluginCall mark(findWatch(kind), tick_);
    char message[kMessageSize];
    message[0] = '\0';
    const char* remedy = kOnThrow;
    Status status = Status::Faulted;
    detail::readFaultExplanation();  // none is left of an earlier call
    try {
        if constexpr (hasStatus)
            status = call();
        else
            call(), status = Status::Ok;
        const char* const explanation = detail::readFaultExplanation();
        if (kind == PluginKind::RealPlant && status == Status::Faulted && *explanation) {
            std::snprintf(message, sizeof message, "%s", explanation);
            remedy = kOnGivingUp;
        }
    } catch (const PluginFault& e) {
        std::snprintf(message, sizeof message, "%s", e.what());
        remedy = e.remedy();
    } catch (const std::exception& e) {
        std::snprintf(message, sizeof message, "it threw: %s", e.what());
    } catch (...) {
        std::snprintf(message, sizeof message, "it threw something other than a std::exception");
    }
    if (const char* change = mark.undoArithmeticChange(); change && !*message) {
        std::snprintf(message, sizeof message, kArithmeticChange, change);
        remedy = kOnArithmeticChange;
        status = Status::Faulted;
    }
    if (*message) {
        mark.forgetAllocations();
        beginStop(getStopReason(kind), message, remedy);
    }
    return status;
}

}  // namespace viable
