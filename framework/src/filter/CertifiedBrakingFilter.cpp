#include "viable/filter/CertifiedBrakingFilter.h"

#include "filter/JointBraking.h"

namespace viable {

struct CertifiedBrakingFilter::Impl {
    detail::JointBraking joints;
    JointVector jerk;
};

CertifiedBrakingFilter::CertifiedBrakingFilter() : impl_(std::make_unique<Impl>()) {}
CertifiedBrakingFilter::~CertifiedBrakingFilter() = default;

void CertifiedBrakingFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    impl_->joints.configure(setup, parameters.get<CertifiedBrakingOptions>(), parameters);
}

void CertifiedBrakingFilter::configure(const RunSetup& setup, const CertifiedBrakingOptions& options,
                                       const std::string& owner) {
    impl_->joints.configure(setup, options, owner);
}

void CertifiedBrakingFilter::reset(const MotionState& start) {
    impl_->joints.reset(start);
}

FilterTraits CertifiedBrakingFilter::traits() const {
    return {LimitSet::joints(), impl_->joints.recovers()};
}

bool CertifiedBrakingFilter::changeLimits(const JointLimits& limits) {
    return impl_->joints.changeLimits(limits);
}

void CertifiedBrakingFilter::skipTicks(std::int64_t ticks) {
    impl_->joints.skipTicks(ticks);
}

FilterStatus CertifiedBrakingFilter::filter(const FilterInput& input, FilterDecision& decision) {
    detail::JointBraking& law = impl_->joints;
    if (const FilterStatus found = law.findDesired(input); found != FilterStatus::Passed) return found;
    const FilterStatus status = law.braking().choose(input.nominal, law.findMetric(input.dynamics), law.desired(),
                                                     impl_->jerk, decision.joints);
    law.decide(impl_->jerk, decision);
    return status;
}

}  // namespace viable
