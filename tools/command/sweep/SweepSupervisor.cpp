#include "SweepSupervisor.h"

#include <sys/wait.h>
#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <mutex>

#include "SweepPipe.h"
#include "command/CrashHandler.h"

namespace viable {

using Clock = std::chrono::steady_clock;

constexpr int kMostThreads = 256;
constexpr int kLook_ms = 100;
/** How long a process that was asked to end may take for it. */
constexpr double kGrace_s = 3.0;
/** A case may take this many times the median of the others. */
constexpr double kMostMedians = 20.0;
/** Processes in a row that may die before they have begun a run. */
constexpr int kMostIdleDeaths = 3;
constexpr std::int64_t kIdle = -1;

static std::int64_t now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
}

static std::string describeDeath(int status) {
    if (WIFEXITED(status)) return "its process ended by itself with code " + std::to_string(WEXITSTATUS(status));
    const int signal = WTERMSIG(status);
    if (signal == SIGKILL) return "its process was killed (signal 9), as the system does when memory runs out";
    return "its process was ended by " + detail::describeSignal(signal) + ", outside of any plugin's code";
}

/** What both processes see. */
struct SweepSupervisor::Shared {
    /** What a thread of the process does. On a cache line of its own: the threads write often. */
    struct alignas(64) Slot {
        std::atomic<std::int64_t> run{kIdle};
        std::atomic<std::size_t> caseIndex{0};
        std::atomic<std::int64_t> begun_ns{0};
    };
    alignas(64) std::atomic<int> stop{0};
    char trouble[1024] = "";  ///< last words of a process whose plugin crashed
    Slot slots[kMostThreads];
};

/** A process with jobs, seen from the one that watches it. */
class SweepSupervisor::Process {
public:
    Process(SweepSupervisor& owner, const std::vector<Job>& jobs, int threads) : owner_(owner) {
        Shared& shared = *owner.shared_;
        shared.trouble[0] = '\0';
        for (Shared::Slot& slot : shared.slots) slot.run = kIdle;
        process_.emplace([&](FrameReader&, int pipe) { owner.work(jobs, threads, pipe); });
    }

    /** Until it has ended: hands on its rows. Returns its wait status. */
    int watch() {
        Clock::time_point stoppedAt{};
        for (;;) {
            const bool hasEnded = process_->hasEnded();  // before reading: what it wrote is all there then
            readRows();
            if (hasEnded) return process_->status();
            owner_.onLook();
            if (owner_.stop_ != 0 && owner_.shared_->stop == 0) {
                owner_.shared_->stop = 1;
                stoppedAt = Clock::now();
            }
            if (owner_.shared_->stop != 0 && std::chrono::duration<double>(Clock::now() - stoppedAt).count() > kGrace_s)
                process_->kill();
            if (owner_.shared_->stop == 0) findOverdue();
        }
    }

    /** (run, case) that took too long. */
    const std::set<std::pair<std::int64_t, std::size_t>>& overdue() const { return overdue_; }

private:
    /** What is there, or comes in the next tenth of a second. */
    void readRows() {
        FrameReader& rows = process_->messages();
        const bool hasEnded = process_->hasEnded();
        while (rows.fill(hasEnded ? 0 : kLook_ms)) {
            while (const std::optional<std::string> bytes = rows.take()) owner_.settle(unpackRow(*bytes));
            if (!hasEnded) return;
        }
        // Its end is closed before it is dead: no use in asking again at once.
        if (!hasEnded && rows.isClosed()) usleep(1000);
    }

    void findOverdue() {
        for (const Shared::Slot& slot : owner_.shared_->slots) {
            const std::int64_t run = slot.run;
            if (run == kIdle || 1e-9 * static_cast<double>(now_ns() - slot.begun_ns) <= owner_.limit_s_) continue;
            overdue_.emplace(run, slot.caseIndex);
        }
        if (!overdue_.empty()) process_->kill();
    }

    SweepSupervisor& owner_;
    std::optional<PipedProcess> process_;
    std::set<std::pair<std::int64_t, std::size_t>> overdue_;
};

SweepSupervisor::SweepSupervisor(const SweepTask& task, int jobs, double timeout_s, const std::atomic<int>& stop,
                                 std::function<void()> afterFork)
    : task_(task),
      jobs_(std::min(jobs, kMostThreads)),
      timeout_s_(timeout_s),
      stop_(stop),
      afterFork_(std::move(afterFork)),
      shared_(detail::makeSharedObject<Shared>()),
      limit_s_(timeout_s) {}

SweepSupervisor::~SweepSupervisor() = default;

/** The whole life of a process. */
void SweepSupervisor::work(const std::vector<Job>& jobs, int threads, int pipe) {
    afterFork_();
    installCrashHandler({});
    tellCrashTo(shared_->trouble, sizeof shared_->trouble);
    endWhenMemoryRunsOut();  // or a run that takes all of it would fail those beside it
    std::mutex mutex;
    const auto send = [&](const SweepRow& row) {
        const std::string bytes = packRow(row);
        const std::lock_guard<std::mutex> lock(mutex);
        if (!writeFrame(pipe, bytes)) _exit(0);  // nobody listens any more
    };
    const auto runJob = [&](const Job& job, Shared::Slot& slot) {
        if (shared_->stop != 0) return;
        slot.caseIndex = job.cases.front();
        slot.begun_ns = now_ns();
        slot.run = job.run;
        const SweepTask::Run run(task_, job.run);
        for (const std::size_t index : job.cases) {
            if (shared_->stop != 0) break;
            slot.begun_ns = now_ns();
            slot.caseIndex = index;
            const SweepRow row = run.runCase(index, shared_->stop);
            // One that was stopped is no result: it is done again when the sweep goes on.
            if (shared_->stop == 0) send(row);
        }
        slot.run = kIdle;
    };
    {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                          static_cast<std::size_t>(threads));
        tbb::task_arena arena(threads);
        arena.execute([&] {
            tbb::parallel_for(
                tbb::blocked_range<std::size_t>(0, jobs.size(), 1),
                [&](const tbb::blocked_range<std::size_t>& range) {
                    prepareThreadForCrash();
                    const int thread = tbb::this_task_arena::current_thread_index();
                    for (std::size_t i = range.begin(); i != range.end(); ++i) runJob(jobs[i], shared_->slots[thread]);
                },
                tbb::simple_partitioner());
        });
    }
    std::fflush(nullptr);
    _exit(0);
}

void SweepSupervisor::settle(SweepRow&& row) {
    idleDeaths_ = 0;
    const std::vector<SweepColumn>& columns = task_.plan().columns;
    for (std::size_t i = 0; i < columns.size(); ++i)
        if (const auto* wall_s = std::get_if<double>(&row.values[i]); wall_s && columns[i].name == "wall_s")
            walls_s_.push_back(*wall_s);
    // The median is needed roughly: now and then is enough.
    constexpr std::size_t kBatch = 64;
    if (!walls_s_.empty() && (walls_s_.size() < kBatch || walls_s_.size() % kBatch == 0)) {
        const auto middle = walls_s_.begin() + static_cast<std::ptrdiff_t>(walls_s_.size() / 2);
        std::nth_element(walls_s_.begin(), middle, walls_s_.end());
        limit_s_ = std::max(timeout_s_, kMostMedians * *middle);
    }
    const std::vector<std::string>& names = task_.plan().cases;
    const auto index = static_cast<std::size_t>(std::find(names.begin(), names.end(), row.caseName) - names.begin());
    std::vector<std::size_t>& cases = open_[where_.at(row.run)].cases;
    cases.erase(std::remove(cases.begin(), cases.end(), index), cases.end());
    onRow(std::move(row));
}

std::vector<SweepSupervisor::Job> SweepSupervisor::listOpen() const {
    std::vector<Job> jobs;
    for (const Job& job : open_)
        if (!job.cases.empty()) jobs.push_back(job);
    return jobs;
}

/** Once more, with nothing beside it. False: stopped. */
bool SweepSupervisor::tryAlone(std::int64_t run) {
    for (;;) {
        const Job job = open_[where_.at(run)];
        if (job.cases.empty()) return true;
        Process process(*this, {job}, 1);
        const int status = process.watch();
        if (stop_ != 0) return false;
        if (open_[where_.at(run)].cases.empty()) return true;
        const Shared::Slot& slot = shared_->slots[0];
        const std::vector<std::size_t>& left = open_[where_.at(run)].cases;
        if (slot.run == kIdle || std::find(left.begin(), left.end(), slot.caseIndex) == left.end()) {
            if (++idleDeaths_ >= kMostIdleDeaths)
                throw Error(ErrorKind::PluginFailed, "run " + std::to_string(run),
                            "its process dies before the run has begun: " + describeDeath(status));
            continue;
        }
        const bool isOverdue = !process.overdue().empty();
        std::string message = isOverdue ? "it took longer than --timeout allows" : shared_->trouble;
        while (!message.empty() && (message.back() == ' ' || message.back() == '.')) message.pop_back();
        if (message.empty()) message = describeDeath(status);
        settle(
            task_.makeLostRow(run, slot.caseIndex, isOverdue ? SweepStatus::TimedOut : SweepStatus::Crashed, message));
    }
}

bool SweepSupervisor::run(const std::vector<std::int64_t>& runs) {
    open_.clear();
    where_.clear();
    std::vector<std::size_t> all(task_.plan().cases.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    for (const std::int64_t run : runs) {
        where_[run] = open_.size();
        open_.push_back({run, all});
    }
    for (;;) {
        const std::vector<Job> jobs = listOpen();
        if (jobs.empty()) return true;
        if (stop_ != 0) return false;
        std::set<std::int64_t> suspects;
        int status = 0;
        {
            Process process(*this, jobs, jobs_);
            status = process.watch();
            if (stop_ != 0) return listOpen().empty();
            for (const auto& [run, index] : process.overdue()) suspects.insert(run);
        }
        if (suspects.empty())
            for (const Shared::Slot& slot : shared_->slots)
                if (slot.run != kIdle && !open_[where_.at(slot.run)].cases.empty()) suspects.insert(slot.run);
        if (suspects.empty() && !listOpen().empty() && ++idleDeaths_ >= kMostIdleDeaths)
            throw Error(ErrorKind::PluginFailed, "viable sweep",
                        "the process of the runs dies before it has begun one: " + describeDeath(status),
                        "What was stored before is complete.");
        for (const std::int64_t run : suspects)
            if (!tryAlone(run)) return false;
    }
}

}  // namespace viable
