#include "robot/urdf/UrdfReader.h"

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <sstream>

#include "core/Text.h"
#include "robot/RigidBody.h"
#include "robot/urdf/UrdfChecks.h"

namespace viable::detail {

namespace {

/** Collects what urdfdom says, which goes to the console otherwise. */
class CapturedMessages : public console_bridge::OutputHandler {
public:
    CapturedMessages() : lock_(mutex_) {
        previousLevel_ = console_bridge::getLogLevel();
        console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_WARN);
        previous_ = console_bridge::getOutputHandler();
        console_bridge::useOutputHandler(this);
    }
    ~CapturedMessages() override {
        console_bridge::useOutputHandler(previous_);
        console_bridge::setLogLevel(previousLevel_);
    }
    CapturedMessages(const CapturedMessages&) = delete;
    CapturedMessages& operator=(const CapturedMessages&) = delete;

    void log(const std::string& text, console_bridge::LogLevel, const char*, int) override {
        addItem(text_, text, "; ");
    }
    const std::string& text() const { return text_; }

private:
    static inline std::mutex mutex_;  // the handler is one per process
    std::lock_guard<std::mutex> lock_;
    console_bridge::OutputHandler* previous_;
    console_bridge::LogLevel previousLevel_;
    std::string text_;
};

Eigen::Isometry3d toEigen(const urdf::Pose& pose) {
    double x, y, z, w;
    pose.rotation.getQuaternion(x, y, z, w);
    Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
    result.linear() = Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
    result.translation() << pose.position.x, pose.position.y, pose.position.z;
    return result;
}

class UrdfFileReader {
public:
    explicit UrdfFileReader(UrdfDocument& document)
        : document_(document), tree_(document), model_(parse(document.print())) {}

    UrdfRobot read() {
        UrdfRobot robot;
        const auto n = std::count_if(tree_.joints.begin(), tree_.joints.end(),
                                     [](const UrdfTree::Joint& joint) { return joint.isMoving; });
        for (JointBounds* bounds : {&robot.position, &robot.velocity}) {
            bounds->lower.resize(n);
            bounds->upper.resize(n);
        }
        robot.effort.setZero(n);
        robot.links[model_->getRoot()->name] = {};
        // Fixed joints as soon as their parent has its place, then the first moving one of the file that can.
        std::set<std::pair<bool, int>> ready;
        const auto addReady = [&](int link) {
            for (const int j : tree_.links[link].joints) ready.emplace(tree_.joints[j].isMoving, j);
        };
        addReady(tree_.find.at(model_->getRoot()->name));
        while (!ready.empty()) {
            const UrdfTree::Joint& joint = tree_.joints[ready.begin()->second];
            ready.erase(ready.begin());
            add(*model_->getJoint(joint.name), document_.place(*joint.element), robot.links.at(joint.parent), robot);
            addReady(joint.childLink);
        }
        addBodies(robot);
        for (const UrdfTree::Link& link : tree_.links)
            if (link.joints.empty()) robot.leafLinks.push_back(link.name);
        std::map<std::string, std::string> assumed;  // names, by what of them
        const auto addAssumed = [&](const XmlElement& element, const std::string& name) {
            std::istringstream words(getAttribute(&element, kAssumed));
            for (std::string what; words >> what;) addItem(assumed[makePrintable(what)], makePrintable(name));
        };
        for (const UrdfTree::Joint& joint : tree_.joints) addAssumed(*joint.element, joint.name);
        for (const UrdfTree::Link& link : tree_.links) addAssumed(*link.element, link.name);
        for (const auto& [what, names] : assumed) robot.assumed.push_back(what + " (" + names + ")");
        return robot;
    }

private:
    urdf::ModelInterfaceSharedPtr parse(const std::string& text) {
        CapturedMessages messages;
        std::string remark;
        urdf::ModelInterfaceSharedPtr model;
        try {
            model = urdf::parseURDF(text);
        } catch (const std::exception& error) {
            remark = error.what();
        }
        if (!model) {
            if (!messages.text().empty()) remark = messages.text();
            throw badInput(document_.file(), "this is not a usable URDF: " + remark,
                           "Correct the file; `check_urdf` shows the tree it describes.");
        }
        return model;
    }

    void add(const urdf::Joint& joint, const std::string& place, const UrdfRobot::LinkPlace& parent, UrdfRobot& robot) {
        const Eigen::Isometry3d placement = parent.placement * toEigen(joint.parent_to_joint_origin_transform);
        const bool isFixed = joint.type == urdf::Joint::FIXED;
        const int index = static_cast<int>(robot.joints.size());
        robot.links[joint.child_link_name] = {isFixed ? parent.carrier : index,
                                              isFixed ? placement : Eigen::Isometry3d::Identity()};
        if (isFixed) return;
        JointDescription description;
        description.name = joint.name;
        description.childLink = joint.child_link_name;
        description.type = joint.type == urdf::Joint::PRISMATIC    ? JointType::Prismatic
                           : joint.type == urdf::Joint::CONTINUOUS ? JointType::Continuous
                                                                   : JointType::Revolute;
        description.parent = parent.carrier;
        description.placement = placement;
        description.axis << joint.axis.x, joint.axis.y, joint.axis.z;
        description.axis.normalize();

        const bool isLimited = joint.type != urdf::Joint::CONTINUOUS;
        const bool hasVelocity = joint.limits && (isLimited || joint.limits->velocity != 0.0);
        robot.position.lower[index] = isLimited ? joint.limits->lower : -kInfinity;
        robot.position.upper[index] = isLimited ? joint.limits->upper : kInfinity;
        robot.velocity.upper[index] = hasVelocity ? joint.limits->velocity : kInfinity;
        robot.velocity.lower[index] = -robot.velocity.upper[index];
        if (joint.limits) robot.effort[index] = joint.limits->effort;
        robot.joints.push_back(description);
        robot.jointPlaces.push_back(place);
        robot.parentLinks.push_back(joint.parent_link_name);
    }

    void addBodies(UrdfRobot& robot) const {
        for (const UrdfTree::Link& entry : tree_.links) {
            const urdf::Link& link = *model_->getLink(entry.name);
            const UrdfRobot::LinkPlace& place = robot.links.at(link.name);
            addShapes(link, place, robot);
            UrdfRobot::Link& itself = robot.bodies.emplace_back();
            itself.name = link.name;
            itself.place = document_.place(*entry.element);
            itself.carrier = place.carrier;
            for (const auto& joint : link.child_joints)
                itself.joints.push_back(toEigen(joint->parent_to_joint_origin_transform).translation());
            if (!link.inertial || itself.carrier < 0) continue;
            itself.hasInertial = true;
            itself.body = readBody(*link.inertial);
            BodyInertia& body = robot.joints[itself.carrier].body;
            body = mergeBodies(body, transformBody(place.placement, itself.body));
        }
        ErrorList errors;
        for (const JointDescription& joint : robot.joints) {
            if (!document_.hasBodies()) continue;
            const std::string fault = findInertiaFault(joint.body.inertia, true);
            if (!fault.empty())
                errors.add(document_.place(*tree_.links[tree_.find.at(joint.childLink)].element),
                           "link " + quoteName(joint.childLink) + ", moved by joint " + quoteName(joint.name) +
                               ", cannot be simulated: " + fault,
                           "Correct its <inertia>, and that of the links fixed to it.");
        }
        errors.throwIfAny(document_.file());
    }

    /** The link's visual and collision elements. What has no sensible size is left out. */
    static void addShapes(const urdf::Link& link, const UrdfRobot::LinkPlace& place, UrdfRobot& robot) {
        LinkShapes visual{link.name, place.carrier, place.placement, {}, {}}, collision = visual;
        const auto add = [](const urdf::GeometrySharedPtr& geometry, const urdf::Pose& origin, LinkShapes& to) {
            LinkShape shape;
            if (geometry && readShape(*geometry, shape)) {
                shape.pose = toEigen(origin);
                if (shape.pose.matrix().allFinite()) to.shapes.push_back(std::move(shape));
            }
        };
        for (const auto& element : link.visual_array) {
            add(element->geometry, element->origin, visual);
            if (!element->material) continue;
            const urdf::Color& c = element->material->color;
            visual.color = {c.r, c.g, c.b, c.a};
            visual.hasColor = true;
        }
        for (const auto& element : link.collision_array) add(element->geometry, element->origin, collision);
        if (visual.shapes.empty()) visual.shapes = collision.shapes;
        if (collision.shapes.empty()) collision.shapes = visual.shapes;
        if (visual.shapes.empty()) return;
        robot.shapes[link.name] = std::move(visual);
        robot.solids[link.name] = std::move(collision);
    }

    static bool readShape(const urdf::Geometry& geometry, LinkShape& shape) {
        const auto isSize = [](double x) { return std::isfinite(x) && x > 0.0; };
        switch (geometry.type) {
            case urdf::Geometry::SPHERE:
                shape.kind = LinkShape::Kind::Sphere;
                shape.radius = static_cast<const urdf::Sphere&>(geometry).radius;
                return isSize(shape.radius);
            case urdf::Geometry::BOX: {
                const urdf::Vector3& dim = static_cast<const urdf::Box&>(geometry).dim;
                shape.kind = LinkShape::Kind::Box;
                shape.size = {dim.x, dim.y, dim.z};
                return isSize(dim.x) && isSize(dim.y) && isSize(dim.z);
            }
            case urdf::Geometry::CYLINDER: {
                const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
                shape.kind = LinkShape::Kind::Cylinder;
                shape.radius = cylinder.radius;
                shape.length = cylinder.length;
                return isSize(shape.radius) && isSize(shape.length);
            }
            case urdf::Geometry::MESH: {
                const auto& mesh = static_cast<const urdf::Mesh&>(geometry);
                shape.kind = LinkShape::Kind::Mesh;
                shape.mesh = mesh.filename;
                shape.size = {mesh.scale.x, mesh.scale.y, mesh.scale.z};
                return !shape.mesh.empty() && shape.size.allFinite();
            }
        }
        return false;
    }

    static BodyInertia readBody(const urdf::Inertial& from) {
        BodyInertia body;
        body.mass = from.mass;
        body.inertia << from.ixx, from.ixy, from.ixz, from.ixy, from.iyy, from.iyz, from.ixz, from.iyz, from.izz;
        return transformBody(toEigen(from.origin), body);
    }

    UrdfDocument& document_;
    UrdfTree tree_;
    urdf::ModelInterfaceSharedPtr model_;
};

}  // namespace

UrdfRobot readUrdf(UrdfDocument& document, ErrorList errors) {
    checkUrdfElements(document, errors);
    errors.throwIfAny(document.file());
    return UrdfFileReader(document).read();
}

UrdfRobot readUrdf(const std::filesystem::path& file, bool hasBodies) {
    UrdfDocument document(file);
    if (!hasBodies) document.dropBodies();
    ErrorList errors;
    checkUrdfTree(document, errors);
    return readUrdf(document, errors);
}

}  // namespace viable::detail
