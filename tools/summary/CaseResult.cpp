#include "summary/CaseResult.h"

#include <algorithm>

#include "viable/core/Error.h"

namespace viable {

bool CaseResult::isRealGuaranteeBroken() const {
    return holdsOnReal && guarantees && summary.anyRealLimitBroken();
}

bool CaseResult::isClearanceGuaranteeBroken() const {
    return guaranteesClearance && summary.collisions() && summary.collisions()->nominal.ticksInCollision > 0;
}

bool CaseResult::isSpeedGuaranteeBroken() const {
    return guaranteesSpeed && summary.speeds() && summary.speeds()->nominal.ticksTooFast > 0;
}

bool CaseResult::isSeparationGuaranteeBroken() const {
    return guaranteesSeparation && summary.separations() && summary.separations()->nominal.guiltyTicks > 0;
}

bool isGraver(int a, int b) {
    const auto rank = [](int code) {
        constexpr ErrorKind order[] = {ErrorKind::GuaranteeBroken, ErrorKind::TrackingLost, ErrorKind::PluginFailed,
                                       ErrorKind::LogNotWritten, ErrorKind::BadInput};
        return std::find(std::begin(order), std::end(order), static_cast<ErrorKind>(code)) - order;
    };
    return rank(a) < rank(b);
}

int CaseResult::exitCode() const {
    if (stopReason == StopReason::GuaranteeBroken || isRealGuaranteeBroken() || isClearanceGuaranteeBroken() ||
        isSpeedGuaranteeBroken() || isSeparationGuaranteeBroken())
        return static_cast<int>(ErrorKind::GuaranteeBroken);
    if (summary.trip() || stopReason == StopReason::NotFollowing) return static_cast<int>(ErrorKind::TrackingLost);
    const bool isWanted =
        stopReason == StopReason::None || stopReason == StopReason::Requested || stopReason == StopReason::FilterEnded;
    if (!isWanted) return static_cast<int>(ErrorKind::PluginFailed);
    if (!logError.empty()) return static_cast<int>(ErrorKind::LogNotWritten);
    return 0;
}

}  // namespace viable
