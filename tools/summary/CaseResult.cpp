#include "summary/CaseResult.h"

namespace viable {

LimitSet CaseResult::brokenGuarantees() const {
    LimitSet broken;
    for (const LimitAccount& account : summary.accounts()) broken.set(account.kind, account.nominal.violatedTicks > 0);
    return broken & guarantees;
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
    if (stopReason == StopReason::GuaranteeBroken || isRealGuaranteeBroken() || !brokenGuarantees().isEmpty())
        return static_cast<int>(ErrorKind::GuaranteeBroken);
    if (summary.trip() || stopReason == StopReason::NotFollowing) return static_cast<int>(ErrorKind::TrackingLost);
    const bool isWanted =
        stopReason == StopReason::None || stopReason == StopReason::Requested || stopReason == StopReason::FilterEnded;
    if (!isWanted) return static_cast<int>(ErrorKind::PluginFailed);
    if (!logError.empty()) return static_cast<int>(ErrorKind::LogNotWritten);
    return 0;
}

}  // namespace viable
