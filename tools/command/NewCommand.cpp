#include <CLI/CLI.hpp>

#include "Commands.h"
#include "NewRobot.h"
#include "Scaffold.h"
#include "host/PluginLoader.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

constexpr const char* kUsage =
    "Write `viable new KIND NAME`; KIND is filter, controller, robust_loop, command, plant or robot.";

struct NewArguments : NewRobotArguments {  // a plugin has a name and a folder, too
    std::string kind;
};

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
        std::printf("  cmake --install %s --prefix ~/viable   # a project of its own needs viable installed\n",
                    showPath(prefix).c_str());
        program = "~/viable/bin/viable";
        option = " -DCMAKE_PREFIX_PATH=$HOME/viable";  // a shell leaves ~ alone there
    } else {
        std::printf("  # viable's CMake package is not below %s: install its development files first\n",
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

void writeNewFolder(const NewArguments& arguments) {
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
    const std::pair<const char*, bool> robotOptions[] = {
        {"--urdf", !arguments.urdf.empty()}, {"--mjcf", !arguments.mjcf.empty()},
        {"--base", !arguments.base.empty()}, {"--tip", !arguments.tip.empty()},
        {"--fix", !arguments.fixed.empty()}, {"--at", !arguments.at.empty()},
        {"--assume", arguments.assumes},     {"--without-masses", arguments.isMassless}};
    for (const auto& [option, isGiven] : robotOptions)
        if (isGiven)
            throw badInput("new " + arguments.kind, std::string(option) + " is for robots only",
                           "Leave it out, or write `viable new robot " + arguments.name + " --urdf " +
                               (arguments.urdf.empty() ? "FILE" : arguments.urdf) + "`.");
    for (const PluginKind kind : kPluginKinds)
        if (arguments.kind == getName(kind)) writePlugin(kind, arguments);
}

}  // namespace

void addNewCommand(CLI::App& app, int&) {
    auto arguments = std::make_shared<NewArguments>();
    CLI::App* command =
        app.add_subcommand("new", "Write a plugin's project or a robot's folder, to begin one of your own");
    command->add_option("KIND", arguments->kind, "filter, controller, robust_loop, command, plant or robot");
    command->add_option("NAME", arguments->name, "Name in snake_case; the folder gets it, too");
    command->add_option("--urdf", arguments->urdf, "Robots: the URDF file to begin from");
    command->add_option("--mjcf", arguments->mjcf,
                        "Robots: a MuJoCo model in place of a URDF, read by python3 and its package mujoco. Only for "
                        "files that you trust");
    command->add_option("--base", arguments->base, "Robots: joints that do not hang on this link are frozen");
    command->add_option(
        "--tip", arguments->tip,
        "Robots: the tool's link; joints that do not carry it are frozen. auto: that of the longest arm");
    command
        ->add_option("--fix", arguments->fixed,
                     "Robots: JOINT or JOINT=VALUE [rad, m] to freeze; may be given several times")
        ->allow_extra_args(false);
    command
        ->add_option("--at", arguments->at,
                     "Robots: JOINT=VALUE [rad, m], where a joint is that another option freezes")
        ->allow_extra_args(false);
    command->add_flag("--assume", arguments->assumes,
                      "Robots: assume what a URDF does not hold or holds wrongly, and say so, for a first run at once. "
                      "Only for files that you trust: xacro, which expands them, evaluates their expressions");
    command->add_flag(
        "--without-masses", arguments->isMassless,
        "Robots: of a robot that takes positions: no masses and motors, so what needs torques is refused");
    command->add_option("--out", arguments->out,
                        "Folder for the new folder; created where it is missing (default: the current one)");
    command->callback([arguments] { writeNewFolder(*arguments); });
}

}  // namespace viable
