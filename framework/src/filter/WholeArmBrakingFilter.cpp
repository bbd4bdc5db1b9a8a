#include "viable/filter/WholeArmBrakingFilter.h"

#include <cmath>
#include <limits>

#include "filter/JointBraking.h"
#include "filter/WholeArmChoice.h"
#include "viable/core/Error.h"

namespace viable {

struct WholeArmBrakingFilter::Impl {
    detail::JointBraking joints;
    std::unique_ptr<detail::WholeArmChoice> arm;  ///< null: not configured
    JointVector jerk;
};

WholeArmBrakingFilter::WholeArmBrakingFilter() : impl_(std::make_unique<Impl>()) {}
WholeArmBrakingFilter::~WholeArmBrakingFilter() = default;

void WholeArmBrakingFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    impl_->arm.reset();
    impl_->joints.configure(setup, parameters);
    WholeArmBrakingOptions options;
    options.joints = detail::readBrakingOptions(parameters);
    options.torqueShare = parameters.number("torque_share");
    options.torqueRate = parameters.jointNumbers("torque_rate_Nmps");
    options.steers = parameters.flag("steers");
    options.maxAge_s = parameters.number("max_age_s");
    prepare(setup, options, parameters.place("recovery"));
}

void WholeArmBrakingFilter::configure(const RunSetup& setup, const WholeArmBrakingOptions& options,
                                      const std::string& owner) {
    impl_->arm.reset();
    impl_->joints.configure(setup, options.joints, owner);
    prepare(setup, options, owner);
}

void WholeArmBrakingFilter::prepare(const RunSetup& setup, const WholeArmBrakingOptions& options,
                                    const std::string& place) {
    const int n = setup.size();
    if (setup.surroundings && !setup.geometry)
        throw badInput(place, "there are surroundings, but the parts of the arm that can collide are not described",
                       "Set RunSetup::geometry (see loadArmGeometry).");
    if (options.torqueRate.size() != 0 && options.torqueRate.size() != n)
        throw badInput(place,
                       "torqueRate has " + std::to_string(options.torqueRate.size()) + " entries for " +
                           std::to_string(n) + " joints",
                       "Give one per joint, or none.");
    if (setup.surroundings && !setup.surroundings->claim())
        throw badInput(place, "another filter of this case has the surroundings already",
                       "Use one filter that keeps clearances.");
    const JointVector unlimited = JointVector::Constant(n, std::numeric_limits<double>::infinity());
    detail::TorqueScan::Limits limits{unlimited, unlimited};
    if (std::isfinite(options.torqueShare)) limits.torque = options.torqueShare * setup.robot.actuation.torqueLimit;
    if (options.torqueRate.size() == n) limits.rate = options.torqueRate;
    impl_->arm = std::make_unique<detail::WholeArmChoice>(setup, options, limits, impl_->joints.braking());
    reset(setup.start);
    if (!options.joints.recovery) impl_->arm->checkStart(setup, place);
}

void WholeArmBrakingFilter::reset(const MotionState& start) {
    impl_->joints.reset(start);
    if (!impl_->arm) return;
    impl_->arm->reset(start);
    impl_->joints.reset(start);
}

bool WholeArmBrakingFilter::guaranteesClearance() const {
    return impl_->arm && impl_->arm->hasSurroundings() && !recovers();
}

bool WholeArmBrakingFilter::recovers() const {
    return impl_->joints.recovers();
}

bool WholeArmBrakingFilter::changeLimits(const JointLimits& limits) {
    return impl_->joints.changeLimits(limits);
}

void WholeArmBrakingFilter::skipTicks(std::int64_t ticks) {
    impl_->joints.skipTicks(ticks);
    impl_->arm->skipTicks(ticks);
}

FilterStatus WholeArmBrakingFilter::filter(const FilterInput& input, FilterDecision& decision) {
    detail::JointBraking& law = impl_->joints;
    detail::WholeArmChoice& arm = *impl_->arm;
    if (const FilterStatus found = law.findDesired(input); found != FilterStatus::Passed) return found;
    const FilterStatus status = arm.choose(input.nominal, input.dynamics, law.findMetric(input.dynamics), law.desired(),
                                           impl_->jerk, decision.joints);
    law.decide(impl_->jerk, decision);
    decision.clearance = arm.nearest();
    decision.mapAge_s = arm.mapAge_s();
    arm.endTick(input, decision);
    return status;
}

}  // namespace viable
