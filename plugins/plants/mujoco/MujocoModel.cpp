#include "MujocoModel.h"

#include <urdf_parser/urdf_parser.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <mutex>
#include <sstream>

namespace viable {

namespace {

/** MuJoCo's own answer is to end the process; it must not be returned to. */
[[noreturn]] void throwError(const char* message) {
    throw std::runtime_error(std::string("MuJoCo: ") + message);
}

void dropWarning(const char*) {}

/** More places that touch at one time have no room. */
constexpr std::size_t kMostContacts = 100;
/** The links that carry shapes. */
constexpr char kShapeLink[] = "shapes of all links";

/** The stack [doubles] is for a step of an arm: of a hundred joints it were still enough without contacts. */
std::string writeSizes(const std::vector<MujocoShape>& shapes) {
    const auto fixed = static_cast<std::size_t>(
        std::count_if(shapes.begin(), shapes.end(), [](const MujocoShape& shape) { return shape.link.empty(); }));
    const std::size_t pairs = fixed * (shapes.size() - fixed);
    const std::size_t contacts = std::clamp<std::size_t>(2 * pairs, 1, kMostContacts);  // a capsule lies on two points
    return "<size njmax=\"" + std::to_string(64 + 3 * contacts) + "\" nconmax=\"" + std::to_string(contacts) +
           "\" nstack=\"" + std::to_string(100000 + 10000 * contacts) + "\"/>";
}

/** Removes all elements of that name; comments must be gone. */
void removeElements(std::string& xml, const std::string& name) {
    const std::string opening = "<" + name;
    std::size_t at = 0;
    while ((at = xml.find(opening, at)) != std::string::npos) {
        if (std::string(" \t\r\n/>").find(xml[at + opening.size()]) == std::string::npos) {
            at += opening.size();  // a longer name
            continue;
        }
        std::size_t end = xml.find('>', at);
        if (end != std::string::npos && xml[end - 1] != '/') {
            end = xml.find("</" + name, end);
            end = xml.find('>', end);
        }
        if (end == std::string::npos) return;  // MuJoCo says what is wrong with it
        xml.erase(at, end + 1 - at);
    }
}

void removeComments(std::string& xml) {
    std::size_t at = 0;
    while ((at = xml.find("<!--", at)) != std::string::npos) {
        const std::size_t end = xml.find("-->", at);
        if (end == std::string::npos) return;
        xml.erase(at, end + 3 - at);
    }
}

std::string writeNumbers(const Eigen::Vector3d& v) {
    std::ostringstream text;
    text.precision(17);
    text << v.x() << ' ' << v.y() << ' ' << v.z();
    return text.str();
}

std::string writeOrigin(const Eigen::Isometry3d& placement) {
    const Eigen::Vector3d yawPitchRoll = placement.linear().eulerAngles(2, 1, 0);
    return "<origin xyz=\"" + writeNumbers(placement.translation()) + "\" rpy=\"" +
           writeNumbers(yawPitchRoll.reverse()) + "\"/>";
}

/** Balls, which placeShapes() makes what they are. They are on links of their own, those of the surroundings on a root
before the robot's. */
std::string writeShapes(const std::vector<MujocoShape>& shapes, const std::string& root) {
    const std::string ball = "<collision><geometry><sphere radius=\"1\"/></geometry></collision>";
    std::string links, around;
    const auto join = [&](const std::string& parent, const std::string& child) {
        links += "<joint name=\"" + child + "\" type=\"fixed\"><parent link=\"" + parent + "\"/><child link=\"" +
                 child + "\"/></joint>";
    };
    for (std::size_t k = 0; k < shapes.size(); ++k) {
        const std::string name = kShapeLink + std::to_string(k);
        if (shapes[k].link.empty()) {
            around += ball;
        } else {
            links += "<link name=\"" + name + "\">" + ball + "</link>";
            join(shapes[k].link, name);
        }
    }
    join(kShapeLink, root);
    return std::string("<link name=\"") + kShapeLink + "\">" + around + "</link>" + links;
}

/** The description as a URDF: kinematics and masses. */
std::string writeUrdf(const RobotDescription& robot) {
    std::ostringstream text;
    text.precision(17);
    text << "<robot name=\"" << robot.name << "\"><link name=\"base of all joints\"/>";
    for (const JointDescription& joint : robot.joints) {
        const BodyInertia& body = joint.body;
        const Eigen::Matrix3d& I = body.inertia;
        text << "<link name=\"" << joint.childLink << "\"><inertial><origin xyz=\"" << writeNumbers(body.com)
             << "\"/><mass value=\"" << body.mass << "\"/><inertia ixx=\"" << I(0, 0) << "\" ixy=\"" << I(0, 1)
             << "\" ixz=\"" << I(0, 2) << "\" iyy=\"" << I(1, 1) << "\" iyz=\"" << I(1, 2) << "\" izz=\"" << I(2, 2)
             << "\"/></inertial></link>";
        const std::string parent = joint.parent < 0 ? "base of all joints" : robot.joints[joint.parent].childLink;
        text << "<joint name=\"" << joint.name << "\" type=\""
             << (joint.type == JointType::Prismatic ? "prismatic" : "continuous") << "\">"
             << writeOrigin(joint.placement) << "<parent link=\"" << parent << "\"/><child link=\"" << joint.childLink
             << "\"/><axis xyz=\"" << writeNumbers(joint.axis)
             << "\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/></joint>";
    }
    const std::string& carrier = robot.joints[robot.toolParent].childLink;
    if (robot.toolLink != carrier)
        text << "<link name=\"" << robot.toolLink << "\"/><joint name=\"tool of all joints\" type=\"fixed\">"
             << writeOrigin(robot.toolPlacement) << "<parent link=\"" << carrier << "\"/><child link=\""
             << robot.toolLink << "\"/></joint>";
    text << "</robot>";
    return text.str();
}

/** MuJoCo's complaint in one sentence that begins with the link, where MuJoCo names one in a second line. */
std::string describeError(const std::string& text) {
    const std::size_t end = text.find('\n');
    const std::string first = "MuJoCo: " + text.substr(0, end), before = "Object name = ";
    const std::size_t named = text.find(before);
    if (named == std::string::npos) return first;
    const std::size_t begin = named + before.size();
    return "link `" + text.substr(begin, text.find(',', begin) - begin) + "`: " + first;
}

/** Of a link. Small violations are let through: MuJoCo computes with them as they stand. */
void checkTensor(const std::string& link, const Eigen::Matrix3d& tensor) {
    constexpr double kSmall = 0.05;  // of the largest moment
    const Eigen::Vector3d moments =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(tensor, Eigen::EigenvaluesOnly).eigenvalues();
    if (moments[2] <= moments[0] + moments[1] + kSmall * moments[2]) return;
    char text[300];
    std::snprintf(text, sizeof text,
                  ": the inertia tensor belongs to no body: of its principal moments %.6g, %.6g and %.6g kg m^2 the "
                  "largest is above the sum of the other two. Correct its <inertia>, the tensor about the link's "
                  "centre of mass.",
                  moments[0], moments[1], moments[2]);
    throw std::runtime_error("link `" + link + "`" + text);
}

}  // namespace

std::string findUrdf(const RobotDescription& robot) {
    if (robot.folder.empty()) return writeUrdf(robot);
    const std::filesystem::path file = robot.folder / (robot.name + ".urdf");
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream text;
    text << stream.rdbuf();
    if (!stream || text.str().empty())
        throw badInput(file.string(), "the URDF cannot be read", "MuJoCo reads it by itself.");
    return text.str();
}

MujocoModel::MujocoModel(const std::string& urdf, const std::vector<MujocoShape>& shapes) : urdf_(urdf) {
    static std::once_flag areHandlersSet;  // they are the process's, and cases run side by side
    std::call_once(areHandlersSet, [] {
        mju_user_error = throwError;
        mju_user_warning = dropWarning;
    });

    std::string xml = urdf;
    removeComments(xml);
    for (const char* const ignored : {"visual", "collision", "mujoco"}) removeElements(xml, ignored);
    if (!shapes.empty()) {
        const urdf::ModelInterfaceSharedPtr links = urdf::parseURDF(urdf);
        const std::size_t end = xml.rfind("</robot");
        if (!links || !links->getRoot() || end == std::string::npos) throw std::runtime_error("urdfdom refuses it");
        xml.insert(end, writeShapes(shapes, links->getRoot()->name));
    }
    // Links behind fixed joints stay bodies, so that the tool's pose can be asked for; masses come from <inertial> only.
    // Balancing: the tensors of links that no joint moves do not count, however wrong; those of others are checked below.
    const std::size_t robot = xml.find("<robot");
    const std::size_t root = robot == std::string::npos ? robot : xml.find('>', robot);
    if (root == std::string::npos) throw std::runtime_error("the text holds no <robot>");
    xml.insert(root + 1, std::string("<mujoco><compiler fusestatic=\"false\" discardvisual=\"true\" "
                                     "inertiafromgeom=\"false\" balanceinertia=\"true\"/>") +
                             writeSizes(shapes) + "</mujoco>");

    const char* const name = "robot.urdf";
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    mj_makeEmptyFileVFS(files.get(), name, static_cast<int>(xml.size()));
    xml.copy(static_cast<char*>(files->filedata[mj_findFileVFS(files.get(), name)]), xml.size());
    char error[1000] = "";
    model_.reset(mj_loadXML(name, files.get(), error, sizeof error));
    mj_deleteVFS(files.get());
    if (!model_) throw std::runtime_error(describeError(error));

    mjModel& m = *model_;
    std::fill(m.jnt_limited, m.jnt_limited + m.njnt, mjtByte{0});
    std::fill(m.dof_damping, m.dof_damping + m.nv, 0.0);
    std::fill(m.dof_frictionloss, m.dof_frictionloss + m.nv, 0.0);
    m.opt.disableflags |= (shapes.empty() ? mjDSBL_CONTACT : 0) | mjDSBL_LIMIT | mjDSBL_WARMSTART;
    placeShapes(shapes);
    data_.reset(mj_makeData(&m));
    if (!data_) throw std::runtime_error("MuJoCo has no memory for it");
}

void MujocoModel::placeShapes(const std::vector<MujocoShape>& shapes) {
    mjModel& m = *model_;
    if (const int around = mj_name2id(&m, mjOBJ_BODY, kShapeLink); around > 0) {
        // To MuJoCo's world: it would find each contact with a half-space on another body twice.
        std::swap(m.body_geomnum[0], m.body_geomnum[around]);
        std::swap(m.body_geomadr[0], m.body_geomadr[around]);
    }
    int ofWorld = 0;
    for (std::size_t k = 0; k < shapes.size(); ++k) {
        const MujocoShape& shape = shapes[k];
        const bool isAround = shape.link.empty();
        const int body = isAround ? 0 : mj_name2id(&m, mjOBJ_BODY, (kShapeLink + std::to_string(k)).c_str());
        const int before = isAround ? ofWorld++ : 0;  // shapes of the same body
        if (body < 0 || m.body_geomnum[body] <= before) throw std::runtime_error("MuJoCo left a shape out");
        const int geom = m.body_geomadr[body] + before;
        geoms_.push_back(geom);
        m.geom_bodyid[geom] = body;
        m.geom_type[geom] = shape.type;
        m.geom_sameframe[geom] = 0;
        Eigen::Map<Eigen::Vector3d>(m.geom_size + 3 * geom) = shape.size;
        Eigen::Map<Eigen::Vector3d>(m.geom_pos + 3 * geom) = shape.pose.translation();
        const Eigen::Quaterniond turned(shape.pose.linear());
        const double quaternion[4] = {turned.w(), turned.x(), turned.y(), turned.z()};
        std::copy(quaternion, quaternion + 4, m.geom_quat + 4 * geom);
        const double radius = shape.size.x(), half = shape.size.y();
        m.geom_rbound[geom] = shape.type == mjGEOM_PLANE      ? 0.0
                              : shape.type == mjGEOM_CAPSULE  ? radius + half
                              : shape.type == mjGEOM_CYLINDER ? std::hypot(radius, half)
                              : shape.type == mjGEOM_BOX      ? shape.size.norm()
                                                              : radius;
        m.geom_contype[geom] = !isAround;
        m.geom_conaffinity[geom] = isAround;
        m.geom_margin[geom] = m.geom_gap[geom] = 0.0;
    }
}

void MujocoModel::sharpenInertia() {
    const urdf::ModelInterfaceSharedPtr links = urdf::parseURDF(urdf_);
    if (!links) throw std::runtime_error("urdfdom refuses it");
    for (const auto& [name, link] : links->links_) {
        const int body = mj_name2id(model_.get(), mjOBJ_BODY, name.c_str());
        if (body < 0 || !link->inertial) continue;  // the root is part of MuJoCo's world, the tool has no mass
        const urdf::Inertial& from = *link->inertial;
        Eigen::Matrix3d tensor;
        tensor << from.ixx, from.ixy, from.ixz, from.ixy, from.iyy, from.iyz, from.ixz, from.iyz, from.izz;
        const urdf::Rotation& r = from.origin.rotation;
        const Eigen::Matrix3d placed = Eigen::Quaterniond(r.w, r.x, r.y, r.z).toRotationMatrix();
        if (model_->body_weldid[body] != 0) checkTensor(name, tensor);
        setTensor(body, placed * tensor * placed.transpose());
    }
    update();
}

void MujocoModel::setTensor(int body, const Eigen::Matrix3d& tensor) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> principal(tensor);
    Eigen::Matrix3d axes = principal.eigenvectors();
    if (axes.determinant() < 0.0) axes.col(0) *= -1.0;
    const Eigen::Quaterniond turned(axes);
    const double quaternion[4] = {turned.w(), turned.x(), turned.y(), turned.z()};
    std::copy(quaternion, quaternion + 4, model_->body_iquat + 4 * body);
    Eigen::Map<Eigen::Vector3d>(model_->body_inertia + 3 * body) = principal.eigenvalues();
    model_->body_sameframe[body] = 0;
}

void MujocoModel::addPointMass(const std::string& link, double mass, const Eigen::Vector3d& place) {
    if (mass == 0.0) return;
    const int body = mj_name2id(model_.get(), mjOBJ_BODY, link.c_str());
    if (body < 0) throw std::runtime_error("MuJoCo knows no link " + link);
    double& carried = model_->body_mass[body];
    Eigen::Map<Eigen::Vector3d> com(model_->body_ipos + 3 * body);
    const double* w = model_->body_iquat + 4 * body;
    const Eigen::Matrix3d axes = Eigen::Quaterniond(w[0], w[1], w[2], w[3]).toRotationMatrix();
    const Eigen::Map<const Eigen::Vector3d> principal(model_->body_inertia + 3 * body);
    Eigen::Matrix3d tensor = axes * principal.asDiagonal() * axes.transpose();
    // Two bodies about their common centre of mass: the reduced mass at their distance.
    const Eigen::Vector3d d = place - com;
    tensor += carried * mass / (carried + mass) * (d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose());
    com += mass / (carried + mass) * d;
    carried += mass;
    setTensor(body, tensor);
    update();
}

Dynamics MujocoModel::calc(const JointVector& q, const JointVector& qd, const std::string& tool) {
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

}  // namespace viable
