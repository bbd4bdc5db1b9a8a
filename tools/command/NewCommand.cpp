#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <sstream>

#include "Commands.h"
#include "Scaffold.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "robot/RobotDraft.h"
#include "viable/config/ConfigNode.h"
#include "viable/core/Error.h"
#include "viable/host/PluginLoader.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

constexpr const char* kUsage =
    "Write `viable new KIND NAME`; KIND is filter, controller, robust_loop, command, plant or "
    "robot.";

struct NewArguments {
    std::string kind, name, urdf, out;
};

// ---------------------------------------------------------------------------------- the program

fs::path getProgram() {
    std::error_code failed;
    return fs::read_symlink("/proc/self/exe", failed);
}

fs::path getTemplates() {
    return (getProgram().parent_path() / ".." / "share" / "viable" / "templates").lexically_normal();
}

/** How the user starts this program: `viable` where the PATH leads to it. */
std::string getProgramWord() {
    const fs::path program = getProgram();
    if (const char* variable = std::getenv("PATH")) {
        std::istringstream folders(variable);
        std::error_code failed;
        for (std::string folder; std::getline(folders, folder, ':');)
            if (fs::exists(fs::path(folder) / "viable", failed))
                return fs::equivalent(fs::path(folder) / "viable", program, failed)
                           ? "viable"
                           : detail::quoteForShell(program.string());
    }
    return detail::quoteForShell(program.string());
}

/** The path as a user in the current folder would write it. */
std::string showPath(const fs::path& path) {
    return detail::quoteForShell(path.string());
}

// -------------------------------------------------------------------------------------- plugins

void printPluginSteps(const fs::path& target) {
    const fs::path prefix = getProgram().parent_path().parent_path();
    std::error_code failed;
    const bool isInstalled =
        fs::exists(prefix / VIABLE_INSTALL_LIBDIR / "cmake" / "viable" / "viableConfig.cmake", failed);
    std::string program = getProgramWord(), option;
    std::printf("Next:\n");
    if (isInstalled) {
        if (prefix != "/usr" && prefix != "/usr/local") option = " -DCMAKE_PREFIX_PATH=" + showPath(prefix);
    } else if (fs::exists(prefix / "CMakeCache.txt", failed)) {
        std::printf(
            "  cmake --install %s --prefix ~/viable   # a project of its own needs viable "
            "installed\n",
            showPath(prefix).c_str());
        program = "~/viable/bin/viable";
        option = " -DCMAKE_PREFIX_PATH=$HOME/viable";  // a shell leaves ~ alone there
    } else {
        std::printf(
            "  # viable's CMake package is not below %s: install its development files "
            "first\n",
            prefix.c_str());
    }
    std::printf(
        "  cd %s\n"
        "  cmake -S . -B build%s\n"
        "  cmake --build build\n"
        "  ctest --test-dir build --output-on-failure\n"
        "  export VIABLE_PLUGIN_PATH=$PWD/build/bin/plugins\n"
        "  %s run experiment.yaml\n",
        showPath(target).c_str(), option.c_str(), program.c_str());
}

void writePlugin(PluginKind kind, const NewArguments& arguments) {
    checkNewName(arguments.name, arguments.kind, true);
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
    std::vector<RefusedLibrary> refused;
    for (const PluginInfo& plugin : loader.list(refused))
        if (plugin.kind == kind && plugin.name == arguments.name)
            throw badInput(
                "new " + arguments.kind,
                "there is already a " + arguments.kind + " `" + arguments.name + "`: " + plugin.library.string(),
                "Two of one name cannot be told apart: choose another, such as `my_" + arguments.name + "`.");
    const fs::path target = fs::path(arguments.out) / arguments.name;
    checkNewFolder(target);
    const std::map<std::string, std::string> replacements = {
        {"NAME", arguments.name}, {"CLASS", makeClassName(arguments.name)}, {"KIND", arguments.kind}};
    FolderFiles files = fillTemplate(getTemplates() / "common", replacements);
    files.merge(fillTemplate(getTemplates() / arguments.kind, replacements));
    writeNewFolder(target, files);
    std::printf("viable: wrote %s:", target.c_str());
    for (const auto& file : files) std::printf(" %s", file.first.c_str());
    std::printf("\n");
    printPluginSteps(target);
}

// --------------------------------------------------------------------------------------- robots

/** As a configuration file takes it; the shortest text that reads back to the same double. */
std::string formatValue(double value) {
    if (std::isnan(value)) return kBlank;
    if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
    return detail::formatNumber(value);
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
        text += "\n  - [" + formatKey(contact.first) + ", " + formatKey(contact.second) + "]  # " + contact.reason;
    return text.empty() ? " []" : text;
}

/** `limits` for the first run: its command needs ends of travel, also of joints without limits. */
std::string makeRunLimits(const std::vector<DraftJoint>& joints) {
    const auto isEndless = [](const DraftJoint& j) { return std::isinf(j.positionUpper); };
    if (std::none_of(joints.begin(), joints.end(), isEndless)) return {};
    const auto lower = [&](const DraftJoint& j) { return isEndless(j) ? j.home - M_PI : j.positionLower; };
    const auto upper = [&](const DraftJoint& j) { return isEndless(j) ? j.home + M_PI : j.positionUpper; };
    return "# random_steps takes its positions from the range of each joint; those "
           "without limits get one here.\nlimits:\n  position_rad:\n    lower: " +
           formatList(joints, lower) + "\n    upper: " + formatList(joints, upper) + "\n";
}

std::map<std::string, std::string> makeReplacements(const NewArguments& arguments, const RobotDraft& draft) {
    const auto list = [&](double DraftJoint::*member) {
        return formatList(draft.joints, [&](const DraftJoint& j) { return j.*member; });
    };
    std::vector<std::string> names;
    for (const DraftJoint& joint : draft.joints) names.push_back(joint.name);
    const bool hasOneTool = draft.toolLinks.size() == 1;
    return {
        {"NAME", arguments.name},
        {"URDF", formatName(fs::path(arguments.urdf).filename().string())},
        {"COUNT", names.size() == 1 ? "One moving joint" : std::to_string(names.size()) + " moving joints"},
        {"JOINTS", joinNames(names)},
        {"POSITION_LOWER", list(&DraftJoint::positionLower)},
        {"POSITION_UPPER", list(&DraftJoint::positionUpper)},
        {"VELOCITY", list(&DraftJoint::velocity)},
        {"EFFORT", list(&DraftJoint::effort)},
        {"HOME", list(&DraftJoint::home)},
        {"TOOL", hasOneTool ? quoteForYaml(draft.toolLinks.front()) : std::string(kBlank)},
        {"TOOL_CHOICE",
         hasOneTool ? "Any moving link is possible." : "The robot ends in several: " + joinNames(draft.toolLinks)},
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

/** Prints every line of `text` that holds a blank, with its key. */
void printBlanks(const std::string& file, const std::string& text) {
    std::istringstream lines(text);
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
        const std::string value = line.substr(0, line.find('#'));
        if (value.find(kBlank) == std::string::npos) continue;
        const std::size_t key = value.find_first_not_of(' ');
        std::printf("  %s:%d: %s\n", file.c_str(), number, value.substr(key).c_str());
    }
}

void writeRobot(const NewArguments& arguments) {
    checkNewName(arguments.name, "robot", false);
    if (arguments.urdf.empty())
        throw badInput("new robot", "the robot's URDF is missing",
                       "Add --urdf FILE.urdf; limits and actuation are begun from it.");
    std::error_code failed;
    if (!fs::exists(arguments.urdf, failed))
        throw badInput("--urdf", "there is no file " + arguments.urdf, "Check the path.");
    if (!fs::is_regular_file(arguments.urdf, failed))
        throw badInput("--urdf", arguments.urdf + " is not a file", "Give the URDF file itself.");
    for (const fs::path& folder : listRobots(makeRobotSearchPath({})))
        if (folder.filename() == arguments.name)
            throw badInput("new robot",
                           "there is already a robot `" + arguments.name + "`: " + folder.lexically_normal().string(),
                           "Experiments would find only one of them: choose another name, such as "
                           "`my_" +
                               arguments.name + "`.");
    const fs::path target = fs::path(arguments.out) / arguments.name;
    checkNewFolder(target);
    const RobotDraft draft = readRobotDraft(arguments.urdf);
    FolderFiles files = fillTemplate(getTemplates() / "robot", makeReplacements(arguments, draft));
    const std::optional<std::string> urdf = readWhole(arguments.urdf);
    if (!urdf) throw badInput(arguments.urdf, "the file cannot be read", "Check its permissions.");
    files[arguments.name + ".urdf"] = *urdf;
    writeNewFolder(target, files);

    for (const std::string& warning : draft.warnings) std::fprintf(stderr, "viable: warning: %s\n", warning.c_str());
    std::printf("viable: wrote %s:", target.c_str());
    for (const auto& file : files) std::printf(" %s", file.first.c_str());
    std::printf("\nTo be filled in (the comments in the files say how to find each):\n");
    for (const char* name : {"limits.yaml", "actuation.yaml", "collision.yaml"})
        printBlanks((target / name).string(), files[name]);
    if (!draft.meshes.empty())
        std::printf("To draw the robot, the report needs %zu mesh file%s in the folder: see its README.md\n",
                    draft.meshes.size(), draft.meshes.size() == 1 ? "" : "s");
    const bool hasFolder = arguments.out.find('/') != std::string::npos || target.is_absolute();
    const std::string path = (hasFolder ? "" : "./") + target.string();
    const std::string program = getProgramWord();
    std::printf("Then:\n  %s robots --describe %s\n  %s run %s\n", program.c_str(), showPath(path).c_str(),
                program.c_str(), showPath(target / "first_run.yaml").c_str());
}

void writeNew(const NewArguments& arguments) {
    std::vector<std::string> kinds = {"robot"};
    for (const PluginKind kind : kPluginKinds) kinds.emplace_back(getName(kind));
    if (arguments.kind.empty()) throw badInput("new", "the kind is missing", kUsage);
    if (std::find(kinds.begin(), kinds.end(), arguments.kind) == kinds.end()) {
        const std::string closest = findClosestName(arguments.kind, kinds);
        throw badInput("new", "there is no kind `" + arguments.kind + "`",
                       (closest.empty() ? "" : "Did you mean `" + closest + "`? ") + std::string(kUsage));
    }
    if (arguments.name.empty())
        throw badInput(
            "new " + arguments.kind, "the name is missing",
            "Write `viable new " + arguments.kind + " NAME" + (arguments.kind == "robot" ? " --urdf FILE`." : "`."));
    if (arguments.kind == "robot") return writeRobot(arguments);
    if (!arguments.urdf.empty())
        throw badInput(
            "new " + arguments.kind, "--urdf is for robots only",
            "Leave it out, or write `viable new robot " + arguments.name + " --urdf " + arguments.urdf + "`.");
    for (const PluginKind kind : kPluginKinds)
        if (arguments.kind == getName(kind)) writePlugin(kind, arguments);
}

}  // namespace

void addNewCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<NewArguments>();
    CLI::App* command =
        app.add_subcommand("new", "Write a plugin's project or a robot's folder, to begin one of your own");
    command->add_option("KIND", arguments->kind, "filter, controller, robust_loop, command, plant or robot");
    command->add_option("NAME", arguments->name, "Name in snake_case; the folder gets it, too");
    command->add_option("--urdf", arguments->urdf, "Robots: the URDF file to begin from");
    command->add_option("--out", arguments->out,
                        "Folder for the new folder; created where it is missing "
                        "(default: the current one)");
    command->callback([arguments, &exitCode] {
        writeNew(*arguments);
        exitCode = 0;
    });
}

}  // namespace viable
