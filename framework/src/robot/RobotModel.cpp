#include "viable/robot/RobotModel.h"

#include "robot/ArmRecursion.h"
#include "robot/SimbodyModel.h"

namespace viable {

namespace {

void fillWithNan(int n, Dynamics& out) {
    out.M.setConstant(n, n, kNan);
    out.b.setConstant(n, kNan);
    out.gravity.setConstant(n, kNan);
    out.tool.position.setConstant(kNan);
    out.tool.orientation.coeffs().setConstant(kNan);
    out.J.setConstant(6, n, kNan);
}

}  // namespace

/** Simbody's system takes long to make: there is one only where it is asked for. */
struct RobotModel::Engines {
    RobotDescription robot;
    ArmRecursion recursion;
    bool isSimbody;  // calcDynamics
    std::unique_ptr<SimbodyModel> simbody;

    Engines(const RobotDescription& description, DynamicsEngine engine)
        : robot(description), recursion(robot), isSimbody(engine == DynamicsEngine::Simbody) {
        VIABLE_CHECK(robot.toolParent >= 0, "the tool hangs on a joint");
        if (isSimbody) getSimbody();
    }

    SimbodyModel& getSimbody() {
        if (!simbody) simbody = std::make_unique<SimbodyModel>(robot);
        return *simbody;
    }
};

RobotModel::RobotModel(const RobotDescription& robot) : RobotModel(robot, DynamicsEngine::Recursion) {}
RobotModel::RobotModel(const RobotDescription& robot, DynamicsEngine engine)
    : engines_(std::make_unique<Engines>(robot, engine)) {}
RobotModel::~RobotModel() = default;
RobotModel::RobotModel(RobotModel&&) noexcept = default;
RobotModel& RobotModel::operator=(RobotModel&&) noexcept = default;

int RobotModel::size() const {
    return engines_->recursion.size();
}

void RobotModel::calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out) {
    if (!q.allFinite() || !qd.allFinite())
        fillWithNan(size(), out);
    else if (engines_->isSimbody)
        engines_->simbody->calcDynamics(q, qd, out);
    else
        engines_->recursion.calcDynamics(q, qd, out);
}

double RobotModel::calcEnergy(const JointVector& q, const JointVector& qd) {
    return engines_->getSimbody().calcEnergy(q, qd);
}

JointVector RobotModel::calcLinkForwardDynamics(const JointVector& q, const JointVector& qd, const JointVector& tau) {
    return engines_->getSimbody().calcLinkForwardDynamics(q, qd, tau);
}

}  // namespace viable
