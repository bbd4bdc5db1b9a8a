#pragma once

#include <functional>

#include "analysis/identification/BlockRegression.h"
#include "analysis/identification/TorqueEquations.h"

namespace viable::detail {

/** The friction of a joint as it is fitted: sign (coulomb + slope (1 - exp(-bend |v|)) / bend). */
struct Friction {
    double coulomb = 0.0, slope = 0.0, bend = 0.0;
};

/** Of a friction's viscous part over a window. */
struct Averages {
    double viscous = 0.0, bendSlope = 0.0;  ///< over slope, without the sign
    double rate = 0.0;                      ///< its derivative in time, over slope [rad/s^2]
};

/** (1 - exp(-x)) / x. */
double calcBend(double x);

/** Of the viscous law, seen through a velocity that is `lag` old. Over a shaking of deviation s its mean is that of a
velocity lower by bend s^2 / 2 (the mean of the exponential of a normal variable). */
Averages average(const TorqueEquation& row, double bend, double lag, bool withSlope);

/** Everything that is estimated. */
struct FitValues {
    std::vector<Friction> friction;
    std::vector<double> rotor, offset, bodies;
    double delay = 0.0, lag = 0.0;  ///< of torques, of friction [s]
    double mass = 0.0;
    Eigen::Vector3d moment = Eigen::Vector3d::Zero();
};

/** Places of the parameters in the normal equations; -1: held. */
struct FitLayout {
    std::vector<int> coulomb, slope, bend, rotor, offset, bodies;
    int delay = -1, lag = -1, mass = -1;
    std::array<int, 3> moment{-1, -1, -1};
    int size = 0;
};

/** What is estimated, and what is held at zero or at the robot's figures. */
struct FitChoice {
    std::vector<FrictionForm> forms;  ///< None: the joint's equations are left out, too
    std::vector<bool> rotor, offset, bodies;
    bool delay = false, lag = false, mass = false;
    std::array<bool, 3> moment{};
};

/** The torque equations of all joints fitted at once, for one choice of what is estimated: Gauss-Newton with halved steps,
each joint weighted by its own residuals. */
class TorqueFit {
public:
    /** Bounds of 1 / Fv2 over 1 / the fastest speed: beyond, the law is a step or no friction. */
    static constexpr double kLeastBend = -0.5, kMostBend = 60.0;

    TorqueFit(const RobotDescription& nominal, const TorqueEquations& equations);

    FitChoice choice;

    /** Makes the joint's own best friction the start. @param payloadColumns  that are free with it, 0, 1 or 4 */
    void startFriction(std::size_t joint, int payloadColumns);
    void fit();
    /** Standard errors after fit(), and what laws that were left out would explain.
    @param calcExtras  fills the values of `extras` such laws in an equation; `load` is the gear's torque [Nm] */
    void calcErrors(int extras,
                    const std::function<void(const TorqueEquation& row, double load, double* out)>& calcExtras);

    const FitValues& values() const { return values_; }
    /** After calcErrors(); solution().extra... of a joint begin at joint * extras. */
    const FitLayout& layout() const { return layout_; }
    const BlockRegression::Solution& solution() const { return solution_; }
    const Eigen::MatrixXd& covariance() const { return covariance_; }

    bool isFitted(std::size_t joint) const { return choice.forms[joint] != FrictionForm::None; }
    const std::vector<const TorqueEquation*>& rows(std::size_t joint) const { return rows_[joint]; }
    double fastest(std::size_t joint) const { return fastest_[joint]; }    ///< speed in the equations [rad/s]
    double variance(std::size_t joint) const { return variance_[joint]; }  ///< of an equation of full length [Nm^2]
    Averages average(const TorqueEquation& row, bool withSlope = false) const;
    double calcResidual(const TorqueEquation& row, const Averages& averages) const {
        return calcResidual(row, values_, averages);
    }
    double oldBend(std::size_t joint) const { return 1.0 / oldFriction().viscousVelocity[static_cast<int>(joint)]; }

private:
    const JointFriction& oldFriction() const { return nominal_.actuation.friction; }
    double leastVariance(std::size_t joint) const;
    FitLayout makeLayout() const;
    void holdFixed();
    double calcPayload(const TorqueEquation& row, const FitValues& values) const;
    double calcMasses(const TorqueEquation& row, const FitValues& values) const;
    double calcResidual(const TorqueEquation& row, const FitValues& values, const Averages& averages) const;
    SparseRow makeRow(const TorqueEquation& row, const FitLayout& layout, const FitValues& values,
                      const Averages& averages) const;
    double assemble(const FitValues& values, const FitLayout& layout, BlockRegression* regression) const;
    void gaussNewton(const FitLayout& layout);
    void updateVariances();
    bool isMassSure(const FitLayout& layout) const;
    double massError(const FitLayout& layout) const;

    const RobotDescription& nominal_;
    const TorqueEquations& equations_;
    std::size_t n_;
    std::vector<std::vector<const TorqueEquation*>> rows_;  // per joint
    std::vector<double> fastest_;

    FitValues values_;
    bool isPoint_ = false;  // the payload has second moments, those of a point
    std::vector<double> variance_;
    FitLayout layout_;
    BlockRegression::Solution solution_;
    Eigen::MatrixXd covariance_;
};

}  // namespace viable::detail
