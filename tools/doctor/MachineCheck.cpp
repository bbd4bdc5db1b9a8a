#include "doctor/MachineCheck.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <map>
#include <sstream>
#include <utility>

#include "core/AtOnce.h"
#include "core/Descriptor.h"
#include "core/Text.h"
#include "core/WholeFile.h"

namespace viable {

namespace {

namespace fs = std::filesystem;
using detail::format;

constexpr std::uint64_t kMega = 1024 * 1024;

std::string describeCode(int code) {
    return strerrordesc_np(code) ? strerrordesc_np(code) : "error " + std::to_string(code);
}

std::string formatMemory(std::uint64_t bytes) {
    if (bytes == MemoryRoom::kUnlimited) return "unlimited";
    return bytes < kMega ? format("%.0f kB", static_cast<double>(bytes) / 1024.0)
                         : format("%.0f MB", static_cast<double>(bytes) / static_cast<double>(kMega));
}

std::optional<double> toNumber(const std::string& text) {
    std::istringstream stream(text);
    double number = 0.0;
    return stream >> number ? std::optional<double>(number) : std::nullopt;
}

/** The machine as its files show it. */
class Machine {
public:
    Machine(const SystemAnswers& answers, fs::path root)
        : answers_(answers), root_(std::move(root)), isContainer_(isInContainer(root_)) {}

    std::vector<MachineLine> check() {
        checkKernel();
        checkPriority();
        checkMemory();
        checkLatencyFile();
        checkThrottling();
        checkProcessors();
        checkGovernor();
        checkIsolated();
        checkSiblings();
        checkHeat();
        checkQuota();
        checkVirtual();
        checkClock();
        checkHugePages();
        checkSharedMemory();
        checkUdp();
        return std::move(lines_);
    }

private:
    static constexpr char kProcessors[] = "sys/devices/system/cpu";

    void add(const char* name, std::string found, MachineLevel level, std::string remedy = {}) {
        if (answers_.isRoot) remedy = remedy::makeForRoot(remedy);
        lines_.push_back({name, std::move(found), level, std::move(remedy)});
    }
    void addHidden(const char* name) { add(name, "not shown", MachineLevel::Unknown); }
    /** @param remedy  for the worse one */
    void addEither(const char* name, bool isGood, const std::string& good, const std::string& worse,
                   const std::string& remedy) {
        add(name, isGood ? good : worse, isGood ? MachineLevel::Good : MachineLevel::Worse, isGood ? "" : remedy);
    }

    bool isThere(const std::string& file) const {
        std::error_code failed;
        return fs::exists(root_ / file, failed);
    }

    /** The first line of a file, printable; none where it cannot be read or is empty. */
    std::optional<std::string> read(const std::string& file) const {
        auto text = readWhole(root_ / file);
        if (!text) return std::nullopt;
        std::string line = makePrintable(text->substr(0, text->find('\n')));
        line.erase(line.find_last_not_of(' ') + 1);
        return line.empty() ? std::nullopt : std::optional<std::string>(line);
    }
    std::optional<double> readNumber(const std::string& file) const {
        const auto text = read(file);
        return text ? toNumber(*text) : std::nullopt;
    }

    /** What stands in the same file of every processor: how often each text. */
    std::map<std::string, int> readOfProcessors(const std::string& file) const {
        std::map<std::string, int> found;
        std::error_code failed;
        for (const fs::directory_entry& entry : fs::directory_iterator(root_ / kProcessors, failed)) {
            const std::string name = entry.path().filename();
            if (name.rfind("cpu", 0) != 0 || name.find_first_not_of("0123456789", 3) != std::string::npos) continue;
            if (const auto text = read(std::string(kProcessors) + "/" + name + "/" + file)) ++found[*text];
        }
        return found;
    }

    std::string makeKernelRemedy(const std::string& arguments) const {
        if (!isThere("etc/default/grub")) return "# add to the kernel's command line, and restart: " + arguments;
        return "sudo sed -i 's/^GRUB_CMDLINE_LINUX=\"/&" + arguments +
               " /' /etc/default/grub && sudo update-grub  # then restart";
    }

    void checkKernel() {
        const std::string& version = answers_.kernelVersion;
        const bool isNamed =
            version.find("PREEMPT_RT") != std::string::npos || version.find("PREEMPT RT") != std::string::npos;
        std::string found = answers_.kernelRelease + ", ";
        if (isNamed || read("sys/kernel/realtime") == "1")
            return add("kernel", found + (isNamed ? "PREEMPT_RT" : "PREEMPT_RT by /sys/kernel/realtime"),
                       MachineLevel::Good);
        const bool isUbuntu = readWhole(root_ / "etc/os-release").value_or("").find("ID=ubuntu") != std::string::npos;
        std::string remedy = isUbuntu ? "sudo pro enable realtime-kernel  # then restart"
                                      : "sudo apt install linux-image-rt-$(dpkg --print-architecture)  # then restart";
        if (isContainer_) remedy = "# the kernel is that of the host: install one with PREEMPT_RT there";
        if (version.find("PREEMPT_DYNAMIC") != std::string::npos) {
            found += "PREEMPT_DYNAMIC";
            if (const auto mode = read("sys/kernel/debug/sched/preempt")) found += ": " + *mode;
        } else if (version.find("PREEMPT") != std::string::npos) {
            found += "PREEMPT";
        } else {
            found += "no preemption in the kernel";
        }
        add("kernel", found + ", not PREEMPT_RT", MachineLevel::Worse, remedy);
    }

    void checkPriority() {
        const auto wanted = static_cast<std::uint64_t>(answers_.triedPriority);
        const std::string limits = "soft " + formatPriority(answers_.prioritySoft) + ", hard " +
                                   formatPriority(answers_.priorityHard) + (answers_.isRoot ? " (root)" : " (user)");
        const std::string remedy = answers_.priorityHard >= wanted ? "ulimit -r $(ulimit -Hr)  # in this shell"
                                                                   : remedy::forPriority(isContainer_);
        if (answers_.prioritySoft >= wanted)
            add("priority limit", limits, MachineLevel::Good);
        else if (answers_.priorityError == 0)
            add("priority limit", limits + ", does not bind this process", MachineLevel::Good);
        else
            add("priority limit", limits, MachineLevel::Missing, remedy);

        const std::string tried = "priority " + std::to_string(answers_.triedPriority);
        if (answers_.priorityError == 0) return add("SCHED_FIFO", tried + " was had", MachineLevel::Good);
        const std::string group = findPriorityGroup();
        add("SCHED_FIFO", tried + " is refused: " + describeCode(answers_.priorityError), MachineLevel::Missing,
            !group.empty()    ? "echo 950000 | sudo tee " + group
            : answers_.isRoot ? remedy::forPriority(true)
                              : remedy);
    }

    static std::string formatPriority(std::uint64_t limit) {
        return limit == MemoryRoom::kUnlimited ? "unlimited" : std::to_string(limit);
    }

    void checkMemory() {
        const std::string limits = "soft " + formatMemory(answers_.memorySoft) + ", hard " +
                                   formatMemory(answers_.memoryHard) + (answers_.isRoot ? " (root)" : " (user)");
        const MemoryRoom& room = answers_.room;
        const MemoryLock lock = decideMemoryLock(room);
        const std::string remedy = answers_.memoryHard == MemoryRoom::kUnlimited
                                       ? "ulimit -l unlimited  # in this shell"
                                       : remedy::forMemory(isContainer_);
        if (lock == MemoryLock::All)
            add("memory lock", limits + (answers_.memorySoft == room.limit ? "" : ", does not bind this process"),
                MachineLevel::Good);
        else if (lock == MemoryLock::Present)
            add("memory lock", limits + ": what the loop has when it begins, not what it takes later",
                MachineLevel::Worse, remedy);
        else
            add("memory lock", limits + "; this process alone has " + formatMemory(room.size) + " of addresses",
                MachineLevel::Missing, remedy);
    }

    void checkLatencyFile() {
        constexpr char kName[] = "/dev/cpu_dma_latency";
        const int code = answers_.latencyFileError;
        if (code == 0)
            add(kName, "can be written", MachineLevel::Good);
        else
            add(kName, describeCode(code), MachineLevel::Worse,
                code == ENOENT && !isContainer_ ? makeKernelRemedy("processor.max_cstate=1 intel_idle.max_cstate=1")
                                                : remedy::forLatencyFile(isContainer_, code));
    }

    void checkThrottling() {
        const auto runtime_us = readNumber("proc/sys/kernel/sched_rt_runtime_us");
        const double period_us = readNumber("proc/sys/kernel/sched_rt_period_us").value_or(1e6);
        const char* const name = "real-time throttling";
        if (!runtime_us || period_us <= 0.0) return addHidden(name);
        if (*runtime_us < 0.0)
            return add(name, "off: a loop that never waits takes its processor for ever", MachineLevel::Good);
        const double share = *runtime_us / period_us;
        const std::string found = format("%.0f %% of a processor for real time", 100.0 * share);
        if (share >= 0.5) return add(name, found, MachineLevel::Good);
        add(name, found, *runtime_us > 0.0 ? MachineLevel::Worse : MachineLevel::Missing,
            "sudo sysctl -w kernel.sched_rt_runtime_us=950000");
    }

    void checkProcessors() {
        const std::string online = read(std::string(kProcessors) + "/online").value_or("?");
        const int count = answers_.processors;
        const std::string found = std::to_string(count) + " may be used (online: " + online + ")";
        addEither("processors", count >= 2, found, found + ": the loop shares it with all else",
                  isContainer_ ? "# start the container with two processors or more: docker run --cpuset-cpus 0,1"
                               : "# give the machine two processors or more, or start viable by: taskset -c 0,1");
    }

    void checkGovernor() {
        const auto governors = readOfProcessors("cpufreq/scaling_governor");
        if (governors.empty())
            return add("CPU governor", "not shown: a fixed frequency, or the host of a virtual machine has it",
                       MachineLevel::Unknown);
        std::string found;
        for (const auto& [governor, count] : governors)
            detail::addItem(found, governor + " on " + std::to_string(count));
        addEither("CPU governor", governors.size() == 1 && governors.begin()->first == "performance", found, found,
                  "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor");
    }

    void checkIsolated() {
        const std::string file = std::string(kProcessors) + "/isolated";
        if (!isThere(file)) return addHidden("isolated CPUs");
        if (const auto list = read(file)) return add("isolated CPUs", *list + " (for --cpu)", MachineLevel::Good);
        const std::string last = std::to_string(answers_.processors - 1);
        add("isolated CPUs", "none", MachineLevel::Worse,
            answers_.processors < 2
                ? "# one processor cannot be set apart; two or more are needed"
                : makeKernelRemedy("isolcpus=" + last + " nohz_full=" + last + " rcu_nocbs=" + last) + "; --cpu " +
                      last);
    }

    void checkSiblings() {
        const auto active = read(std::string(kProcessors) + "/smt/active");
        if (!active) return addHidden("SMT");
        addEither("SMT", *active == "0", "off", "on: a core's two threads slow each other",
                  "echo off | sudo tee /sys/devices/system/cpu/smt/control");
    }

    void checkHeat() {
        const auto counts = readOfProcessors("thermal_throttle/core_throttle_count");
        double throttled = 0.0;
        for (const auto& [count, processors] : counts) throttled += processors * toNumber(count).value_or(0.0);
        if (counts.empty()) return addHidden("heat");
        addEither("heat", throttled == 0.0, "never throttled since the start",
                  format("throttled %.0f times since the start", throttled),
                  "# cool the machine: clean its fans, leave room for the air; then restart and look again");
    }

    struct Quota {
        double share = 0.0;  // of one processor
        std::string file;
    };

    /** The folders of this process's groups: that of version 2 first, then that of the CPU's in version 1; each from the
    innermost outwards. */
    std::vector<std::string> listGroups(bool isVersion1) const {
        std::vector<std::string> folders;
        std::istringstream lines(readWhole(root_ / "proc/self/cgroup").value_or(""));
        for (std::string line; std::getline(lines, line);) {
            const std::size_t first = line.find(':'), second = line.find(':', first + 1);
            if (first == std::string::npos || second == std::string::npos) continue;
            const std::string controllers = line.substr(first + 1, second - first - 1);
            std::string path = line.substr(second + 1);
            std::string mount = "sys/fs/cgroup";
            if (isVersion1) {
                if (("," + controllers + ",").find(",cpu,") == std::string::npos) continue;
                mount += "/" + controllers;
            } else if (!controllers.empty()) {
                continue;
            }
            if (path.rfind('/', 0) != 0) continue;
            while (path.size() > 1) {
                folders.push_back(mount + path);
                path.erase(path.rfind('/'));
            }
            folders.push_back(mount);
        }
        return folders;
    }

    /** A group of version 1 that may have no priority (CONFIG_RT_GROUP_SCHED): its file; empty where there is none. */
    std::string findPriorityGroup() const {
        for (const std::string& folder : listGroups(true)) {
            const auto runtime_us = readNumber(folder + "/cpu.rt_runtime_us");
            if (runtime_us) return *runtime_us == 0.0 ? "/" + folder + "/cpu.rt_runtime_us" : std::string();
        }
        return {};
    }

    std::optional<Quota> findQuota() const {
        std::optional<Quota> tightest;
        const auto consider = [&tightest](double quota, double period, const std::string& file) {
            if (quota > 0.0 && period > 0.0 && (!tightest || quota / period < tightest->share))
                tightest = Quota{quota / period, "/" + file};
        };
        for (const std::string& folder : listGroups(false)) {
            const std::string text = read(folder + "/cpu.max").value_or("max");
            if (text.rfind("max", 0) == 0) continue;
            const std::size_t blank = text.find(' ');
            const double period = blank == std::string::npos ? 1e5 : toNumber(text.substr(blank)).value_or(1e5);
            consider(toNumber(text).value_or(0.0), period, folder + "/cpu.max");
        }
        for (const std::string& folder : listGroups(true))
            consider(readNumber(folder + "/cpu.cfs_quota_us").value_or(-1.0),
                     readNumber(folder + "/cpu.cfs_period_us").value_or(1e5), folder + "/cpu.cfs_quota_us");
        return tightest;
    }

    void checkQuota() {
        const std::string where = isContainer_ ? "in a container, " : "";
        const auto quota = findQuota();
        if (!quota) {
            const bool isShown = isThere("proc/self/cgroup");
            return add("CPU quota", where + (isShown ? "none" : "not shown"),
                       isShown ? MachineLevel::Good : MachineLevel::Unknown);
        }
        const bool isVersion2 = quota->file.find("cpu.max") != std::string::npos;
        add("CPU quota",
            where +
                format("%.2f processors' time, then all but real-time threads wait for the next period", quota->share),
            MachineLevel::Worse,
            isContainer_ ? "docker update --cpus 0 CONTAINER  # on the host"
                         : std::string(isVersion2 ? "echo max" : "echo -1") + " | sudo tee " + quota->file);
    }

    void checkVirtual() {
        const auto info = readWhole(root_ / "proc/cpuinfo");
        if (!info) return addHidden("virtual machine");
        addEither("virtual machine", info->find(" hypervisor") == std::string::npos, "no sign of one",
                  "yes: its host may take the processor away at any time",
                  "# run on the machine itself, or tie each virtual processor to one of the host's: virsh vcpupin");
    }

    void checkClock() {
        const std::string folder = "sys/devices/system/clocksource/clocksource0/";
        const auto clock = read(folder + "current_clocksource");
        const std::string others = " " + read(folder + "available_clocksource").value_or("") + " ";
        if (!clock) return addHidden("clock source");
        const auto slow = {"hpet", "acpi_pm", "jiffies", "pit", "xen"};
        addEither("clock source", std::find(slow.begin(), slow.end(), *clock) == slow.end(), *clock,
                  *clock + ": reading the time takes long",
                  others.find(" tsc ") != std::string::npos
                      ? "echo tsc | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource"
                      : "sudo dmesg | grep -i -e tsc -e clocksource  # why the kernel does not trust a faster one");
    }

    void checkHugePages() {
        const auto mode = read("sys/kernel/mm/transparent_hugepage/enabled");
        if (!mode) return addHidden("huge pages");
        addEither("huge pages", mode->find("[always]") == std::string::npos, *mode,
                  *mode + ": the kernel moves memory of a running loop",
                  "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled");
    }

    void checkSharedMemory() {
        const int code = answers_.sharedMemoryError;
        const std::uint64_t size = answers_.sharedMemorySize;
        if (code == EACCES || code == EPERM || code == EROFS)
            add("/dev/shm", "this user cannot make a file there: " + describeCode(code), MachineLevel::Missing,
                code == EROFS ? "sudo mount -o remount,rw /dev/shm" : "sudo chmod 1777 /dev/shm");
        else if (code != 0)
            add("/dev/shm", describeCode(code), MachineLevel::Missing,
                isContainer_     ? "# start the container with: docker run --shm-size 64m"
                : code == ENOSPC ? "ls -lS /dev/shm  # it is full: delete what nobody needs"
                                 : "sudo mkdir -p /dev/shm && sudo mount -t tmpfs -o mode=1777 tmpfs /dev/shm");
        else if (size < kMega)
            add("/dev/shm", formatMemory(size), MachineLevel::Worse,
                isContainer_ ? "# start the container with: docker run --shm-size 64m"
                             : "sudo mount -o remount,size=64m /dev/shm");
        else
            add("/dev/shm", formatMemory(size) + ", can be written", MachineLevel::Good);
    }

    void checkUdp() {
        constexpr std::uint64_t kEnough = 64 * 1024;  // 50 packets and what the kernel adds to each
        if (answers_.udpError != 0)
            return add("UDP on this machine", "a packet to 127.0.0.1 does not come: " + describeCode(answers_.udpError),
                       MachineLevel::Missing, "sudo ip link set lo up");
        const std::string room = "room for " + formatMemory(answers_.udpBuffer) + " of packets";
        addEither("UDP on this machine", answers_.udpBuffer >= kEnough, "goes; " + room, room,
                  "sudo sysctl -w net.core.rmem_default=212992");
    }

    const SystemAnswers& answers_;
    fs::path root_;
    bool isContainer_;
    std::vector<MachineLine> lines_;
};

std::uint64_t toLimit(rlim_t limit) {
    return limit == RLIM_INFINITY ? MemoryRoom::kUnlimited : limit;
}

/** For a moment; a user without privileges keeps the mark that children do not inherit it. */
int tryPriority(int priority) {
    const int before = sched_getscheduler(0);
    sched_param parameterBefore{}, parameter{};
    sched_getparam(0, &parameterBefore);
    parameter.sched_priority = priority;
    if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameter) != 0) return errno;
    if (sched_setscheduler(0, before, &parameterBefore) != 0)
        sched_setscheduler(0, before | SCHED_RESET_ON_FORK, &parameterBefore);
    return 0;
}

int trySharedMemory(std::uint64_t& size) {
    struct statvfs system {};
    if (statvfs("/dev/shm", &system) != 0) return errno;
    size = static_cast<std::uint64_t>(system.f_blocks) * system.f_frsize;
    std::string name = "/dev/shm/viable-doctor-" + std::to_string(getpid()) + "-XXXXXX";
    const detail::Descriptor file(mkostemp(name.data(), O_CLOEXEC));
    if (file < 0) return errno;
    unlink(name.c_str());
    return posix_fallocate(file, 0, 64 * 1024);
}

int tryUdp(std::uint64_t& buffer) {
    const detail::Descriptor line(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    if (line < 0) return errno;
    int size = 0;
    socklen_t length = sizeof size;
    if (getsockopt(line, SOL_SOCKET, SO_RCVBUF, &size, &length) == 0) buffer = static_cast<std::uint64_t>(size);
    sockaddr_in own{};
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    length = sizeof own;
    auto* const address = reinterpret_cast<sockaddr*>(&own);
    if (bind(line, address, sizeof own) != 0 || getsockname(line, address, &length) != 0) return errno;
    if (sendto(line, "?", 1, 0, address, sizeof own) != 1) return errno;
    pollfd ready{line, POLLIN, 0};
    return poll(&ready, 1, 1000) == 1 ? 0 : ETIMEDOUT;
}

}  // namespace

const char* getName(MachineLevel level) {
    return detail::enumName<MachineLevel::Unknown>(level, {"good", "worse", "missing", "unknown"});
}

SystemAnswers askSystem(int priority) {
    SystemAnswers answers;
    utsname name{};
    uname(&name);
    answers.kernelRelease = name.release;
    answers.kernelVersion = name.version;
    answers.isRoot = geteuid() == 0;
    rlimit limit{};
    getrlimit(RLIMIT_MEMLOCK, &limit);
    answers.memorySoft = toLimit(limit.rlim_cur);
    answers.memoryHard = toLimit(limit.rlim_max);
    getrlimit(RLIMIT_RTPRIO, &limit);
    answers.prioritySoft = toLimit(limit.rlim_cur);
    answers.priorityHard = toLimit(limit.rlim_max);
    answers.room = readMemoryRoom();
    answers.triedPriority = priority;
    answers.priorityError = tryPriority(priority);
    const detail::Descriptor latencyFile(open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC));
    answers.latencyFileError = latencyFile < 0 ? errno : 0;
    answers.processors = std::max(1, static_cast<int>(detail::countCores()));
    answers.sharedMemoryError = trySharedMemory(answers.sharedMemorySize);
    answers.udpError = tryUdp(answers.udpBuffer);
    return answers;
}

std::vector<MachineLine> checkMachine(const SystemAnswers& answers, const std::filesystem::path& root) {
    return Machine(answers, root).check();
}

std::string explainNotRealTime(const SystemAnswers& answers) {
    std::string why;
    if (answers.priorityError != 0) detail::addItem(why, "SCHED_FIFO is refused");
    if (decideMemoryLock(answers.room) == MemoryLock::None) detail::addItem(why, "memory cannot be locked");
    return why;
}

}  // namespace viable
