#include <CLI/CLI.hpp>
#include <charconv>
#include <thread>

#include "command/Commands.h"
#include "command/Progress.h"
#include "command/StopSignals.h"
#include "command/sweep/SweepMpi.h"
#include "core/Text.h"

namespace viable {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::int64_t kMostRuns = 10000000;
constexpr double kDefaultTimeout_s = 120.0;

struct CommandArguments {
    SweepArguments sweep;
    int jobs = 0;
    std::string shard, out;
    std::vector<std::string> merge;
    double timeout_s = kDefaultTimeout_s;
    bool again = false;
};

/** `--shard i/N`: the runs whose number leaves the rest i when divided by N. */
struct Shard {
    std::int64_t index = 0, count = 1;
};

Shard readShard(const std::string& text) {
    Shard shard;
    if (text.empty()) return shard;
    const char* const end = text.data() + text.size();
    const auto index = std::from_chars(text.data(), end, shard.index);
    const bool hasSlash = index.ec == std::errc() && index.ptr != end && *index.ptr == '/';
    const auto count = hasSlash ? std::from_chars(index.ptr + 1, end, shard.count) : index;
    if (!hasSlash || count.ec != std::errc() || count.ptr != end || shard.count < 1 || shard.index < 0 ||
        shard.index >= shard.count)
        throw badInput("--shard " + text, "this is not a shard",
                       "Write i/N with i from 0 to N-1: of four, 0/4, 1/4, 2/4 and 3/4.");
    return shard;
}

/** The same command finds the same folder again: it goes on with the sweep there. */
fs::path findFolder(const CommandArguments& arguments, const Shard& shard) {
    if (!arguments.out.empty()) return arguments.out;
    std::string name =
        fs::path(arguments.sweep.file).stem().string() + "-sweep-" + std::to_string(arguments.sweep.seed);
    if (shard.count > 1) name += "-" + std::to_string(shard.index) + "of" + std::to_string(shard.count);
    return fs::path("runs") / name;
}

/** Stores a run as soon as all its cases are there. */
class Collector {
public:
    /** @param runs  that are to come */
    Collector(SweepStore& store, std::size_t runs, Progress& progress)
        : store_(store), runs_(runs), progress_(progress) {}

    void add(SweepRow&& row) {
        std::vector<SweepRow>& rows = rows_[row.run];
        const std::int64_t run = row.run;
        rows.push_back(std::move(row));
        if (rows.size() < store_.plan().cases.size()) return;
        store_.add(rows);
        rows_.erase(run);
        progress_.set(0, static_cast<double>(++done_) / static_cast<double>(runs_));
    }
    std::int64_t done() const { return done_; }

private:
    SweepStore& store_;
    const std::size_t runs_;
    std::int64_t done_ = 0;
    Progress& progress_;
    std::map<std::int64_t, std::vector<SweepRow>> rows_;
};

/** What a store is for people, at its end. Returns the exit code. */
int finish(const SweepStore& store) {
    writeSweepCsv(store);
    std::printf("\n%stable: %s\n        %s\n", formatSweepSummary(store).c_str(),
                (store.folder() / "sweep.csv").c_str(), (store.folder() / "sweep.sqlite").c_str());
    return findSweepExitCode(store);
}

int runSweep(const CommandArguments& arguments) {
    const int rank = findMpiRank();
    const Shard shard = readShard(arguments.shard);
    const SweepTask task(arguments.sweep);
    const unsigned cores = std::max(1u, std::thread::hardware_concurrency());
    // mpirun has made a process per core as a rule.
    const int jobs = arguments.jobs > 0 ? arguments.jobs : rank >= 0 ? 1 : static_cast<int>(cores);
    if (rank > 0) {
        workForMpi(task, jobs, arguments.timeout_s);
        return 0;
    }
    SweepStore store(findFolder(arguments, shard), task.plan());
    const std::int64_t lost = arguments.again ? store.removeLost() : 0;
    std::vector<std::int64_t> runs;
    const std::vector<std::int64_t> done = store.findRuns();
    for (std::int64_t run = shard.index; run < arguments.sweep.runs; run += shard.count)
        if (!std::binary_search(done.begin(), done.end(), run)) runs.push_back(run);
    const auto before = static_cast<std::int64_t>(done.size());
    std::printf("%s\n%s, seed %llu, %lld runs of %zu case%s%s, %s, output in %s\n",
                makePrintable(task.plan().title).c_str(), arguments.sweep.file.c_str(),
                static_cast<unsigned long long>(arguments.sweep.seed), static_cast<long long>(arguments.sweep.runs),
                task.plan().cases.size(), task.plan().cases.size() == 1 ? "" : "s",
                shard.count > 1 ? (", shard " + arguments.shard).c_str() : "",
                rank == 0 ? "ranks of mpirun" : (std::to_string(jobs) + " at a time").c_str(), store.folder().c_str());
    if (lost > 0) std::printf("%lld runs that crashed or took too long are done again\n", static_cast<long long>(lost));
    if (before > 0)
        std::printf("%lld runs are there already, %zu to do\n", static_cast<long long>(before), runs.size());
    std::fflush(stdout);

    const std::atomic<int>& stop = catchStopSignals();
    Progress progress({std::to_string(runs.size()) + " runs"});
    Collector collector(store, runs.size(), progress);
    const Clock::time_point begin = Clock::now();
    const auto onRow = [&](SweepRow&& row) { collector.add(std::move(row)); };
    const auto onLook = [&] { progress.draw(); };
    bool isWhole = true;
    if (rank == 0) {
        isWhole = serveMpiRuns(task, runs, stop, onRow, onLook);
    } else {
        SweepSupervisor supervisor(task, jobs, arguments.timeout_s, stop, [&] { store.abandon(); });
        supervisor.onRow = onRow;
        supervisor.onLook = onLook;
        isWhole = supervisor.run(runs);
    }
    progress.draw(true);
    if (!isWhole) {
        std::fprintf(stderr,
                     "viable: ended early by signal %d; %lld of %lld runs are stored in %s. The same command continues "
                     "from there.\n",
                     stop.load(), static_cast<long long>(before + collector.done()),
                     static_cast<long long>(before + static_cast<std::int64_t>(runs.size())), store.folder().c_str());
        return 128 + stop.load();
    }
    const double elapsed_s = std::max(1e-9, std::chrono::duration<double>(Clock::now() - begin).count());
    const double rate = static_cast<double>(collector.done()) / elapsed_s;
    const int code = finish(store);
    if (!runs.empty()) std::printf("%.3g runs/s\n", rate);
    return code;
}

/** Whether the same run gave the same: the time it took and the command's words may differ. */
bool areSame(const SweepPlan& plan, const SweepRow& a, const SweepRow& b) {
    for (std::size_t i = 0; i < plan.columns.size(); ++i)
        if (plan.columns[i].name != "wall_s" && plan.columns[i].name != "replay" && a.values[i] != b.values[i])
            return false;
    return true;
}

int mergeShards(const CommandArguments& arguments) {
    if (arguments.out.empty())
        throw badInput("--merge", "there is no folder for the whole", "Name a new one with --out DIR.");
    SweepPlan plan = SweepStore(arguments.merge.front()).plan();
    for (const std::string& folder : arguments.merge) plan.runs = std::max(plan.runs, SweepStore(folder).plan().runs);
    SweepStore whole(arguments.out, plan);
    if (!whole.findRuns().empty())
        throw badInput("--out " + arguments.out, "this folder already holds runs", "Name a new one.");
    std::map<std::int64_t, std::pair<std::vector<SweepRow>, std::string>> runs;
    for (const std::string& folder : arguments.merge) {
        const SweepStore shard(folder);
        whole.checkSame(shard.plan(), folder);
        std::map<std::int64_t, std::vector<SweepRow>> own;
        shard.forEach([&](const SweepRow& row) { own[row.run].push_back(row); });
        for (auto& [run, rows] : own) {
            if (rows.size() != plan.cases.size()) continue;  // it is missing: not all was stored
            const auto [known, isNew] = runs.try_emplace(run, rows, folder);
            const std::vector<SweepRow>& others = known->second.first;
            if (isNew) continue;
            for (std::size_t i = 0; i < rows.size(); ++i)
                if (rows[i].caseName != others[i].caseName || !areSame(plan, rows[i], others[i]))
                    throw badInput(
                        folder, "its run " + std::to_string(run) + " is another than in " + known->second.second,
                        "A run is the same wherever it is done: find out which folder is wrong, and do it again.");
        }
    }
    for (const auto& entry : runs) whole.add(entry.second.first);
    const auto missing = plan.runs - static_cast<std::int64_t>(runs.size());
    std::printf("%s\n%zu of %lld runs%s\n", makePrintable(plan.title).c_str(), runs.size(),
                static_cast<long long>(plan.runs),
                missing > 0 ? ": some are missing; `viable sweep` with --out of this folder does them" : "");
    return finish(whole);
}

int runCommand(const CommandArguments& arguments) {
    std::signal(SIGPIPE, SIG_IGN);  // a closed pipe is a write error, not a death
    std::signal(SIGXFSZ, SIG_IGN);  // so is a file size limit
    if (!arguments.merge.empty()) {
        if (!arguments.sweep.file.empty())
            throw badInput("--merge", "FILE is not used here: the shards name theirs",
                           "Write `viable sweep --merge DIR... --out DIR`.");
        return mergeShards(arguments);
    }
    if (arguments.sweep.file.empty() || arguments.sweep.runs < 1)
        throw badInput("viable sweep", "FILE or --runs is missing", "Write `viable sweep FILE --runs N`.");
    return runSweep(arguments);
}

}  // namespace

void addSweepCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<CommandArguments>();
    CLI::App* command =
        app.add_subcommand("sweep", "Run an experiment many times, its ~draws anew each time, into one table");
    SweepArguments& sweep = arguments->sweep;
    command->add_option("FILE", sweep.file, "Experiment file with drawn values");
    command->add_option("--runs", sweep.runs, "How many runs")->check(CLI::Range(std::int64_t{1}, kMostRuns));
    command->add_option("--seed", sweep.seed, "Another number is another set of draws (default: 1)");
    command->add_option("--jobs", arguments->jobs, "Runs at a time (default: one per core)")->check(CLI::Range(1, 256));
    command->add_option("--shard", arguments->shard,
                        "i/N: only the runs whose number modulo N is i, from 0; see --merge");
    command->add_option(
        "--out", arguments->out,
        "Folder for the table (default: runs/<file>-sweep-<seed>); runs that are there are not done again");
    command->add_option("--set", sweep.overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->add_option("--case", sweep.cases, "Only this case (may be repeated)")->allow_extra_args(false);
    command
        ->add_option("--timeout", arguments->timeout_s,
                     "Seconds that a case may take, or 20 times the median if that is more (default: 120)")
        ->check(CLI::Range(0.01, 1e6));
    CLI::Option* again =
        command->add_flag("--again", arguments->again, "Do runs that crashed or took too long once more");
    command->add_option("--merge", arguments->merge, "Folders of shards to put together, into --out")->excludes(again);
    command->callback([arguments, &exitCode] { exitCode = runCommand(*arguments); });
}

}  // namespace viable
