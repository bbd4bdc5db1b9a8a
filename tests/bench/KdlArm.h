#pragma once

#include <kdl/chain.hpp>
#include <kdl/chaindynparam.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** The figures of Dynamics by Orocos KDL 1.5. The arm has no branches; its joints turn, the last carries the tool. */
class KdlArm {
public:
    explicit KdlArm(const RobotDescription& robot)
        : n_(robot.size()), chain_(makeChain(robot)), dynamics_(chain_, toKdl(robot.gravity)) {}

    void calc(const JointVector& q, const JointVector& qd, Dynamics& out) {
        for (int i = 0; i < n_; ++i) {
            q_(static_cast<unsigned>(i)) = q[i];
            qd_(static_cast<unsigned>(i)) = qd[i];
        }
        dynamics_.JntToMass(q_, M_);
        dynamics_.JntToCoriolis(q_, qd_, coriolis_);
        dynamics_.JntToGravity(q_, gravity_);
        position_.JntToCart(q_, tool_);
        jacobian_.JntToJac(q_, J_);
        out.M = M_.data;
        out.gravity = gravity_.data;
        out.b = coriolis_.data + gravity_.data;
        out.J = J_.data;
        for (int i = 0; i < 3; ++i) out.tool.position[i] = tool_.p(i);
    }

private:
    static KDL::Vector toKdl(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
    static KDL::Frame toKdl(const Eigen::Isometry3d& pose) {
        const Eigen::Matrix3d R = pose.linear();
        return {KDL::Rotation(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)),
                toKdl(pose.translation())};
    }

    static KDL::Chain makeChain(const RobotDescription& robot) {
        KDL::Chain chain;
        for (int i = 0; i < robot.size(); ++i) {
            const JointDescription& joint = robot.joints[static_cast<std::size_t>(i)];
            VIABLE_CHECK(joint.parent == i - 1 && !robot.slides(i), "KDL's chain has no branches, and its joints turn");
            const KDL::Joint turning(joint.name, toKdl(joint.placement.translation()),
                                     toKdl(Eigen::Vector3d(joint.placement.linear() * joint.axis)), KDL::Joint::RotAxis,
                                     1.0, 0.0, robot.actuation.rotorInertia[i]);
            const Eigen::Matrix3d& I = joint.body.inertia;
            const KDL::RotationalInertia inertia(I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2));
            chain.addSegment(KDL::Segment(joint.name, turning, toKdl(joint.placement),
                                          KDL::RigidBodyInertia(joint.body.mass, toKdl(joint.body.com), inertia)));
        }
        VIABLE_CHECK(robot.toolParent == robot.size() - 1, "the tool is on the last joint");
        chain.addSegment(KDL::Segment("tool", KDL::Joint(KDL::Joint::None), toKdl(robot.toolPlacement)));
        return chain;
    }

    int n_;
    KDL::Chain chain_;
    KDL::ChainDynParam dynamics_;
    KDL::ChainFkSolverPos_recursive position_{chain_};
    KDL::ChainJntToJacSolver jacobian_{chain_};
    KDL::JntArray q_{static_cast<unsigned>(n_)}, qd_{q_}, coriolis_{q_}, gravity_{q_};
    KDL::JntSpaceInertiaMatrix M_{static_cast<int>(n_)};
    KDL::Jacobian J_{static_cast<unsigned>(n_)};
    KDL::Frame tool_;
};

}  // namespace viable
