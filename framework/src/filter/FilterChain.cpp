#include "filter/FilterChain.h"

namespace viable {

namespace {

bool isAnyKnown(const LimitReports& reports, LimitSet kinds) {
    for (const LimitKind kind : listArmLimits())
        if (kinds.has(kind) && reports[kind].isKnown) return true;
    return false;
}

}  // namespace

void FilterChain::add(PluginPtr<SafetyFilter> filter, PluginWatch* watch) {
    if (filter->traits().guarantees.hasJoints()) guaranteeing_ = static_cast<int>(links_.size());
    links_.push_back({std::move(filter), watch});
    ofPeople_ = findPeopleLimits();
}

FilterChain::~FilterChain() {
    for (Link& link : links_) {
        const PluginCall call(link.watch, kAfterLastTick);
        link.filter.reset();
    }
}

template <class Work>
auto FilterChain::callLink(std::size_t index, const Work& work) {
    answerable_ = index;
    PluginCall call(links_[index].watch, tick_);
    const auto result = work(*links_[index].filter);
    if (const char* change = call.undoArithmeticChange())
        throw PluginFault(formatArithmeticChange(change), kOnArithmeticChange);
    return result;
}

void FilterChain::reset(const MotionState& start) {
    for (const Link& link : links_) resetPlugin(*link.filter, PluginKind::SafetyFilter, link.watch, start);
    answerable_ = 0;
    tick_ = 0;
}

FilterTraits FilterChain::traits() const {
    const FilterTraits last = links_.back().filter->traits();
    if (guaranteeing_ < 0) return last;
    FilterTraits traits = links_[guaranteeing_].filter->traits();
    // What comes behind may change a decision within the limits of the joints, which the monitor sees to. Of all other
    // limits only the last filter's word holds: its decision, or the one that it passes, is the arm's.
    traits.guarantees = LimitSet::joints() | last.guarantees;
    return traits;
}

bool FilterChain::changeLimits(const JointLimits& limits) {
    for (std::size_t i = 0; i < links_.size(); ++i)
        if (!callLink(i, [&](SafetyFilter& filter) { return filter.changeLimits(limits); })) return false;
    return true;
}

void FilterChain::skipTicks(std::int64_t ticks) {
    tick_ += ticks;
    for (std::size_t i = 0; i < links_.size(); ++i)
        callLink(i, [&](SafetyFilter& filter) {
            filter.skipTicks(ticks);
            return true;
        });
}

FilterStatus FilterChain::filter(const FilterInput& input, FilterDecision& decision) {
    const auto n = static_cast<int>(input.torque.size());
    desired_ = input.torque;
    // Of the controller's torque: it says nothing of what a filter has changed.
    const JointVector* rate = input.accelerationRate;
    FilterStatus status = FilterStatus::Passed;
    std::size_t standing = 0;
    for (std::size_t i = 0; i < links_.size(); ++i) {
        candidate_.clearReports();
        candidate_.joints.fill({});
        const FilterInput own{input.nominal, desired_, input.dynamics, rate};
        const FilterStatus answer = callLink(i, [&](SafetyFilter& filter) { return filter.filter(own, candidate_); });
        if (answer == FilterStatus::InvalidInput || answer == FilterStatus::Faulted) return answer;
        if (answer == FilterStatus::Ended) {
            if (guaranteeing_ < 0) return answer;
            throw PluginFault("it ended the case, but a filter beside it guarantees all limits",
                              "Choose its parameters so that it continues where it has no choice.");
        }
        if (!isFinite(candidate_.value, n))
            throw PluginFault("its decision has the wrong size or is not finite", kOnValues);
        const bool passed = answer == FilterStatus::Passed;
        if (passed && i > 0) {
            candidate_.joints = decision.joints;  // what held the joints back is what did before
            const bool looks = isAnyKnown(candidate_.reports, ofPeople_);
            candidate_.reports.complete(decision.reports);  // and so is what was seen of the same motion
            if (!looks) candidate_.peopleFaults = decision.peopleFaults;
        }
        if (passed && guaranteeing_ >= 0 && static_cast<int>(i) > guaranteeing_) {
            decision.reports = candidate_.reports;
            decision.peopleFaults = candidate_.peopleFaults;
            continue;
        }
        if (!passed)
            status = answer;
        else if (status != FilterStatus::Passed)
            status = FilterStatus::Modified;
        decision = candidate_;
        calcHeldMotion(own, answer, decision, tick_s_, motion_);
        if (!isFinite(motion_.torque, n)) throw PluginFault("its decision is beyond all arithmetic", kOnValues);
        standing = i;
        if (passed && rate) continue;  // the controller's torque, and how it changes, say all to the next one
        if (motion_.torque != desired_) rate = nullptr;
        desired_ = motion_.torque;
    }
    answerable_ = standing;
    ++tick_;
    return status;
}

}  // namespace viable
