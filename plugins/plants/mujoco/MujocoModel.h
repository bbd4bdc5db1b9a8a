#pragma once

#include <mujoco/mujoco.h>

#include <memory>

#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** Something that can be touched, on a link of the URDF. */
struct MujocoShape {
    std::string link;  ///< empty: its root
    mjtGeom type = mjGEOM_SPHERE;
    Eigen::Vector3d size = Eigen::Vector3d::Zero();          ///< as MuJoCo has it: radius, half lengths [m]
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< in the link's frame
};

/** An arm as MuJoCo reads it from its URDF and computes it. MuJoCo has a URDF reader of its own, whereas ours goes
through urdfdom, so a slip of reading on either side shows as well.

Of the file, masses, tensors and joints count; meshes, limits, damping and friction do not. Rotor inertia and friction
stand in actuation.yaml, which MuJoCo never sees: M and b are those of the links alone until a plant adds them.
Errors: MuJoCo's own become exceptions, of this class in the constructor and anywhere in its calls (it would end the
process); its warnings are dropped (it would write them to a file of the current folder). Both for the whole process. */
class MujocoModel {
public:
    /** Throws std::runtime_error in MuJoCo's words, with the link that it names, where it refuses the text.
    @param shapes  each on a massless body of its own. Those on moving links touch those on the root and nothing else;
    no shapes, no contacts. */
    explicit MujocoModel(const std::string& urdf, const std::vector<MujocoShape>& shapes = {});
    /** MuJoCo's number of each shape. */
    const std::vector<int>& geoms() const { return geoms_; }

    /** Puts the tensors of the URDF, read by urdfdom and turned into principal axes to rounding, in the place of MuJoCo's
    own, whose axes are right to 1e-6 rad only (it stops turning when the next turn is smaller than that). Throws
    std::runtime_error with link and remedy where the tensor of a link that a joint moves belongs to no body. */
    void sharpenInertia();

    /** A point mass [kg] more on a link, at `place` in the link's frame [m]. */
    void addPointMass(const std::string& link, double mass, const Eigen::Vector3d& place);

    int size() const { return model_->nv; }
    std::string jointName(int i) const { return mj_id2name(model_.get(), mjOBJ_JOINT, i); }

    /** M, b, gravity, and as the tool's pose that of link `tool`; no Jacobian. Joints in MuJoCo's order. */
    Dynamics calc(const JointVector& q, const JointVector& qd, const std::string& tool);

    mjModel& model() { return *model_; }
    mjData& data() { return *data_; }
    /** After a change of model(): what MuJoCo derives from it. */
    void update() { mj_setConst(model_.get(), data_.get()); }

private:
    /** @param tensor  about the centre of mass, in the body's axes */
    void setTensor(int body, const Eigen::Matrix3d& tensor);

    struct Free {
        void operator()(mjModel* model) const { mj_deleteModel(model); }
        void operator()(mjData* data) const { mj_deleteData(data); }
    };
    void placeShapes(const std::vector<MujocoShape>& shapes);
    std::string urdf_;
    std::vector<int> geoms_;
    std::unique_ptr<mjModel, Free> model_;
    std::unique_ptr<mjData, Free> data_;
};

/** The robot's URDF as it stands in its folder; of a description that comes from no folder, one written from it.
Throws Error (BadInput). */
std::string findUrdf(const RobotDescription& robot);

}  // namespace viable
