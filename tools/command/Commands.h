#pragma once

#include <filesystem>
#include <vector>

namespace CLI {
class App;
}

namespace viable {

/** Each adds one subcommand to the program; its callback does the work, may throw Error, and leaves
the exit code in `exitCode`, which is 0 before. One file per subcommand. */
void addRunCommand(CLI::App& app, int& exitCode);
void addLiveCommand(CLI::App& app, int& exitCode);
void addSweepCommand(CLI::App& app, int& exitCode);
void addCheckCommand(CLI::App& app, int& exitCode);
void addBoundCommand(CLI::App& app, int& exitCode);
void addPluginsCommand(CLI::App& app, int& exitCode);
void addSchemaCommand(CLI::App& app, int& exitCode);
void addRobotsCommand(CLI::App& app, int& exitCode);
void addGainsCommand(CLI::App& app, int& exitCode);
void addExportCommand(CLI::App& app, int& exitCode);
void addColumnsCommand(CLI::App& app, int& exitCode);
void addRecoverCommand(CLI::App& app, int& exitCode);
void addReportCommand(CLI::App& app, int& exitCode);
void addVerifyCommand(CLI::App& app, int& exitCode);
void addIdentifyCommand(CLI::App& app, int& exitCode);
void addNewCommand(CLI::App& app, int& exitCode);
void addRobotCommand(CLI::App& app, int& exitCode);
void addDoctorCommand(CLI::App& app, int& exitCode);

/** Folders searched for robots: VIABLE_ROBOT_PATH (colon-separated), `robots` in the current folder
and beside the experiment's folder, the experiment's own folder where that is a robot's, then the installed ones. @param experiment  may be empty */
std::vector<std::filesystem::path> makeRobotSearchPath(const std::filesystem::path& experiment);

/** What is installed beside the program, in share/viable: a folder, or the page of a report or of a live arm. */
std::filesystem::path findShared(const char* name);
inline constexpr char kReportPage[] = "report_template.html", kSweepPage[] = "sweep_template.html",
                      kLivePage[] = "live.html";

}  // namespace viable
