#include "NewRobot.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <sstream>

#include "Commands.h"
#include "Scaffold.h"
#include "core/Text.h"
#include "draft/RobotDraft.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

/** The hand of hand.yaml moves at most this share of the reach in a second; its slowest reach takes so many times the
fastest; so many of these fit into a run. */
constexpr double kHandSpeed = 0.3, kSlowest = 2.8;
/** Linear damping is written as friction that saturates: with the saturating velocity so many times the limit it is within
5 % of it. */
constexpr double kLinearReach = 10.0;
constexpr double kSlowestReach_s = 100.0;  // what generated_hand_motion takes
constexpr double kReaches = 5.0;
constexpr double kShortestRun_s = 10.0;
/** A tool that cannot be moved in so many directions, or not so far [m], follows no hand. */
constexpr int kFewestDirections = 3;
constexpr double kShortestReach = 0.05;

/** As a configuration file takes it; the shortest text that reads back to the same double. */
std::string formatValue(double value) {
    if (std::isnan(value)) return kBlank;
    if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
    return detail::formatNumber(value);
}

std::string formatRounded(double value) {
    return detail::format("%.3g", value);
}

template <class Get>
std::string formatList(const std::vector<DraftJoint>& joints, const Get& get) {
    const auto isBlank = [&](const DraftJoint& joint) { return std::isnan(get(joint)); };
    if (std::all_of(joints.begin(), joints.end(), isBlank)) return kBlank;
    std::string text;
    for (const DraftJoint& joint : joints) text += (text.empty() ? "[" : ", ") + formatValue(get(joint));
    return text + "]";
}

/** A name of the URDF on one line of a file. */
std::string formatName(std::string name) {
    for (char& c : name)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
    return name;
}

std::string quoteForYaml(const std::string& text) {
    std::string quoted;
    for (const char c : formatName(text)) quoted += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    return "\"" + quoted + "\"";
}

std::string joinNames(const std::vector<std::string>& names) {
    std::string text;
    for (const std::string& name : names) detail::addItem(text, formatName(name));
    return text;
}

/** A key or an item of a YAML list; in quotes where it could be read as something else than text. */
std::string formatKey(const std::string& name) {
    const auto isPlain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; };
    const bool isWord = !name.empty() && std::isalpha(static_cast<unsigned char>(name[0])) != 0 && name.size() > 3 &&
                        std::all_of(name.begin(), name.end(), isPlain);
    for (const char* special : {"true", "false", "null", kBlank})
        if (name == special) return quoteForYaml(name);
    return isWord ? name : quoteForYaml(name);  // short words may be `no`, `yes`, `off`
}

std::string formatPoint(const Eigen::Vector3d& p) {
    return "[" + formatValue(p.x()) + ", " + formatValue(p.y()) + ", " + formatValue(p.z()) + "]";
}

/** `links` of collision.yaml: a blank where there is nothing to draft from. */
std::string makeCapsules(const std::vector<DraftLink>& links) {
    std::string text, bare;
    for (const DraftLink& link : links) {
        if (!link.lostMeshes.empty()) {
            text += "\n  # not read: " + joinNames(link.lostMeshes) + "\n  " + formatKey(link.name) + ": " + kBlank;
            continue;
        }
        if (link.capsules.empty()) {
            detail::addItem(bare, formatName(link.name));
            continue;
        }
        text += "\n  " + formatKey(link.name) + ":";
        for (const DraftCapsule& c : link.capsules)
            text += "\n    - {from: " + formatPoint(c.from) + ", to: " + formatPoint(c.to) +
                    ", radius: " + formatValue(c.radius) + "}";
    }
    if (text.empty()) return std::string(" ") + kBlank;
    return bare.empty() ? text : text + "\n  # without a shape in the URDF: " + bare;
}

/** `may_touch` of collision.yaml. */
std::string makeContacts(const std::vector<DraftContact>& contacts) {
    std::string text;
    for (const DraftContact& contact : contacts)
        text += "\n  - [" + formatKey(contact.first) + ", " + formatKey(contact.second) + "]  # " +
                (contact.isDoubtful ? "LOOK: " : "") + contact.reason;
    return text.empty() ? " []" : text;
}

/** The rules by which a figure was assumed; none: `otherwise`. */
std::string makeSource(const RobotDraft& draft, const std::string& figure, const std::string& otherwise) {
    std::string rules;
    for (const DraftAssumption& assumption : draft.assumptions)
        if (assumption.figure == figure) detail::addItem(rules, "assumption: " + formatName(assumption.rule), "; ");
    return rules.empty() ? otherwise : rules;
}

/** `assumed` of limits.yaml or actuation.yaml. */
std::string makeAssumed(const RobotDraft& draft, const std::map<std::string, std::string>& keys) {
    std::string list, rules;
    for (const DraftAssumption& assumption : draft.assumptions) {
        const auto key = keys.find(assumption.figure);
        if (key == keys.end()) continue;
        detail::addItem(list, key->second);
        rules += "\n#   " + key->second + ": " + assumption.rule;
    }
    if (list.empty()) return {};
    return "\n# Nobody gave these figures; runs say so. When you know one, write it above and take its key out of the "
           "list:" +
           rules + "\nassumed: [" + list + "]\n";
}

/** A comment for the URDF; two hyphens in it would end it. */
std::string makeRepairComment(const std::vector<std::string>& repairs) {
    std::string text;
    for (const std::string& repair : repairs) text += "  " + formatName(repair) + "\n";
    for (const auto& [from, to] : {std::pair(" --", " option "), {"--", "- -"}})
        for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos;)
            text.replace(at, std::strlen(from), to);
    return "<!-- Changed from the file given:\n" + text + "-->\n";
}

/** The repaired document, with a word on each change; a declaration stays the first thing in the file. */
std::string makeUrdf(const RobotDraft& draft) {
    if (draft.repairs.empty()) return draft.urdf;
    const std::size_t declaration = draft.urdf.compare(0, 5, "<?xml") == 0 ? draft.urdf.find("?>") : std::string::npos;
    const std::size_t at = declaration == std::string::npos ? 0 : declaration + 2;
    return draft.urdf.substr(0, at) + (at > 0 ? "\n" : "") + makeRepairComment(draft.repairs) +
           draft.urdf.substr(draft.urdf[at] == '\n' ? at + 1 : at);
}

/** `limits` for the first run: its command needs ends of travel, also of joints without limits. */
std::string makeRunLimits(const std::vector<DraftJoint>& joints) {
    const auto isEndless = [](const DraftJoint& j) { return std::isinf(j.positionUpper); };
    if (std::none_of(joints.begin(), joints.end(), isEndless)) return {};
    const auto lower = [&](const DraftJoint& j) { return isEndless(j) ? j.home - M_PI : j.positionLower; };
    const auto upper = [&](const DraftJoint& j) { return isEndless(j) ? j.home + M_PI : j.positionUpper; };
    return "# random_steps takes its positions from the range of each joint; those without limits get one "
           "here.\nlimits:\n  position_rad:\n    lower: " +
           formatList(joints, lower) + "\n    upper: " + formatList(joints, upper) + "\n";
}

/** Whether collision.yaml is whole, so that runs can read it. */
bool hasCapsules(const RobotDraft& draft) {
    bool any = false;
    for (const DraftLink& link : draft.links) {
        if (!link.lostMeshes.empty()) return false;
        any = any || !link.capsules.empty();
    }
    return any;
}

std::map<std::string, std::string> makeReplacements(const NewRobotArguments& arguments, const RobotDraft& draft) {
    const auto list = [&](double DraftJoint::*member) {
        return formatList(draft.joints, [&](const DraftJoint& j) { return j.*member; });
    };
    std::vector<std::string> names;
    for (const DraftJoint& joint : draft.joints) names.push_back(joint.name);
    const bool isAssumed = !draft.assumptions.empty();
    const char* const known = draft.isModel ? "the MuJoCo model given" : "TODO";
    const auto saturates = [](const DraftJoint& j) { return j.damping == 0.0 ? 1.0 : kLinearReach * j.velocity; };
    return {
        {"NAME", arguments.name},
        {"URDF", formatName(fs::path(arguments.file()).filename().string())},
        {"COUNT", names.size() == 1 ? "One moving joint" : std::to_string(names.size()) + " moving joints"},
        {"JOINTS", joinNames(names)},
        {"POSITION_LOWER", list(&DraftJoint::positionLower)},
        {"POSITION_UPPER", list(&DraftJoint::positionUpper)},
        {"VELOCITY", list(&DraftJoint::velocity)},
        {"EFFORT", list(&DraftJoint::effort)},
        {"HOME", list(&DraftJoint::home)},
        {"ACCELERATION", list(&DraftJoint::acceleration)},
        {"JERK", list(&DraftJoint::jerk)},
        {"ROTOR", list(&DraftJoint::rotorInertia)},
        {"COULOMB", list(&DraftJoint::coulomb)},
        {"GEAR", isAssumed || draft.isModel ? "1" : kBlank},
        {"VISCOUS", draft.isModel
                        ? formatList(draft.joints, [&](const DraftJoint& j) { return j.damping * saturates(j); })
                        : std::string(isAssumed ? "0" : kBlank)},
        {"VISCOUS_VELOCITY",
         draft.isModel ? formatList(draft.joints, saturates) : std::string(isAssumed ? "1" : kBlank)},
        {"ASSUMED_LIMITS", makeAssumed(draft, {{"position limits", "position_rad"},
                                               {"velocity limits", "velocity_radps"},
                                               {"acceleration limits", "acceleration_radps2"},
                                               {"jerk limits", "jerk_radps3"},
                                               {"home_rad", "home_rad"},
                                               {"tool_link", "tool_link"}})},
        {"ASSUMED_ACTUATION", makeAssumed(draft, {{"torque limits", "torque_limit_Nm"},
                                                  {"rotor_inertia_kgm2", "rotor_inertia_kgm2"},
                                                  {"friction", "friction"}})},
        {"SOURCE_MASS", makeSource(draft, "mass", draft.hasBodies ? "TODO" : "none: it takes positions")},
        {"SOURCE_INERTIA", makeSource(draft, "inertia", "TODO")},
        {"SOURCE_ACCELERATION", makeSource(draft, "acceleration limits", "TODO")},
        {"SOURCE_JERK", makeSource(draft, "jerk limits", "TODO")},
        {"SOURCE_ROTOR", makeSource(draft, "rotor_inertia_kgm2", known)},
        {"SOURCE_FRICTION", makeSource(draft, "friction", known)},
        {"SOURCE_HOME", makeSource(draft, "home_rad", draft.hasHome ? "its keyframe `home`" : "TODO")},
        {"TOOL", draft.tool.empty() ? std::string(kBlank) : quoteForYaml(draft.tool)},
        {"TOOL_CHOICE", draft.toolLinks.size() == 1 ? "Any moving link is possible."
                                                    : "The robot ends in several: " + joinNames(draft.toolLinks)},
        {"REACH", formatRounded(draft.task.reach * DraftTask::kHandShare)},
        {"TOP_SPEED", formatRounded(draft.task.reach * kHandSpeed)},
        {"REAL_ARM", draft.hasBodies ? "robust_loop: {plugin: nric}\nreal_plant: {plugin: simbody}\n" : ""},
        {"TORQUE_SHARE", draft.hasBodies ? ", torque_share: 0.9" : ""},
        {"HAND_ENVIRONMENT",
         hasCapsules(draft) ? "environment: {safety_distance_m: 0}  # the run tells when links touch\n" : ""},
        {"FASTEST", formatValue(draft.task.fastest)},
        {"SLOWEST", formatRounded(std::min(draft.task.fastest * kSlowest, kSlowestReach_s))},
        {"DURATION", formatValue(std::max(kShortestRun_s, std::ceil(draft.task.fastest * kSlowest * kReaches)))},
        {"ROTATION", draft.task.toolJoints >= 6 ? "0.3" : "0"},
        {"SAFETY", formatValue(draft.task.safety)},
        {"BALL_RADIUS", formatValue(draft.task.radius)},
        {"BALL", formatPoint(draft.task.ball)},
        {"PAST_BALL", formatPoint(draft.task.pastBall)},
        {"MESHES", draft.meshes.empty()
                       ? "The URDF names no meshes; the report draws its boxes, cylinders and spheres."
                       : "Pictures: the report draws a mesh when its file lies in this folder or below, "
                         "under "
                         "the end of the path by which the URDF names it, such as `meshes/`. The URDF names "
                         "`" +
                             joinNames(draft.meshes) + "`. Check their licence."},
        {"RUN_LIMITS", makeRunLimits(draft.joints)},
        {"CAPSULES", makeCapsules(draft.links)},
        {"MAY_TOUCH", makeContacts(draft.contacts)},
    };
}

/** Whether the placeholder stands in a line as a word of its own, not in quotes. */
bool holdsBlank(const std::string& line) {
    const auto isPart = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '"'; };
    const std::size_t length = std::strlen(kBlank);
    for (std::size_t at = 0; (at = line.find(kBlank, at)) != std::string::npos; at += length)
        if ((at == 0 || !isPart(line[at - 1])) && (at + length >= line.size() || !isPart(line[at + length])))
            return true;
    return false;
}

/** Every line of `text` that holds a blank, with its key. */
std::string listBlanks(const std::string& file, const std::string& text) {
    std::istringstream lines(text);
    std::string line, list;
    for (int number = 1; std::getline(lines, line); ++number) {
        const std::string value = line.substr(0, line.find('#'));
        if (!holdsBlank(value)) continue;
        list += "  " + file + ":" + std::to_string(number) + ": " + value.substr(value.find_first_not_of(' ')) + "\n";
    }
    return list;
}

void printBlankFiles(const fs::path& target, const FolderFiles& files) {
    std::string blanks;
    for (const char* name : {"limits.yaml", "actuation.yaml", "collision.yaml"})
        blanks += listBlanks((target / name).string(), files.at(name));
    if (!blanks.empty())
        std::printf("To be filled in (the comments in the files say how to find each):\n%s", blanks.c_str());
}

void printAssumptions(const RobotDraft& draft) {
    if (draft.assumptions.empty()) return;
    std::printf("Assumed, because the URDF does not say it; every run counts it, --details names it:\n");
    for (const DraftAssumption& assumption : draft.assumptions)
        std::printf("  %s: %s\n", makePrintable(assumption.figure).c_str(), makePrintable(assumption.rule).c_str());
}

void printHomeContacts(const std::vector<DraftContact>& contacts) {
    const auto isDoubtful = [](const DraftContact& contact) { return contact.isDoubtful; };
    if (std::none_of(contacts.begin(), contacts.end(), isDoubtful)) return;
    std::printf(
        "Links that touch at the home pose, or nearly; collision.yaml lets them, marked LOOK. Are the capsules too "
        "wide, or is "
        "the "
        "pose wrong?\n");
    for (const DraftContact& contact : contacts)
        if (contact.isDoubtful)
            std::printf("  %s and %s %s\n", formatName(contact.first).c_str(), formatName(contact.second).c_str(),
                        contact.reason.c_str());
}

}  // namespace

void writeRobot(const NewRobotArguments& arguments) {
    checkNewName(arguments.name, "robot", false);
    const std::string& given = arguments.file();
    const char* const option = arguments.mjcf.empty() ? "--urdf" : "--mjcf";
    if (given.empty())
        throw badInput("new robot", "the robot's URDF is missing",
                       "Add --urdf FILE.urdf, or --mjcf FILE.xml; limits and actuation are begun from it.");
    if (!arguments.urdf.empty() && !arguments.mjcf.empty())
        throw badInput("new robot", "there are two files, of --urdf and of --mjcf", "Leave one out.");
    std::error_code failed;
    if (!fs::exists(given, failed)) throw badInput(option, "there is no file " + given, "Check the path.");
    if (!fs::is_regular_file(given, failed))
        throw badInput(option, given + " is not a file", "Give the robot's file itself.");
    for (const fs::path& folder : listRobots(makeRobotSearchPath({})))
        if (folder.filename() == arguments.name)
            throw badInput("new robot",
                           "there is already a robot `" + arguments.name + "`: " + folder.lexically_normal().string(),
                           "Experiments would find only one of them: choose another name, such as "
                           "`my_" +
                               arguments.name + "`.");
    const fs::path target = fs::path(arguments.out) / arguments.name;
    checkNewFolder(target);
    const RobotDraft draft =
        readRobotDraft(given, {{arguments.base, arguments.tip, arguments.fixed, arguments.at},
                               arguments.assumes,
                               !arguments.isMassless,
                               arguments.mjcf.empty() ? fs::path() : findShared("mjcf_to_urdf.py").lexically_normal()});
    const std::map<std::string, std::string> replacements = makeReplacements(arguments, draft);
    FolderFiles files = fillTemplate(getTemplates() / "robot", replacements);
    const bool canFollow = draft.task.directions >= kFewestDirections && draft.task.reach > kShortestReach;
    if (canFollow) files.merge(fillTemplate(getTemplates() / "robot_hand", replacements));
    const bool hasBall = hasCapsules(draft) && draft.task.radius > 0.0;
    if (canFollow && hasBall) files.merge(fillTemplate(getTemplates() / "robot_obstacles", replacements));
    files[arguments.name + ".urdf"] = makeUrdf(draft);
    if (!draft.hasBodies)
        files["actuation.yaml"] = "schema: 1\n# " + arguments.name +
                                  " takes positions; its masses and motors are not known. With `viable new robot` and "
                                  "without\n# --without-masses they are.\ndynamics: none\n";
    writeNewFolder(target, files);

    for (const std::string& repair : draft.repairs)
        std::fprintf(stderr, "viable: repaired: %s\n", makePrintable(repair).c_str());
    for (const std::string& warning : draft.warnings)
        std::fprintf(stderr, "viable: warning: %s\n", makePrintable(warning).c_str());
    std::printf("viable: wrote %s:", target.c_str());
    for (const auto& file : files) std::printf(" %s", file.first.c_str());
    std::printf("\n");
    printAssumptions(draft);
    printHomeContacts(draft.contacts);
    printBlankFiles(target, files);
    if (arguments.assumes && !canFollow)
        std::printf("No hand.yaml: the tool cannot be moved in three directions.\n");
    else if (arguments.assumes && !hasBall)
        std::printf(
            "No obstacles.yaml: the URDF has no shapes, meshes were not found (see collision.yaml), or there is no "
            "room for "
            "a ball where a hand leads the tool.\n");
    if (draft.tool.empty() && draft.toolLinks.size() > 1)
        std::printf(
            "The robot ends in several links: --tip LINK takes the chain to one of them and freezes the rest.\n");
    if (!draft.meshes.empty())
        std::printf("To draw the robot, the report needs %zu mesh file%s in the folder: see its README.md\n",
                    draft.meshes.size(), draft.meshes.size() == 1 ? "" : "s");
    const bool hasFolder = arguments.out.find('/') != std::string::npos || target.is_absolute();
    const std::string path = (hasFolder ? "" : "./") + target.string();
    const std::string program = getProgramWord();
    std::printf("Then:\n  %s robots --describe %s\n", program.c_str(), showPath(path).c_str());
    for (const char* name : {"first_run.yaml", "hand.yaml", "obstacles.yaml"})
        if (files.count(name) > 0) std::printf("  %s run %s\n", program.c_str(), showPath(target / name).c_str());
}

}  // namespace viable
