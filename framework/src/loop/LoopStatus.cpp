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
    switch (kind) {
        case PluginKind::CommandSource:
            return StopReason::CommandFailed;
        case PluginKind::NominalController:
            return StopReason::ControllerFailed;
        case PluginKind::SafetyFilter:
            return StopReason::FilterFailed;
        case PluginKind::RobustLoop:
            return StopReason::RobustLoopFailed;
        case PluginKind::RealPlant:
            return StopReason::PlantFailed;
    }
    return StopReason::None;
}

}  // namespace viable
