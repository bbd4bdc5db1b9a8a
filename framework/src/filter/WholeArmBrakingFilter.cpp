#include "filter/WholeArmBrakingFilter.h"

#include "filter/JointBraking.h"
#include "filter/WholeArmChoice.h"
#include "robot/PoseSampling.h"

namespace viable {

namespace {

/** Poses in which the arm's inertia is looked at. */
constexpr int kPoses = 192;
/** Of the torque rate, what jerk may use; the rest is for gravity and velocities. Only how well the arm moves depends on it. */
constexpr double kJerkShare = 0.8;
constexpr double kStep = 0.98;

/** The largest jerk of each joint with which the stops need no more torque rate than there is: |M| jerk within its share in every
pose looked at; at most that of the limits. Infinite without a rate. A stop that needs more would never be taken, and the arm not
move. */
JointVector findLargestJerk(const RobotDescription& robot, const JointLimits& limits, const JointVector& rate) {
    const int n = robot.size();
    const bool isRate = rate.size() == n && (rate.array() > 0.0).all();
    if (!isRate || !limits.hasJerkLimits() || rate.array().isInf().all())
        return JointVector::Constant(n, std::numeric_limits<double>::infinity());
    JointVector jerk = (-limits.jerk.lower).cwiseMax(limits.jerk.upper);
    for (const detail::PoseInertia& pose : detail::sampleInertia(robot, limits, kPoses)) {
        const JointMatrix M = pose.M.cwiseAbs();
        for (int i = 0; i < n; ++i)
            while (M.row(i).dot(jerk) > kJerkShare * rate[i]) {
                // The joint that asks most of this motor is slowed.
                Eigen::Index most = 0;
                M.row(i).transpose().cwiseProduct(jerk).maxCoeff(&most);
                jerk[most] *= kStep;
            }
    }
    return jerk;
}

}  // namespace

struct WholeArmBrakingFilter::Impl {
    detail::JointBraking joints;
    std::optional<ArmGeometry> geometry;          ///< whose speeds are limited, where the setup has none
    std::unique_ptr<detail::WholeArmChoice> arm;  ///< null: not configured
    JointVector jerk;
    JointVector largestJerk;  ///< that the torque rate allows [rad/s^3]

    JointLimits slow(JointLimits limits) const {
        limits.jerk.lower = limits.jerk.lower.cwiseMax(-largestJerk);
        limits.jerk.upper = limits.jerk.upper.cwiseMin(largestJerk);
        return limits;
    }
    /** The setup of the joints, whose jerks are as low as the torque rate demands. */
    RunSetup slow(const RunSetup& setup, const WholeArmBrakingOptions& options) {
        arm.reset();
        const int n = setup.size();
        largestJerk = findLargestJerk(setup.robot, setup.limits,
                                      options.torqueRate.fits(n) ? options.torqueRate.expand(n) : JointVector());
        RunSetup slowed = setup;
        slowed.limits = slow(setup.limits);
        return slowed;
    }
};

WholeArmBrakingFilter::WholeArmBrakingFilter() : impl_(std::make_unique<Impl>()) {}
WholeArmBrakingFilter::~WholeArmBrakingFilter() = default;

void WholeArmBrakingFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    const auto options = parameters.get<WholeArmBrakingOptions>();
    impl_->joints.configure(impl_->slow(setup, options), options.joints, parameters);
    prepare(setup, options, parameters.place("recovery"));
}

void WholeArmBrakingFilter::configure(const RunSetup& setup, const WholeArmBrakingOptions& options,
                                      const std::string& owner) {
    impl_->joints.configure(impl_->slow(setup, options), options.joints, owner);
    prepare(setup, options, owner);
}

void WholeArmBrakingFilter::prepare(const RunSetup& setup, const WholeArmBrakingOptions& options,
                                    const std::string& place) {
    const int n = setup.size();
    if (!std::isinf(options.torqueShare) ||
        !(options.torqueRate.fits(n) && options.torqueRate.expand(n).array().isInf().all()))
        requireDynamics(setup.robot, place, "a limit of the torque");
    if (setup.surroundings && !setup.geometry)
        throw badInput(place, "there are surroundings, but the parts of the arm that can collide are not described",
                       "Set RunSetup::geometry (see loadArmGeometry).");
    if (!options.torqueRate.fits(n))
        throw badInput(place,
                       "torqueRate has " + std::to_string(options.torqueRate.count()) + " entries for " +
                           std::to_string(n) + " joints",
                       "Give one per joint, or one for all.");
    const JointVector torqueRate = options.torqueRate.expand(n);
    if (!(torqueRate.array() > 0.0).all())
        throw badInput(place, "a torqueRate is not above 0", "Give rates above 0, infinite where there is no limit.");
    checkSpeedLimits(setup.robot.speedLimits, place);
    if (setup.robot.speedLimits.tool < std::numeric_limits<double>::infinity() && setup.robot.toolParent < 0)
        throw badInput(place, "the tool has a speed limit, but no joint carries it",
                       "Set RobotDescription::toolParent, or leave SpeedLimits::tool infinite.");
    if ((setup.robot.speedLimits.needsCapsules() || setup.people) && !setup.geometry)
        impl_->geometry = loadArmGeometry(setup.robot);
    if (setup.surroundings && !setup.surroundings->claim())
        throw badInput(place, "another filter of this case has the surroundings already",
                       "Use one filter that keeps clearances.");
    if (setup.people && !setup.people->claim()) {
        if (setup.surroundings) setup.surroundings->release();
        throw badInput(place, "another filter of this case has the people already",
                       "Use one filter that keeps apart from people.");
    }
    const JointVector unlimited = JointVector::Constant(n, std::numeric_limits<double>::infinity());
    detail::TorqueScan::Limits limits{unlimited, unlimited};
    if (std::isfinite(options.torqueShare)) limits.torque = options.torqueShare * setup.robot.actuation.torqueLimit;
    limits.rate = torqueRate;
    const ArmGeometry* const limited = setup.geometry ? setup.geometry : impl_->geometry ? &*impl_->geometry : nullptr;
    impl_->arm = std::make_unique<detail::WholeArmChoice>(setup, options, limits, impl_->joints.braking(), limited);
    reset(setup.start);
    if (!options.joints.recovery) impl_->arm->checkStart(setup, place);
}

void WholeArmBrakingFilter::reset(const MotionState& start) {
    impl_->joints.reset(start);
    if (!impl_->arm) return;
    impl_->arm->reset(start);
    impl_->joints.reset(start);
}

FilterTraits WholeArmBrakingFilter::traits() const {
    FilterTraits traits{LimitSet::joints(), impl_->joints.recovers()};
    if (impl_->arm && !traits.recovers) traits.guarantees = traits.guarantees | impl_->arm->guarantees();
    return traits;
}

bool WholeArmBrakingFilter::changeLimits(const JointLimits& limits) {
    return impl_->joints.changeLimits(impl_->slow(limits));
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
    arm.report(decision);
    arm.endTick(input, decision);
    return status;
}

}  // namespace viable
