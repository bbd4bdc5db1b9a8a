#include "robot/UrdfReader.h"

#include <console_bridge/console.h>
#include <tinyxml.h>
#include <urdf_parser/urdf_parser.h>

#include <cmath>
#include <fstream>
#include <mutex>
#include <sstream>

#include "robot/RigidBody.h"
#include "viable/core/Error.h"
#include "viable/core/Numbers.h"

namespace viable::detail {

namespace {

std::string quote(const std::string& name) {
    return "`" + name + "`";
}

/** Collects what urdfdom says, which goes to the console otherwise. */
class CapturedMessages : public console_bridge::OutputHandler {
public:
    CapturedMessages() : lock_(mutex()) {
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
        if (!text_.empty()) text_ += "; ";
        text_ += text;
    }
    const std::string& text() const { return text_; }

private:
    /** The handler is one per process. */
    static std::mutex& mutex() {
        static std::mutex instance;
        return instance;
    }
    std::lock_guard<std::mutex> lock_;
    console_bridge::OutputHandler* previous_;
    console_bridge::LogLevel previousLevel_;
    std::string text_;
};

std::string readText(const std::filesystem::path& file) {
    std::error_code failed;
    const std::uintmax_t size = std::filesystem::file_size(file, failed);
    if (!failed && size > kMaxUrdfBytes)
        throw badInput(
            file.string(),
            "the file has " + std::to_string(size) + " bytes; at most " + std::to_string(kMaxUrdfBytes) + " are read",
            "A URDF names its meshes, it does not contain them; check the file.");
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream text;
    if (stream) text << stream.rdbuf();
    if (!stream || failed) throw badInput(file.string(), "the file cannot be read", "Check its permissions.");
    return text.str();
}

/** Refuses what the XML reader would crash on or cut off. */
void checkText(const std::string& text, const std::string& file) {
    if (text.find_first_not_of(" \t\r\n") == std::string::npos)
        throw badInput(file, "the file is empty", "A URDF file holds one <robot> element.");
    if (text.find('\0') != std::string::npos)
        throw badInput(file, "the file holds binary data", "A URDF file is XML text.");
    int depth = 0;
    for (std::size_t i = text.find('<'); i != std::string::npos; i = text.find('<', i + 1)) {
        if (text.compare(i, 4, "<!--") == 0) {
            i = text.find("-->", i);
            if (i == std::string::npos) break;
            continue;
        }
        const char next = i + 1 < text.size() ? text[i + 1] : '\0';
        if (next == '!' || next == '?') continue;
        if (next == '/') {
            --depth;
            continue;
        }
        const std::size_t end = text.find('>', i);
        if (end == std::string::npos || text[end - 1] != '/') ++depth;
        if (depth > kMaxUrdfDepth)
            throw badInput(file, "the elements are nested deeper than " + std::to_string(kMaxUrdfDepth) + " levels",
                           "Check that every element is closed.");
    }
}

/** The end of a message that goes on. */
std::string withoutPeriod(std::string text) {
    while (!text.empty() && text.back() == '.') text.pop_back();
    return text;
}

/** A joint or link of the file, in file order. */
struct Entry {
    std::string name;
    std::string place;
};

void refuseXacro(const TiXmlElement& element, const std::string& file) {
    bool isXacro = element.ValueStr().compare(0, 6, "xacro:") == 0;
    for (const TiXmlAttribute* a = element.FirstAttribute(); a && !isXacro; a = a->Next())
        isXacro = a->ValueStr().find("${") != std::string::npos || a->ValueStr().find("$(") != std::string::npos;
    if (isXacro)
        throw badInput(file + ":" + std::to_string(element.Row()) + ":" + std::to_string(element.Column()),
                       "this is xacro input, not URDF: <" + element.ValueStr() + "> still has to be expanded",
                       "Run `xacro INPUT.xacro > NAME.urdf` and use its output.");
    for (const TiXmlElement* child = element.FirstChildElement(); child; child = child->NextSiblingElement())
        refuseXacro(*child, file);
}

/** File order and lines, which urdfdom does not keep. */
struct Outline {
    std::vector<Entry> joints;
    std::vector<Entry> links;

    Outline(const std::string& text, const std::string& file) {
        TiXmlDocument document;
        document.Parse(text.c_str(), nullptr, TIXML_ENCODING_UTF8);
        if (document.Error())
            throw badInput(document.ErrorRow() > 0 ? file + ":" + std::to_string(document.ErrorRow()) + ":" +
                                                         std::to_string(document.ErrorCol())
                                                   : file,
                           "this is not XML: " + withoutPeriod(document.ErrorDesc()),
                           "Check that the file is complete and every element is closed.");
        const TiXmlElement* root = document.RootElement();
        if (!root || root->ValueStr() != "robot")
            throw badInput(file,
                           "the file's root is " + (root ? "<" + root->ValueStr() + ">" : std::string("missing")) +
                               ", not <robot>",
                           "Only URDF is read; convert other formats (SDF, MJCF) first.");
        refuseXacro(*root, file);
        for (const TiXmlElement* e = root->FirstChildElement("joint"); e; e = e->NextSiblingElement("joint"))
            checkLimit(*e, file);
        list(*root, "joint", file, joints);
        list(*root, "link", file, links);
    }

    static std::string place(const std::vector<Entry>& entries, const std::string& name) {
        for (const Entry& entry : entries)
            if (entry.name == name) return entry.place;
        return {};
    }

private:
    /** urdfdom refuses these, too, but does not say where. */
    static void checkLimit(const TiXmlElement& joint, const std::string& file) {
        const auto get = [&](const char* attribute) {
            const char* text = joint.Attribute(attribute);
            return std::string(text ? text : "");
        };
        const std::string type = get("type");
        const TiXmlElement* limit = joint.FirstChildElement("limit");
        std::string missing;
        if (!limit && (type == "revolute" || type == "prismatic")) missing = "<limit>";
        for (const char* attribute : {"effort", "velocity"})
            if (limit && !limit->Attribute(attribute)) missing = std::string("`") + attribute + "` in its <limit>";
        if (missing.empty()) return;
        throw badInput(file + ":" + std::to_string(joint.Row()) + ":" + std::to_string(joint.Column()),
                       "joint " + quote(get("name")) + " of type " + type + " has no " + missing,
                       "Write <limit lower=\"..\" upper=\"..\" effort=\"..\" velocity=\"..\"/>, with 0 "
                       "for an effort or a velocity that is not known: limits.yaml and "
                       "actuation.yaml give it then.");
    }

    static void list(const TiXmlElement& root, const char* tag, const std::string& file, std::vector<Entry>& entries) {
        for (const TiXmlElement* e = root.FirstChildElement(tag); e; e = e->NextSiblingElement(tag)) {
            const char* name = e->Attribute("name");
            const std::string place = file + ":" + std::to_string(e->Row()) + ":" + std::to_string(e->Column());
            if (!name || !*name)
                throw badInput(place, "the " + std::string(tag) + " has no name", "Add the attribute `name`.");
            entries.push_back({name, place});
        }
    }
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
    UrdfFileReader(const std::filesystem::path& path, const std::string& text)
        : file_(path.string()), outline_(text, file_), model_(parse(text)) {}

    UrdfRobot read() {
        checkTree();
        UrdfRobot robot;
        const int n = countMovingJoints();
        for (JointBounds* bounds : {&robot.position, &robot.velocity}) {
            bounds->lower.resize(n);
            bounds->upper.resize(n);
        }
        robot.effort.setZero(n);
        robot.links[model_->getRoot()->name] = {};
        std::vector<const Entry*> waiting;
        for (const Entry& entry : outline_.joints) waiting.push_back(&entry);
        // Fixed joints as soon as their parent has its place, then the first moving one that can.
        while (!waiting.empty()) {
            if (!addFirst(waiting, robot, true) && !addFirst(waiting, robot, false)) {
                const urdf::Joint& joint = *model_->getJoint(waiting.front()->name);
                throw badInput(waiting.front()->place,
                               "joint " + quote(joint.name) + " hangs on link " + quote(joint.parent_link_name) +
                                   ", which is not connected to the base link " + quote(model_->getRoot()->name),
                               "An arm is a tree of links: open the loop.");
            }
        }
        addBodies(robot);
        for (const Entry& link : outline_.links)
            if (model_->getLink(link.name)->child_joints.empty()) robot.leafLinks.push_back(link.name);
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
            throw badInput(file_, "this is not a usable URDF: " + remark,
                           "Correct the file; `check_urdf` shows the tree it describes.");
        }
        return model;
    }

    std::string jointPlace(const std::string& name) const { return Outline::place(outline_.joints, name); }
    std::string linkPlace(const std::string& name) const { return Outline::place(outline_.links, name); }

    void checkTree() const {
        std::map<std::string, std::string> parentJoint;
        for (const Entry& entry : outline_.joints) {
            const urdf::Joint& joint = *model_->getJoint(entry.name);
            const auto [other, isNew] = parentJoint.emplace(joint.child_link_name, joint.name);
            if (!isNew)
                throw badInput(entry.place,
                               "link " + quote(joint.child_link_name) + " is the child of two joints, " +
                                   quote(other->second) + " and " + quote(joint.name),
                               "An arm is a tree of links: open the loop.");
        }
    }

    int countMovingJoints() const {
        int n = 0;
        for (const Entry& entry : outline_.joints) {
            const urdf::Joint& joint = *model_->getJoint(entry.name);
            const auto refuse = [&](const std::string& what, const std::string& remedy) {
                return badInput(entry.place, "joint " + quote(joint.name) + " " + what, remedy);
            };
            const char* const kinds =
                "Supported are revolute, continuous, prismatic and fixed; replace it by such "
                "joints.";
            switch (joint.type) {
                case urdf::Joint::FIXED:
                    continue;
                case urdf::Joint::FLOATING:
                    throw refuse("is of type floating, but the base must be fixed", kinds);
                case urdf::Joint::PLANAR:
                    throw refuse("is of type planar", kinds);
                case urdf::Joint::REVOLUTE:
                case urdf::Joint::CONTINUOUS:
                case urdf::Joint::PRISMATIC:
                    break;
                default:
                    throw refuse("is of an unknown type", kinds);
            }
            if (joint.mimic)
                throw refuse(
                    "mimics joint " + quote(joint.mimic->joint_name) + ", but coupled joints are not supported",
                    "Make it fixed, or remove <mimic> to drive it by itself.");
            ++n;
        }
        if (n == 0)
            throw badInput(file_, "the robot has no moving joint",
                           "At least one revolute, continuous or prismatic joint is needed.");
        if (n > kMaxJoints)
            throw badInput(file_,
                           "the robot has " + std::to_string(n) + " moving joints; at most " +
                               std::to_string(kMaxJoints) + " are supported",
                           "Make joints that are not part of the arm fixed.");
        return n;
    }

    bool addFirst(std::vector<const Entry*>& waiting, UrdfRobot& robot, bool fixedOnes) {
        for (auto it = waiting.begin(); it != waiting.end(); ++it) {
            const urdf::Joint& joint = *model_->getJoint((*it)->name);
            if ((joint.type == urdf::Joint::FIXED) != fixedOnes) continue;
            const auto parent = robot.links.find(joint.parent_link_name);
            if (parent == robot.links.end()) continue;
            add(joint, (*it)->place, parent->second, robot);
            waiting.erase(it);
            return true;
        }
        return false;
    }

    void add(const urdf::Joint& joint, const std::string& place, const UrdfRobot::LinkPlace& parent, UrdfRobot& robot) {
        const Eigen::Isometry3d placement = parent.placement * toEigen(joint.parent_to_joint_origin_transform);
        if (!placement.matrix().allFinite())
            throw badInput(place, "the origin of joint " + quote(joint.name) + " is not finite",
                           "Correct its xyz and rpy.");
        if (joint.type == urdf::Joint::FIXED) {
            robot.links[joint.child_link_name] = {parent.carrier, placement};
            return;
        }
        const int index = static_cast<int>(robot.joints.size());
        JointDescription description;
        description.name = joint.name;
        description.childLink = joint.child_link_name;
        description.type = joint.type == urdf::Joint::PRISMATIC    ? JointType::Prismatic
                           : joint.type == urdf::Joint::CONTINUOUS ? JointType::Continuous
                                                                   : JointType::Revolute;
        description.parent = parent.carrier;
        description.placement = placement;
        description.axis << joint.axis.x, joint.axis.y, joint.axis.z;
        const double length = description.axis.norm();
        if (!std::isfinite(length) || length < kShortestAxis)
            throw badInput(place, "the axis of joint " + quote(joint.name) + " has no direction",
                           "Give <axis xyz=\"...\"/> a length, such as \"0 0 1\".");
        description.axis /= length;

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
        robot.links[joint.child_link_name] = {index, Eigen::Isometry3d::Identity()};
    }

    void addBodies(UrdfRobot& robot) const {
        for (const Entry& entry : outline_.links) {
            const urdf::Link& link = *model_->getLink(entry.name);
            const auto place = robot.links.find(link.name);
            if (place == robot.links.end())
                throw badInput(entry.place, "link " + quote(link.name) + " is not connected",
                               "Add the joint that carries it, or remove it.");
            addShapes(link, place->second, robot);
            UrdfRobot::Link& itself = robot.bodies.emplace_back();
            itself.name = link.name;
            itself.place = entry.place;
            itself.carrier = place->second.carrier;
            for (const auto& joint : link.child_joints)
                itself.joints.push_back(toEigen(joint->parent_to_joint_origin_transform).translation());
            if (!link.inertial || itself.carrier < 0) continue;
            itself.hasInertial = true;
            itself.body = readInertial(link);
            BodyInertia& body = robot.joints[itself.carrier].body;
            body = mergeBodies(body, transformBody(place->second.placement, itself.body));
        }
        for (const JointDescription& joint : robot.joints) {
            const std::string where = linkPlace(joint.childLink);
            const std::string what = "link " + quote(joint.childLink) + ", moved by joint " + quote(joint.name) + ", ";
            if (joint.body.mass <= 0.0)
                throw badInput(where, what + "has no mass",
                               "Give it an <inertial> element with mass and inertia, or make "
                               "the joint fixed.");
            const std::string fault = findInertiaFault(joint.body.inertia, true);
            if (!fault.empty())
                throw badInput(where, what + "cannot be simulated: " + fault,
                               "Correct its <inertia>, and that of the links fixed to it.");
        }
    }

    /** The link's visual and collision elements. What has no sensible size is left out. */
    static void addShapes(const urdf::Link& link, const UrdfRobot::LinkPlace& place, UrdfRobot& robot) {
        LinkShapes visual;
        visual.link = link.name;
        visual.carrier = place.carrier;
        visual.placement = place.placement;
        LinkShapes collision = visual;
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

    BodyInertia readInertial(const urdf::Link& link) const {
        const urdf::Inertial& from = *link.inertial;
        BodyInertia body;
        body.mass = from.mass;
        body.inertia << from.ixx, from.ixy, from.ixz, from.ixy, from.iyy, from.iyz, from.ixz, from.iyz, from.izz;
        const Eigen::Isometry3d origin = toEigen(from.origin);
        const std::string where = linkPlace(link.name);
        const std::string name = "link " + quote(link.name) + ": ";
        if (!std::isfinite(body.mass) || body.mass < 0.0)
            throw badInput(where, name + "the mass is " + std::to_string(body.mass) + " kg",
                           "A mass is zero or positive.");
        if (!body.inertia.allFinite() || !origin.matrix().allFinite())
            throw badInput(where, name + "the <inertial> element holds numbers that are not finite",
                           "Correct its origin and inertia.");
        if (body.mass == 0.0 && !body.inertia.isZero(0.0))
            throw badInput(where, name + "there is an inertia without a mass",
                           "Give the link its mass, or make all six inertia entries zero.");
        const std::string fault = findInertiaFault(body.inertia, false);
        if (!fault.empty())
            throw badInput(where, name + fault,
                           "Correct <inertia>: URDF takes the tensor about the centre of mass, "
                           "with ixy = -integral of x y dm; some CAD programs export the other "
                           "sign, or the tensor about the link's origin.");
        return transformBody(origin, body);
    }

    /** Shorter axes are a slip, and their direction is rounding. */
    static constexpr double kShortestAxis = 1e-6;

    std::string file_;
    Outline outline_;
    urdf::ModelInterfaceSharedPtr model_;
};

}  // namespace

UrdfRobot readUrdf(const std::filesystem::path& file) {
    const std::string text = readText(file);
    checkText(text, file.string());
    return UrdfFileReader(file, text).read();
}

}  // namespace viable::detail
