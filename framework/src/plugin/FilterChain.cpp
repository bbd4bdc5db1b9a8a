#include "viable/plugin/FilterChain.h"

namespace viable {

void FilterChain::add(PluginPtr<SafetyFilter> filter, PluginWatch* watch) {
    if (filter->promisesLimits()) promising_ = static_cast<int>(links_.size());
    links_.push_back({std::move(filter), watch});
}

void FilterChain::reset(const MotionState& start) {
    tick_ = kBeforeFirstTick;
    for (answerable_ = 0; answerable_ < links_.size(); ++answerable_) {
        const PluginCall call = mark(answerable_);
        links_[answerable_].filter->reset(start);
    }
    answerable_ = 0;
    tick_ = 0;
}

bool FilterChain::recovers() const {
    const std::size_t held =
        promising_ >= 0 ? static_cast<std::size_t>(promising_) : links_.size() - 1;
    return links_[held].filter->recovers();
}

bool FilterChain::changeLimits(const JointLimits& limits) {
    for (std::size_t i = 0; i < links_.size(); ++i) {
        answerable_ = i;
        const PluginCall call = mark(i);
        if (!links_[i].filter->changeLimits(limits)) return false;
    }
    return true;
}

void FilterChain::skipTicks(std::int64_t ticks) {
    tick_ += ticks;
    for (std::size_t i = 0; i < links_.size(); ++i) {
        answerable_ = i;
        const PluginCall call = mark(i);
        links_[i].filter->skipTicks(ticks);
    }
}

FilterStatus FilterChain::filter(const MotionState& nominal, const JointVector& torque,
                                 const Dynamics& dynamics, FilterDecision& decision) {
    const auto n = static_cast<int>(torque.size());
    desired_ = torque;
    FilterStatus status = FilterStatus::Passed;
    std::size_t standing = 0;
    for (std::size_t i = 0; i < links_.size(); ++i) {
        answerable_ = i;
        candidate_.hasStops = false;
        candidate_.joints.fill({});
        FilterStatus own;
        {
            const PluginCall call = mark(i);
            own = links_[i].filter->filter(nominal, desired_, dynamics, candidate_);
        }
        if (own == FilterStatus::InvalidInput || own == FilterStatus::Faulted) return own;
        if (own == FilterStatus::Ended)  // no end for a chain that promises
            return promising_ < 0 ? own : FilterStatus::Faulted;
        if (!isFinite(candidate_.torque, n)) return FilterStatus::Faulted;
        const bool passed = own == FilterStatus::Passed;
        if (passed && promising_ >= 0 && static_cast<int>(i) > promising_) continue;
        if (passed && i > 0)
            candidate_.joints = decision.joints;  // what held the joints back is what did before
        if (!passed)
            status = own;
        else if (status != FilterStatus::Passed)
            status = FilterStatus::Modified;
        decision = candidate_;
        desired_ = decision.torque;
        standing = i;
    }
    answerable_ = standing;
    ++tick_;
    return status;
}

}  // namespace viable
