#include "RunFolder.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <system_error>

#include "Commands.h"
#include "CrashHandler.h"
#include "Progress.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "records/WorkShare.h"
#include "report/RunReport.h"

namespace viable {

namespace fs = std::filesystem;

static Error alreadyHolds(const fs::path& folder) {
    return badInput("--out " + folder.string(), "this folder already holds something",
                    "Name a new or empty folder; a run never overwrites another.");
}

/** Something that is no claim of a run. */
static bool holdsSomething(const fs::path& folder) {
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
        if (entry->path().filename() != kClaim) return true;
    return false;
}

void ignoreWriteSignals() {
    std::signal(SIGPIPE, SIG_IGN);  // a closed pipe is a write error, not a death
    std::signal(SIGXFSZ, SIG_IGN);  // so is a file size limit
}

FolderClaim::FolderClaim(const fs::path& folder) : file_(folder / kClaim) {
    lock_ = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (lock_ >= 0 && ::flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
        throw badInput("--out " + folder.string(), "another run or sweep writes into this folder",
                       "Name another folder.");
    const int claim = ::open(file_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (claim >= 0) ::close(claim);  // what stays open can, on other machines' disks, not be deleted
    if (claim < 0 && errno == EEXIST)
        throw badInput("--out " + folder.string(),
                       std::string("another run has this folder: its ") + kClaim + " is there",
                       "Name another folder. Only if that run was killed, delete " + file_.string() + ".");
    if (claim < 0)
        throw Error(ErrorKind::LogNotWritten, folder.string(),
                    "nothing can be written here: " + std::generic_category().message(errno),
                    "Name another place with --out DIR.");
    // A run that was quicker may have come and gone since the folder was looked at.
    if (!holdsSomething(folder)) return;
    ::unlink(file_.c_str());
    throw alreadyHolds(folder);
}

FolderClaim::~FolderClaim() {
    ::unlink(file_.c_str());
}

void requireFreeFolder(const fs::path& folder) {
    std::error_code error;
    const fs::file_status status = fs::status(folder, error);
    if (fs::exists(status) && !fs::is_directory(status))
        throw badInput("--out " + folder.string(), "this is not a folder", "Name a new or empty folder.");
    if (holdsSomething(folder)) throw alreadyHolds(folder);
}

fs::path makeRunFolder(const std::string& wanted, const fs::path& experiment) {
    std::error_code error;
    const auto notMade = [&](const std::string& where, const std::string& remedy) {
        return Error(ErrorKind::LogNotWritten, where, "cannot create the folder: " + error.message(), remedy);
    };
    if (!wanted.empty()) {
        requireFreeFolder(wanted);
        fs::create_directories(wanted, error);
        if (error) throw notMade("--out " + wanted, "Name another place.");
        return wanted;
    }
    constexpr char kRemedy[] = "Name another place with --out DIR.";
    char stamp[32];
    const std::time_t now = std::time(nullptr);
    std::strftime(stamp, sizeof stamp, "%Y%m%d-%H%M%S", std::localtime(&now));
    fs::create_directories("runs", error);
    if (error) throw notMade((fs::current_path() / "runs").string(), kRemedy);
    for (int i = 1; i < 1000; ++i) {
        const fs::path folder =
            fs::path("runs") / (experiment.stem().string() + "-" + stamp + (i > 1 ? "-" + std::to_string(i) : ""));
        if (fs::create_directory(folder, error)) return folder;
        if (error) throw notMade(folder.string(), kRemedy);
    }
    throw Error(ErrorKind::LogNotWritten, "runs", "too many runs in one second");
}

/** The case's name, in colour on a terminal, what it is and its sentence. */
static void tellSentence(const CaseResult& result, std::size_t width) {
    const CaseSentence sentence = tellCase(result);
    std::string text = "controller " + result.controller + ", filter " + result.filter;
    if (!result.realPlant.empty())
        text += result.robustLoop.empty() ? ", no robust loop" : ", robust loop " + result.robustLoop;
    text += ": " + sentence.text;
    const char* const colors[] = {"\033[32m", "\033[33m", "\033[31m", "\033[31m"};  // by gravity
    const bool isColored = hasColor(STDOUT_FILENO);
    const std::size_t begin = std::max(width, result.name.size()) + 1;
    std::printf("%s%s%s%*s%s\n", isColored ? colors[static_cast<int>(sentence.gravity)] : "", result.name.c_str(),
                isColored ? "\033[0m" : "", static_cast<int>(begin - result.name.size()), "",
                detail::wrap(text, width + 1, begin).c_str());
}

static void tellResult(const CaseResult& result, bool inFull, std::size_t width) {
    if (inFull)
        std::printf("%s\n", formatDetails(result).c_str());
    else
        tellSentence(result, width);
    std::fflush(stdout);  // both may go to one pipe
    if (result.exitCode() != 0 && !result.stopMessage.empty())
        std::fprintf(stderr, "viable: case %s %s\n%s%s", result.name.c_str(), result.stopMessage.c_str(),
                     result.stopRemedy.c_str(), result.stopRemedy.empty() ? "" : "\n");
    if (!result.logError.empty())
        std::fprintf(stderr,
                     "viable: case %s: the log could not be written to its end: %s. The run itself continued; free "
                     "space and run it again.\n",
                     result.name.c_str(), result.logError.c_str());
}

/** Each once, with the cases that have it, and where the rest is. */
static void tellWarnings(const std::vector<CaseResult>& results) {
    std::map<std::string, std::string> warnings;
    for (const CaseResult& result : results)
        for (const std::string& warning : result.warnings) detail::addItem(warnings[warning], result.name);
    for (const auto& [warning, names] : warnings)
        std::printf("%s\n", detail::wrap("WARNING (" + names + ") " + warning).c_str());
    std::printf("\nall figures, remedies and the ranking of filters: --details, or summary.json\n");
}

int tellResults(const std::vector<CaseResult>& results, bool inFull) {
    std::printf("\n%s\n", formatComparison(results).c_str());
    const std::string ranking = inFull ? formatRanking(results) : "";
    if (!ranking.empty()) std::printf("%s\n", ranking.c_str());
    int code = 0;
    std::size_t width = 0;
    for (const CaseResult& result : results) width = std::min<std::size_t>(24, std::max(width, result.name.size()));
    for (const CaseResult& result : results) {
        tellResult(result, inFull, width);
        if (const int own = result.exitCode(); isGraver(own, code)) code = own;
    }
    if (const std::string order = formatOrder(results); !order.empty())
        std::printf("\n%s\n", detail::wrap(order).c_str());
    if (inFull)
        std::printf("\n%s", kAccountLegend);
    else
        tellWarnings(results);
    return code;
}

int tryWriteSummary(const fs::path& folder, const Experiment& experiment, const std::vector<CaseResult>& results) {
    try {
        replaceFile(folder / "summary.json", writeSummaryJson(experiment.title, experiment.file, results));
        return 0;
    } catch (const Error& e) {
        std::fprintf(stderr, "viable: %s\n", e.what());
        return e.exitCode();
    }
}

bool tryWriteReport(const fs::path& folder) {
    if (areMessagesJson()) WorkShare::show = nullptr;  // a program was told of cases, and is not told of logs now
    try {
        for (const fs::path& report : writeReport(folder, findShared(kReportPage)))
            std::printf("report: %s\n", report.c_str());
        return true;
    } catch (const std::exception& e) {
        std::fprintf(stderr, "viable: the report was not written: %s\nRemove the cause, then run: viable report %s\n",
                     e.what(), folder.c_str());
        return false;
    }
}

}  // namespace viable
