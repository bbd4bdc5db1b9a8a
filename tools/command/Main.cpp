#include <CLI/CLI.hpp>
#include <cctype>
#include <cstdlib>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>
#include <sstream>

#include "Commands.h"
#include "CrashHandler.h"
#include "Progress.h"
#include "StopSignals.h"
#include "core/ErrorParts.h"
#include "core/Text.h"
#include "records/WorkShare.h"

namespace viable {

std::vector<std::filesystem::path> makeRobotSearchPath(const std::filesystem::path& experiment) {
    namespace fs = std::filesystem;
    std::vector<fs::path> path;
    if (const char* variable = std::getenv("VIABLE_ROBOT_PATH")) {
        std::istringstream folders(variable);
        for (std::string folder; std::getline(folders, folder, ':');)
            if (!folder.empty()) path.push_back(folder);
    }
    path.push_back("robots");
    std::error_code error;
    if (!experiment.empty()) {
        path.push_back(experiment.parent_path() / ".." / "robots");
        const fs::path own = fs::absolute(experiment).lexically_normal().parent_path();
        if (fs::exists(own / (own.filename().string() + ".urdf"), error)) path.push_back(own.parent_path());
    }
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    if (!error) path.push_back(program.parent_path() / ".." / "share" / "viable" / "robots");
    return path;
}

}  // namespace viable

namespace {

// An exit code beside those of viable::ErrorKind, as sysexits.h numbers them.
constexpr int kOutOfMemory = 71;

int tell(const viable::Error& e) {
    if (viable::areMessagesJson()) {
        const viable::ErrorParts parts = viable::getParts(e);
        const nlohmann::json error = {
            {"place", parts.place}, {"cause", parts.cause}, {"remedy", parts.remedy}, {"kind", e.exitCode()}};
        std::fprintf(
            stderr, "%s\n",
            nlohmann::json{{"error", error}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    } else {
        std::fprintf(stderr, "viable: %s\n", e.what());
    }
    return e.exitCode();
}

std::vector<std::string> listOptions(const CLI::App& command) {
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options())
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    return names;
}

/** Words that a command does not take. Those behind an option that it does not have may be that option's value. */
std::string describeExtras(const std::vector<std::string>& words, const CLI::App& command) {
    std::string text;
    for (const std::string& word : words) {
        if (word.size() < 2 || word[0] != '-' || std::isdigit(static_cast<unsigned char>(word[1]))) continue;
        const std::string name = word.substr(0, word.find('='));
        const std::string closest = viable::findClosestName(name, listOptions(command));
        viable::detail::addItem(text,
                                "there is no option `" + viable::makePrintable(name) + "`" +
                                    (closest.empty() ? "" : ", did you mean `" + closest + "`?"),
                                "; ");
    }
    if (!text.empty()) return text;
    std::string extra;
    for (const std::string& word : words) viable::detail::addItem(extra, "`" + viable::makePrintable(word) + "`");
    return extra + (words.size() == 1 ? " is" : " are") + " more than it takes";
}

std::string explain(const CLI::App* app, const CLI::Error& e) {
    const std::vector<CLI::App*> chosen = app->get_subcommands();
    if (chosen.empty()) return std::string("viable: ") + e.what() + ". `viable --help` shows the commands.\n";
    const CLI::App& command = *chosen.front();
    const bool hasExtras = dynamic_cast<const CLI::ExtrasError*>(&e) != nullptr;
    const std::string text = hasExtras ? describeExtras(app->remaining(true), command) : e.what();
    return "viable: " + command.get_name() + ": " + text + (text.back() == '?' ? "" : ".") + " `viable " +
           command.get_name() + " --help` shows what it takes.\n";
}

int tellUnexpected(const std::exception& e) {
    std::fprintf(stderr, "viable: unexpected: %s. Please report this.\n", e.what());
    return viable::kUnexpected;
}

/** Long work that knows how far it is, other than runs and sweeps, which show themselves. */
void showWork(const char* what, double share) {
    static std::string shown;
    static std::unique_ptr<viable::Progress> progress;
    if (shown != what) {
        progress = std::make_unique<viable::Progress>(std::vector<std::string>{what});
        shown = what;
    }
    progress->set(0, share);
    progress->draw();
}

}  // namespace

int main(int argc, char** argv) {
    CLI::App app{"viable - joint limits up to jerk for torque-controlled manipulators", "viable"};
    app.set_version_flag("--version", std::string("viable ") + VIABLE_VERSION);
    app.require_subcommand(1);
    app.failure_message(explain);
    int exitCode = 0;
    for (const auto add :
         {viable::addRunCommand, viable::addLiveCommand, viable::addSweepCommand, viable::addCheckCommand,
          viable::addBoundCommand, viable::addPluginsCommand, viable::addSchemaCommand, viable::addRobotsCommand,
          viable::addGainsCommand, viable::addExportCommand, viable::addColumnsCommand, viable::addRecoverCommand,
          viable::addReportCommand, viable::addVerifyCommand, viable::addIdentifyCommand, viable::addNewCommand,
          viable::addRobotCommand, viable::addDoctorCommand})
        add(app, exitCode);
    if (argc > 1 && argv[1][0] != '-') {
        std::vector<std::string> names;
        for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
        if (std::find(names.begin(), names.end(), argv[1]) == names.end()) {
            const std::string closest = viable::findClosestName(argv[1], names);
            std::fprintf(stderr, "viable: there is no command `%s`%s `viable --help` shows them.\n", argv[1],
                         closest.empty() ? "." : (", did you mean `" + closest + "`?").c_str());
            return static_cast<int>(viable::ErrorKind::BadInput);
        }
    }
    viable::WorkShare::show = showWork;
    viable::installCrashHandler({});  // before the first library is loaded
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& e) {
        return app.exit(e) == 0 ? 0 : static_cast<int>(viable::ErrorKind::BadInput);
    } catch (const viable::Error& e) {
        const int code = tell(e);
        const int signal = viable::getStopSignal();  // who waited for something was told to stop
        return signal != 0 && e.kind() == viable::ErrorKind::BadInput ? 128 + signal : code;
    } catch (const std::bad_alloc&) {
        std::fprintf(stderr,
                     "viable: out of memory. Close other programs, raise the limit (`ulimit -v`), or give it less at a "
                     "time: fewer --jobs, a shorter run, a part of the record.\n");
        return kOutOfMemory;
    } catch (const std::filesystem::filesystem_error& e) {
        std::error_code failed;
        if (!std::filesystem::current_path(failed).empty()) return tellUnexpected(e);
        std::fprintf(stderr,
                     "viable: the current folder cannot be found: %s. It was deleted or moved, or may not be read: "
                     "`cd` to one that is there.\n",
                     failed.message().c_str());
        return static_cast<int>(viable::ErrorKind::BadInput);
    } catch (const std::exception& e) {
        return tellUnexpected(e);
    }
    if (std::fflush(stdout) != 0 || std::ferror(stdout)) {
        std::fprintf(stderr, "viable: the output could not be written (disk full or pipe closed)\n");
        if (exitCode == 0) exitCode = static_cast<int>(viable::ErrorKind::LogNotWritten);
    }
    return exitCode;
}
