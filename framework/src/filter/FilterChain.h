#pragma once

#include "host/PluginCall.h"

namespace viable {

/** Several filters in a row as one: each is for the next what the controller is for the first.

Of the limits of the joints the guarantee is that of the last filter that makes one; of all others it is the last
filter's. What stands in the end is the decision of the last filter; of those behind the guaranteeing one only what they
changed (Modified and the like): a Passed from there is no objection. The guaranteed decision then stays as it is, to the
last bit, with their reports. A filter whose decision a later one changed finds an arm that
moved otherwise than it decided, which every filter must bear.
Status: that of the decision that stands; Modified where that one passed what an earlier filter had changed.
Real time and thread: as its filters. Where one of them fails, a PluginFault is thrown: the host contains it. */
class FilterChain : public SafetyFilter {
public:
    explicit FilterChain(double tick_s) : tick_s_(tick_s) {}
    ~FilterChain() override;
    FilterChain(const FilterChain&) = delete;
    FilterChain& operator=(const FilterChain&) = delete;

    /** Appends a configured filter. @param watch  may be null; must outlive the chain */
    void add(PluginPtr<SafetyFilter> filter, PluginWatch* watch);

    /** Which filter to name when the chain fails: the one that was called last, or, after a decision, the one whose
    decision it is. */
    std::size_t answerable() const { return answerable_; }
    /** The one whose guarantee of the joints' limits is the chain's; -1: none guarantees them. */
    int guaranteeing() const { return guaranteeing_; }

    void configure(const RunSetup&, const Parameters&) override {}  // its filters are, before add()
    void reset(const MotionState& start) override;
    /** Of the filter that guarantees, or of the last; with what the last guarantees beyond the limits of the joints. */
    FilterTraits traits() const override;
    bool changeLimits(const JointLimits& limits) override;
    void skipTicks(std::int64_t ticks) override;
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    struct Link {
        PluginPtr<SafetyFilter> filter;
        PluginWatch* watch;
    };
    /** Calls one filter under its watch. Throws PluginFault for what must not be handed on to the next. */
    template <class Work>
    auto callLink(std::size_t index, const Work& work);

    std::vector<Link> links_;
    int guaranteeing_ = -1;
    LimitSet ofPeople_;  // kinds that watch people
    std::size_t answerable_ = 0;
    const double tick_s_;
    std::int64_t tick_ = kBeforeFirstTick;
    FilterDecision candidate_;
    HeldMotion motion_;
    JointVector desired_;
};

}  // namespace viable
