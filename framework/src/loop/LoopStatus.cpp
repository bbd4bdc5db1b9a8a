#include "loop/LoopStatus.h"

namespace viable {

void LoopStatus::reset() {
    tick_ = 0;
    reason_ = StopReason::None;
    stopTime_ = 0.0;
    message_[0] = '\0';
    remedy_ = "";
    hasEnded_ = false;
}

void LoopStatus::beginStop(StopReason reason, const char* message, const char* remedy) noexcept {
    if (isStopping() && !(reason_ == StopReason::Requested && reason != StopReason::Requested)) return;
    reason_ = reason;
    stopTime_ = time();
    std::snprintf(message_, sizeof message_, "%s", message);
    remedy_ = remedy;
}

void LoopStatus::end(StopReason reason, const char* message, const char* remedy) noexcept {
    beginStop(reason, message, remedy);
    hasEnded_ = true;
}

StopReason getStopReason(PluginKind kind) {
    static constexpr std::array kReasons = {StopReason::CommandFailed, StopReason::ControllerFailed,
                                            StopReason::FilterFailed, StopReason::RobustLoopFailed,
                                            StopReason::PlantFailed};
    static_assert(kReasons.size() == kPluginKinds.size(), "a reason for each kind, in their order");
    return kReasons[static_cast<std::size_t>(kind)];
}

}  // namespace viable
