#include "clearance/SteeringRows.h"

#include <cmath>

namespace viable::detail {

namespace {

/** How far a joint is with the tick's jerk at a later time, where two stops of it do not tell, in tick^3: by the shortest
stops from rest. */
constexpr double kLeastSlope = 2.0;

}  // namespace

SteeringRows::SteeringRows(const RobotDescription& robot, std::vector<LinkCapsule> capsules,
                           const TorqueScan::Limits& limits, double tick_s)
    : n_(robot.size()), arm_(robot), capsules_(std::move(capsules)), limits_(limits), tick_s_(tick_s) {}

void addRow(const JointVector& row, double bound, RowQp::Rows& rows) {
    const double size = row.norm();
    if (size > 0.0) rows.add(row / size, bound / size);
}

void multiplyPlaceSlopes(const StopPair& stops, double t_s, double tick_s, JointVector& row) {
    JointVector here, there;
    stops.path.calcPositions(std::min(t_s, stops.path.duration()), here);
    stops.other.calcPositions(std::min(t_s, stops.other.duration()), there);
    for (Eigen::Index i = 0; i < row.size(); ++i) {
        const double slope = (here[i] - there[i]) / (stops.jerk[i] - stops.otherJerk[i]);
        row[i] *= std::isfinite(slope) && slope > 0.0 ? slope : kLeastSlope * tick_s * tick_s * tick_s;
    }
}

/** c + sum_i gradient . (dp/dq_i) (dq_i/du_i) (u_i - jerk_i) >= bound, all at the nearest place; dq_i/du_i by the
difference of the two paths there. */
void SteeringRows::addClearance(const ElementDistance::Place& place, const ArmElement& element,
                                const ArmRecursion::Frames& frames, double t_s, double bound, const StopPair& stops,
                                RowQp::Rows& rows) const {
    JointVector row;
    calcDistanceGradient(place, element, capsules_, arm_, frames, row);
    multiplyPlaceSlopes(stops, t_s, tick_s_, row);
    addRow(row, bound - place.distance + row.dot(stops.jerk), rows);
}

bool SteeringRows::addForeseen(const ElementDistance::Place& place, const ArmElement& element, double t_s, double bound,
                               const StopPair& stops, RowQp::Rows& rows) const {
    JointVector q;
    stops.path.calcPositions(std::min(t_s, stops.path.duration()), q);
    ArmRecursion::Frames frames;
    arm_.calcFrames(q, frames);
    const int before = rows.count;
    addClearance(place, element, frames, t_s, bound, stops, rows);
    if (rows.count == before) return true;
    return rows.normal[before].dot(stops.otherJerk) >= rows.bound[before];
}

double SteeringRows::calcSteepness(const ElementDistance::Place& place, const ArmElement& element,
                                   const ArmRecursion::Frames& frames, double t_s, const StopPair& stops) const {
    JointVector gradient, here, there;
    calcDistanceGradient(place, element, capsules_, arm_, frames, gradient);
    stops.path.calcPositions(std::min(t_s, stops.path.duration()), here);
    stops.other.calcPositions(std::min(t_s, stops.other.duration()), there);
    const double most = gradient.norm() * (there - here).norm();
    return most > 0.0 ? gradient.dot(there - here) / most : 0.0;
}

void SteeringRows::addTorque(const TorqueScan::Fault& fault, const StopPair& stops, RowQp::Rows& rows) const {
    const double t = static_cast<double>(fault.tick) * tick_s_;
    const double middle = t + tick_s_ / 2.0;  // the torque of a tick is that of its mean acceleration
    JointVector q;
    stops.path.calcPositions(t, q);
    JointMatrix M;
    arm_.calcInertia(q, M);
    const auto calcSlope = [&](int i, double at_s) {
        const double here = stops.path.calcAcceleration(i, at_s);
        const double there = stops.other.calcAcceleration(i, at_s);
        return (here - there) / (stops.jerk[i] - stops.otherJerk[i]);
    };
    JointVector row = JointVector::Zero(n_);
    for (int i = 0; i < n_; ++i) {
        double slope = calcSlope(i, middle);
        if (fault.isChange && fault.tick > 0) slope -= calcSlope(i, middle - tick_s_);
        row[i] = M(fault.joint, i) * (std::isfinite(slope) ? slope : tick_s_ / 2.0);
    }
    if (fault.value > 0.0) row = -row;
    addRow(row, fault.missing + row.dot(stops.jerk), rows);
}

void SteeringRows::addTick(const Dynamics& dynamics, const JointVector& qdd, double torqueUse,
                           const JointVector& lastTorque, RowQp::Rows& rows) const {
    for (int i = 0; i < n_; ++i) {
        const double change = torqueUse * limits_.rate[i] * tick_s_;
        const double upper = std::min(torqueUse * limits_.torque[i], lastTorque[i] + change);
        const double lower = std::max(-torqueUse * limits_.torque[i], lastTorque[i] - change);
        const JointVector row = dynamics.M.row(i).transpose() * (tick_s_ / 2.0);
        const double rest = dynamics.M.row(i).dot(qdd) + dynamics.b[i];
        if (std::isfinite(lower)) addRow(row, lower - rest, rows);
        if (std::isfinite(upper)) addRow(-row, rest - upper, rows);
    }
}

}  // namespace viable::detail
