#pragma once

#include <mujoco/mujoco.h>
#include <urdf_parser/urdf_parser.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

#include "viable/robot/Dynamics.h"

namespace viable {

/** A robot's URDF as MuJoCo reads and computes it. MuJoCo and not KDL: it has a URDF reader of its own, whereas KDL's goes
through urdfdom as ours does, so a slip of reading on either side shows as well.

Rotor inertia and friction stand in actuation.yaml, which MuJoCo never sees: M and b are those of the links alone. */
class MujocoModel {
public:
    /** Throws std::runtime_error in MuJoCo's words where it refuses the file. */
    explicit MujocoModel(const std::filesystem::path& urdf) {
        std::ostringstream text;
        text << std::ifstream(urdf).rdbuf();
        std::string xml = text.str();
        // Links behind fixed joints stay bodies, so that the tool's pose can be asked for; masses come from <inertial> only.
        const std::size_t root = xml.find('>', xml.find("<robot"));
        if (root == std::string::npos)
            throw std::runtime_error(urdf.string() + " holds no <robot>");
        xml.insert(root + 1,
                   "<mujoco><compiler fusestatic=\"false\" discardvisual=\"true\" "
                   "inertiafromgeom=\"false\"/></mujoco>");

        const char* const name = "robot.urdf";
        const auto files = std::make_unique<mjVFS>();
        mj_defaultVFS(files.get());
        mj_makeEmptyFileVFS(files.get(), name, static_cast<int>(xml.size()));
        xml.copy(static_cast<char*>(files->filedata[mj_findFileVFS(files.get(), name)]),
                 xml.size());
        char error[1000] = "";
        model_.reset(mj_loadXML(name, files.get(), error, sizeof error));
        mj_deleteVFS(files.get());
        if (!model_) throw std::runtime_error(urdf.string() + ": " + error);
        data_.reset(mj_makeData(model_.get()));
    }

    /** Puts the tensors of the URDF, read by urdfdom and turned into principal axes to rounding, in the place of MuJoCo's
    own, whose axes are right to 1e-6 rad only (it stops turning when the next turn is smaller than that). */
    void sharpenInertia(const std::filesystem::path& urdf) {
        const urdf::ModelInterfaceSharedPtr links = urdf::parseURDFFile(urdf.string());
        if (!links) throw std::runtime_error("urdfdom refuses " + urdf.string());
        for (const auto& [name, link] : links->links_) {
            const int body = mj_name2id(model_.get(), mjOBJ_BODY, name.c_str());
            if (body < 0 || !link->inertial)
                continue;  // the root is part of MuJoCo's world, the tool has no mass
            const urdf::Inertial& from = *link->inertial;
            Eigen::Matrix3d tensor;
            tensor << from.ixx, from.ixy, from.ixz, from.ixy, from.iyy, from.iyz, from.ixz,
                from.iyz, from.izz;
            const urdf::Rotation& r = from.origin.rotation;
            const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> principal(tensor);
            Eigen::Matrix3d axes =
                Eigen::Quaterniond(r.w, r.x, r.y, r.z) * principal.eigenvectors();
            if (axes.determinant() < 0.0) axes.col(0) *= -1.0;
            const Eigen::Quaterniond turned(axes);
            const double quaternion[4] = {turned.w(), turned.x(), turned.y(), turned.z()};
            std::copy(quaternion, quaternion + 4, model_->body_iquat + 4 * body);
            Eigen::Map<Eigen::Vector3d>(model_->body_inertia + 3 * body) = principal.eigenvalues();
            model_->body_sameframe[body] = 0;
        }
        mj_setConst(model_.get(), data_.get());  // what MuJoCo derives from them
    }

    int size() const { return model_->nv; }
    std::string jointName(int i) const { return mj_id2name(model_.get(), mjOBJ_JOINT, i); }

    /** M, b, gravity, and as the tool's pose that of link `tool`; no Jacobian. */
    Dynamics calc(const JointVector& q, const JointVector& qd, const std::string& tool) {
        Dynamics out;
        const int n = size();
        Eigen::Map<Eigen::VectorXd>(data_->qpos, n) = q;
        Eigen::Map<Eigen::VectorXd> velocity(data_->qvel, n);
        const Eigen::Map<const Eigen::VectorXd> bias(data_->qfrc_bias, n);
        mj_fwdPosition(model_.get(), data_.get());
        velocity.setZero();
        mj_fwdVelocity(model_.get(), data_.get());
        out.gravity = bias;
        velocity = qd;
        mj_fwdVelocity(model_.get(), data_.get());
        out.b = bias;
        Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> M(n, n);
        mj_fullM(model_.get(), M.data(), data_->qM);
        out.M = M;
        const int body = mj_name2id(model_.get(), mjOBJ_BODY, tool.c_str());
        if (body < 0) throw std::runtime_error("MuJoCo knows no link " + tool);
        out.tool.position = Eigen::Map<Eigen::Vector3d>(data_->xpos + 3 * body);
        const double* w = data_->xquat + 4 * body;
        out.tool.orientation = Eigen::Quaterniond(w[0], w[1], w[2], w[3]);
        return out;
    }

private:
    struct Free {
        void operator()(mjModel* model) const { mj_deleteModel(model); }
        void operator()(mjData* data) const { mj_deleteData(data); }
    };
    std::unique_ptr<mjModel, Free> model_;
    std::unique_ptr<mjData, Free> data_;
};

}  // namespace viable
