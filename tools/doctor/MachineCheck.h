#pragma once

#include "realtime/RealTimeSetup.h"

namespace viable {

enum class MachineLevel {
    Good,
    Worse,    ///< a loop runs, but may wake later
    Missing,  ///< what viable asks for cannot be had
    Unknown,  ///< the machine does not show it
};

/** "good", "worse", "missing", "unknown" */
const char* getName(MachineLevel level);

struct MachineLine {
    std::string name;   ///< "CPU governor"
    std::string found;  ///< "powersave on all 4"
    MachineLevel level = MachineLevel::Unknown;
    std::string remedy;  ///< for one paste into a shell (a "# sentence" where no command helps); empty where it is good
};

/** What no file says: answers of the system to this user. */
struct SystemAnswers {
    std::string kernelRelease, kernelVersion;  ///< uname -r and -v
    bool isRoot = false;
    std::uint64_t memorySoft = 0, memoryHard = 0;      ///< RLIMIT_MEMLOCK [byte]; MemoryRoom::kUnlimited
    std::uint64_t prioritySoft = 0, priorityHard = 0;  ///< RLIMIT_RTPRIO
    MemoryRoom room;
    int triedPriority = 80;
    int priorityError = 0;               ///< errno of taking SCHED_FIFO at triedPriority; 0: had
    int latencyFileError = 0;            ///< errno of opening /dev/cpu_dma_latency for writing
    int processors = 1;                  ///< that this process may use
    int sharedMemoryError = 0;           ///< errno of making a file in /dev/shm
    std::uint64_t sharedMemorySize = 0;  ///< of the file system there [byte]
    int udpError = 0;                    ///< errno of a packet from 127.0.0.1 to itself
    std::uint64_t udpBuffer = 0;         ///< that a socket has for packets that wait [byte], as getsockopt() says it
};

/** Asks; leaves nothing changed. @param priority  that is tried, 1 to 99 */
SystemAnswers askSystem(int priority = 80);

/** What this machine has for a loop of real time, a line per thing, most important first.
@param root  below which /proc, /sys and /etc are read; "/" but in tests. What is not there is Unknown, nothing throws. */
std::vector<MachineLine> checkMachine(const SystemAnswers& answers, const std::filesystem::path& root = "/");

/** Why a loop of this user would run as not real time, "SCHED_FIFO is refused, memory cannot be locked"; empty: it would not. */
std::string explainNotRealTime(const SystemAnswers& answers);

}  // namespace viable
