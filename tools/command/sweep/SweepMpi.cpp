#include "SweepMpi.h"

#include <dlfcn.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>

#include "SweepPipe.h"
#include "command/sweep/mpi/MpiModule.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

// The first byte of a message.
constexpr char kWant = 'w';  ///< to rank 0: number of jobs (8 bytes), hash of the sweep
constexpr char kRow = 'r';   ///< to rank 0: a row
constexpr char kRuns = 'j';  ///< from rank 0: numbers of runs (8 bytes each)
constexpr char kEnd = 'e';   ///< from rank 0: no more
constexpr char kDone = 'd';  ///< from the runs' process: all of the last kRuns

/** A rank gets about this share of what is left, so that all end at about the same time. */
constexpr std::size_t kShares = 4;
constexpr std::size_t kMostRunsSent = 256;

int getNumber(const char* variable, int otherwise) {
    const char* text = std::getenv(variable);
    return text ? std::atoi(text) : otherwise;
}

/** viable_mpi.so: beside the program (build tree), or where it is installed. */
class Mpi {
public:
    Mpi() {
        const fs::path program = fs::read_symlink("/proc/self/exe").parent_path();
        const fs::path places[] = {program / "viable_mpi.so",
                                   program / ".." / VIABLE_INSTALL_LIBDIR / "viable" / "viable_mpi.so"};
        std::string reason = "it is not there";
        void* library = nullptr;
        for (const fs::path& place : places) {
            if (library || !fs::exists(place)) continue;
            // Open MPI's own plugins look for its symbols among the global ones.
            library = dlopen(place.c_str(), RTLD_NOW | RTLD_GLOBAL | RTLD_NODELETE);
            if (const char* text = library ? nullptr : dlerror()) reason = text;
        }
        if (!library)
            throw badInput(
                "viable sweep", "mpirun has started it, but viable_mpi.so cannot be opened: " + reason,
                "Install Open MPI (libopenmpi3; to build it: libopenmpi-dev), or share the runs with --shard.");
        find(library, begin_, "viable_mpi_begin");
        find(library, send_, "viable_mpi_send");
        find(library, receive_, "viable_mpi_receive");
        find(library, end_, "viable_mpi_end");
        if (begin_(&rank_, &size_) != 0) throw Error(ErrorKind::PluginFailed, "viable sweep", "MPI cannot be begun");
    }
    int rank() const { return rank_; }
    int size() const { return size_; }
    void send(int rank, const std::string& bytes) { send_(rank, bytes.data(), bytes.size()); }
    /** @return the sender, or -1: `goOn` said 0 */
    int receive(int (*goOn)(), std::string& bytes) {
        return receive_(
            goOn,
            [](void* context, const char* data, unsigned long size) {
                static_cast<std::string*>(context)->assign(data, size);
            },
            &bytes);
    }
    void end() { end_(); }

private:
    template <class Function>
    static void find(void* library, Function*& function, const char* name) {
        function = reinterpret_cast<Function*>(dlsym(library, name));
        if (!function)
            throw badInput("viable_mpi.so", std::string(name) + "() is missing in it",
                           "Install the one of this version of viable.");
    }

    decltype(viable_mpi_begin)* begin_ = nullptr;
    decltype(viable_mpi_send)* send_ = nullptr;
    decltype(viable_mpi_receive)* receive_ = nullptr;
    decltype(viable_mpi_end)* end_ = nullptr;
    int rank_ = 0, size_ = 1;
};

std::vector<std::int64_t> unpackRuns(const std::string& message) {
    std::vector<std::int64_t> runs((message.size() - 1) / sizeof(std::int64_t));
    std::memcpy(runs.data(), message.data() + 1, runs.size() * sizeof(std::int64_t));
    return runs;
}

/** The life of the process that watches over the runs of this rank. */
void serveRuns(const SweepTask& task, int jobs, double timeout_s, FrameReader& from, int to) {
    static const std::atomic<int> never{0};
    int code = 0;
    try {
        SweepSupervisor supervisor(task, jobs, timeout_s, never, [] {});
        supervisor.onRow = [&](SweepRow&& row) {
            if (!writeFrame(to, kRow + packRow(row))) _exit(0);
        };
        while (const std::optional<std::string> message = from.wait()) {
            supervisor.run(unpackRuns(*message));
            if (!writeFrame(to, std::string(1, kDone))) break;
        }
    } catch (const std::exception& e) {
        std::fprintf(stderr, "viable: %s\n", e.what());
        code = static_cast<int>(ErrorKind::PluginFailed);
    }
    std::fflush(nullptr);
    _exit(code);
}

}  // namespace

int findMpiRank() {
    return getNumber("OMPI_COMM_WORLD_SIZE", 1) > 1 ? getNumber("OMPI_COMM_WORLD_RANK", 0) : -1;
}

bool serveMpiRuns(const SweepTask& task, const std::vector<std::int64_t>& runs, const std::atomic<int>& stop,
                  const std::function<void(SweepRow&&)>& onRow, const std::function<void()>& onLook) {
    static const std::atomic<int>* stopFlag = nullptr;
    static const std::function<void()>* look = nullptr;
    stopFlag = &stop;
    look = &onLook;
    Mpi mpi;
    std::size_t next = 0;
    std::string message;
    for (int working = mpi.size() - 1; working > 0;) {
        const int sender = mpi.receive(
            [] {
                (*look)();
                return *stopFlag == 0 ? 1 : 0;
            },
            message);
        if (sender < 0) return false;
        if (message[0] == kRow) {
            onRow(unpackRow(message.substr(1)));
            continue;
        }
        std::uint64_t jobs = 0;
        std::memcpy(&jobs, message.data() + 1, sizeof jobs);
        if (message.substr(1 + sizeof jobs) != task.plan().fileHash)
            throw badInput("rank " + std::to_string(sender),
                           "its experiment file, robots or program are others than those of rank 0",
                           "Give all ranks the same files.");
        const std::size_t left = runs.size() - next;
        if (left == 0) {
            mpi.send(sender, std::string(1, kEnd));
            --working;
            continue;
        }
        const std::size_t share = left / (kShares * static_cast<std::size_t>(mpi.size() - 1));
        const std::size_t count =
            std::min(left, std::clamp<std::size_t>(share, jobs, std::max<std::size_t>(jobs, kMostRunsSent)));
        const auto* const sent = reinterpret_cast<const char*>(runs.data() + next);
        mpi.send(sender, kRuns + std::string(sent, count * sizeof runs[next]));
        next += count;
    }
    mpi.end();
    return true;
}

void workForMpi(const SweepTask& task, int jobs, double timeout_s) {
    PipedProcess process([&](FrameReader& from, int to) { serveRuns(task, jobs, timeout_s, from, to); });
    Mpi mpi;
    const std::uint64_t count = static_cast<std::uint64_t>(jobs);
    const std::string want =
        kWant + std::string(reinterpret_cast<const char*>(&count), sizeof count) + task.plan().fileHash;
    std::string message;
    for (;;) {
        mpi.send(0, want);
        mpi.receive([] { return 1; }, message);
        if (message[0] == kEnd) break;
        process.send(message);
        for (;;) {
            const std::optional<std::string> said = process.messages().wait();
            if (!said)
                throw Error(ErrorKind::PluginFailed, "rank " + std::to_string(mpi.rank()),
                            "the process that watches over its runs has died",
                            "What rank 0 has stored is complete; give the same command again.");
            if ((*said)[0] == kDone) break;
            mpi.send(0, *said);
        }
    }
    process.finish();
    mpi.end();
}

}  // namespace viable
