#include "clearance/StopDemands.h"

namespace viable::detail {

namespace {

/** Farther than so much beyond its least clearance nothing is steered away from [m]. */
constexpr double kInfluence_m = 0.1;
/** So much of the guard bumps may take [m]: more than those of links of the usual size. */
constexpr double kEase_m = 0.4 * bisection::kGuard_m;

}  // namespace

StopDemands::StopDemands(int elements, double share) : share_(share) {
    for (ArmStopCheck::Demands* d : {&demands_, &measures_})
        for (std::vector<double>* v : {&d->floor, &d->least, &d->ahead, &d->reached, &d->far})
            v->assign(static_cast<std::size_t>(elements), -kInfinity);
    hard_.resize(static_cast<std::size_t>(elements));
    measures_.torqueUse = kInfinity;
    measures_.speed = {kInfinity, kInfinity, kInfinity};
    measures_.people.least = 0.0;
    demands_.beginsAbove = true;
}

const ArmStopCheck::Demands& StopDemands::measure() {
    std::fill(measures_.floor.begin(), measures_.floor.end(), required_m_);
    std::fill(measures_.ahead.begin(), measures_.ahead.end(), aim());
    return measures_;
}

void StopDemands::begin(const ArmStopCheck::Result& stored) {
    demands_.torqueUse = std::max(1.0, stored.torque.torqueUse);
    for (std::size_t e = 0; e < stored.seen.size(); ++e) {
        // Where a map tells nothing (-infinity) nothing less is asked: the backup stop goes on until it does.
        const bool isKept = !(stored.seen[e] < required_m_) || std::isinf(stored.seen[e]);
        demands_.floor[e] = isKept ? required_m_ : stored.seen[e] - bisection::kGuard_m;
        demands_.least[e] = std::isinf(stored.seen[e]) ? aim() : std::min(aim(), stored.seen[e]);
        demands_.reached[e] = demands_.least[e];
    }
}

void StopDemands::raise(const ArmStopCheck::Result& kept) {
    const double most = demands_.speed.looks - SpeedCheck::kSteering;
    demands_.speed.ahead = most - (1.0 - share_) * std::max(0.0, most - kept.speed.seenLater);
    const double room_m = std::clamp(kept.people.seen - PeopleCheck::kGuard_m, 0.0, kInfluence_m);
    demands_.people.ahead = PeopleCheck::kGuard_m + (1.0 - share_) * room_m;
    for (std::size_t e = 0; e < kept.seen.size(); ++e) {
        demands_.floor[e] = std::max(demands_.floor[e], std::min(required_m_, kept.seen[e] - bisection::kGuard_m));
        demands_.least[e] = std::max(demands_.least[e], std::min(aim(), kept.seen[e]));
        const bool hasStayed = kept.seen[e] >= demands_.reached[e] - bisection::kRounding_m;
        demands_.reached[e] = hasStayed ? std::max(demands_.reached[e], kept.seen[e]) : kept.seen[e];
        const double room = std::clamp(kept.seen[e] - demands_.least[e], 0.0, kInfluence_m);
        demands_.ahead[e] = demands_.least[e] + (1.0 - share_) * room;
        demands_.far[e] = demands_.least[e] + kInfluence_m;
    }
}

void StopDemands::ease() {
    hard_ = demands_.least;
    for (double& least : demands_.least) least = std::min(least, aim() - kEase_m);
}

void StopDemands::harden(const ArmStopCheck::Result* taken) {
    demands_.least = hard_;
    for (std::size_t e = 0; taken && e < hard_.size(); ++e)
        demands_.least[e] = std::min(hard_[e], std::max(taken->seen[e], aim() - kEase_m));
}

bool StopDemands::isKept() const {
    return std::all_of(demands_.floor.begin(), demands_.floor.end(),
                       [this](double floor) { return !(floor < required_m_); });
}

}  // namespace viable::detail
