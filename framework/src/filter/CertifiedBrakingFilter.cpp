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
    impl_->joints.configure(setup, parameters);
}

void CertifiedBrakingFilter::configure(const RunSetup& setup, const CertifiedBrakingOptions& options) {
    impl_->joints.configure(setup, options);
}

void CertifiedBrakingFilter::reset(const MotionState& start) {
    impl_->joints.reset(start);
}

bool CertifiedBrakingFilter::recovers() const {
    return impl_->joints.recovers();
}

bool CertifiedBrakingFilter::changeLimits(const JointLimits& limits) {
    return impl_->joints.changeLimits(limits);
}

void CertifiedBrakingFilter::skipTicks(std::int64_t ticks) {
    impl_->joints.skipTicks(ticks);
}

FilterStatus CertifiedBrakingFilter::filter(const MotionState& nominal, const JointVector& torque,
                                            const Dynamics& dynamics, FilterDecision& decision) {
    detail::JointBraking& law = impl_->joints;
    const FilterStatus input = law.findDesired(nominal, torque, dynamics);
    if (input != FilterStatus::Passed) return input;
    std::array<CertifiedBraking::ActingLimit, kMaxJoints> acting;
    const CertifiedBraking::Status status =
        law.braking().choose(nominal, dynamics.M, law.desired(), impl_->jerk, acting);
    for (std::size_t i = 0; i < static_cast<std::size_t>(impl_->jerk.size()); ++i)
        decision.joints[i] = {acting[i].limit, acting[i].side};
    law.decide(nominal, dynamics, impl_->jerk, decision);
    switch (status) {
        case CertifiedBraking::Status::Passed:
            return FilterStatus::Passed;
        case CertifiedBraking::Status::Modified:
            return FilterStatus::Modified;
        case CertifiedBraking::Status::Recovering:
            return FilterStatus::Recovering;
    }
    return FilterStatus::Faulted;
}

}  // namespace viable
