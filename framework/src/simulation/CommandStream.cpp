#include "simulation/CommandStream.h"

#include <cmath>

#include "robot/PoseSampling.h"

namespace viable {

/** Times of ticks are rounded. */
constexpr double kTimeTolerance_s = 1e-9;

CommandStream::CommandStream(const StreamOptions& options) : options_(options), receiver_(options.between) {}

void CommandStream::reset(const MotionCommand& first) {
    engine_.seed(options_.seed);
    gapEngine_.seed(options_.seed + 1);
    receiver_.reset(first);
    onItsWay_ = first;
    next_ = 0;
    hasOneOnItsWay_ = false;
    gaps_ = 0;
    gapBegin_s_ = kInfinity;
}

bool CommandStream::isGap(double t) {
    if (options_.gap_s <= 0.0) return false;
    for (; static_cast<double>(gaps_) * options_.gapEvery_s <= t; ++gaps_)
        gapBegin_s_ = static_cast<double>(gaps_) * options_.gapEvery_s +
                      detail::drawShare(gapEngine_) * (options_.gapEvery_s - options_.gap_s);
    return t >= gapBegin_s_ && t < gapBegin_s_ + options_.gap_s;
}

void CommandStream::pass(double t, const MotionCommand& sent, MotionCommand& received) {
    const auto arrive = [&] {
        if (!hasOneOnItsWay_ || t + kTimeTolerance_s < arrival_s_) return;
        receiver_.take(t, onItsWay_);
        hasOneOnItsWay_ = false;
    };
    arrive();
    const double index = std::floor((t + kTimeTolerance_s) * options_.rate_hz);
    if (index >= static_cast<double>(next_)) {
        // Delays are below a period, but samples are sent at ticks: the one on its way comes before the next.
        if (hasOneOnItsWay_) receiver_.take(t, onItsWay_);
        hasOneOnItsWay_ = false;
        const double late = detail::drawShare(engine_) * options_.jitter / options_.rate_hz;
        const bool isLost = detail::drawShare(engine_) < options_.loss;
        const bool isFirst = next_ == 0;
        next_ = static_cast<std::int64_t>(index) + 1;
        if (isFirst || !(isGap(t) || isLost)) {
            onItsWay_ = sent;
            hasOneOnItsWay_ = true;
            arrival_s_ = isFirst ? t : t + late;
        }
    }
    arrive();
    receiver_.calc(t, received);
}

}  // namespace viable
