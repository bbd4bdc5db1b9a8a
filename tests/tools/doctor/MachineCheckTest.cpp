// A made-up machine with everything, and then with one thing worse at a time: what is told, and its remedy.
#include "doctor/MachineCheck.h"

#include <cerrno>
#include <functional>
#include <set>

#include "ExpectContains.h"
#include "TemporaryFolder.h"
#include "core/Text.h"

namespace viable::test {
namespace {

constexpr std::uint64_t kMega = 1024 * 1024;
const char* const kCpu = "sys/devices/system/cpu/";

/** Four processors of a fine machine, on which an ordinary user may do all. */
struct MadeUp {
    MadeUp() {
        answers.kernelRelease = "6.1.0-rt";
        answers.kernelVersion = "#1 SMP PREEMPT_RT Debian 6.1.1";
        answers.memorySoft = answers.memoryHard = answers.room.limit = MemoryRoom::kUnlimited;
        answers.room.size = 300 * kMega;
        answers.room.growth = 8 * kMega;
        answers.prioritySoft = answers.priorityHard = 98;
        answers.processors = 4;
        answers.sharedMemorySize = 64 * kMega;
        answers.udpBuffer = 212992;
        write("sys/kernel/realtime", "1\n");
        write("proc/sys/kernel/sched_rt_runtime_us", "950000\n");
        write("proc/sys/kernel/sched_rt_period_us", "1000000\n");
        write("proc/self/cgroup", "0::/user.slice/session.scope\n");
        write("proc/cpuinfo", "flags\t\t: fpu vme de\n");
        write(std::string(kCpu) + "online", "0-3\n");
        write(std::string(kCpu) + "isolated", "3\n");
        write(std::string(kCpu) + "smt/active", "0\n");
        for (const char* cpu : {"cpu0", "cpu1", "cpu2", "cpu3"}) {
            write(std::string(kCpu) + cpu + "/cpufreq/scaling_governor", "performance\n");
            write(std::string(kCpu) + cpu + "/thermal_throttle/core_throttle_count", "0\n");
        }
        write(std::string(kCpu) + "cpufreq/scaling_governor", "not of a processor\n");
        write("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n");
        write("sys/devices/system/clocksource/clocksource0/available_clocksource", "tsc hpet acpi_pm\n");
        write("sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never\n");
        write("sys/fs/cgroup/user.slice/cpu.max", "max 100000\n");
        write("etc/default/grub", "GRUB_CMDLINE_LINUX=\"\"\n");
        write("etc/os-release", "ID=debian\n");
    }
    void write(const std::string& file, const std::string& text) const { root.write(file, text); }
    void remove(const std::string& file) const { std::filesystem::remove_all(root / file); }
    std::vector<MachineLine> check() const { return checkMachine(answers, root.path()); }

    TemporaryFolder root;
    SystemAnswers answers;
};

MachineLine find(const std::vector<MachineLine>& lines, const std::string& name) {
    for (const MachineLine& line : lines)
        if (line.name == name) return line;
    ADD_FAILURE() << "there is no line on " << name;
    return {};
}

/** Every line that is not good has a remedy that a shell takes, and only those. */
void expectRemedies(const std::vector<MachineLine>& lines) {
    for (const MachineLine& line : lines) {
        const bool isNeeded = line.level == MachineLevel::Worse || line.level == MachineLevel::Missing;
        EXPECT_EQ(!line.remedy.empty(), isNeeded) << line.name << ": " << line.remedy;
        EXPECT_FALSE(line.found.empty()) << line.name;
        EXPECT_EQ(line.remedy.find('\n'), std::string::npos) << line.remedy;
        static std::set<std::string> taken;  // a shell is asked once about each
        if (line.remedy.empty() || !taken.insert(line.remedy).second) continue;
        EXPECT_EQ(std::system(("bash -n -c " + detail::quoteForShell(line.remedy)).c_str()), 0) << line.remedy;
    }
}

TEST(MachineCheck, AMachineWithEverythingIsGood) {
    const MadeUp machine;
    for (const MachineLine& line : machine.check())
        EXPECT_EQ(line.level, MachineLevel::Good) << line.name << ": " << line.found;
    expectRemedies(machine.check());
    EXPECT_EQ(explainNotRealTime(machine.answers), "");
}

using Make = std::function<void(MadeUp&)>;

struct Change {
    const char* name;  // of the line
    MachineLevel level;
    const char* found;
    const char* remedy;
    Make make;
};

template <class T>
Make answer(T SystemAnswers::*which, std::common_type_t<T> value) {
    return [which, value](MadeUp& machine) { machine.answers.*which = value; };
}

std::vector<Change> listChanges() {
    constexpr auto kWorse = MachineLevel::Worse, kMissing = MachineLevel::Missing, kUnknown = MachineLevel::Unknown,
                   kGood = MachineLevel::Good;
    const auto file = [](std::string path, std::string text) {
        return [path, text](MadeUp& machine) { machine.write(path, text); };
    };
    const auto gone = [](std::string path) { return [path](MadeUp& machine) { machine.remove(path); }; };
    const auto all = [](std::vector<Make> parts) {
        return [parts](MadeUp& machine) {
            for (const Make& part : parts) part(machine);
        };
    };
    const auto kernel = [](std::string version) {
        return [version](MadeUp& machine) {
            machine.remove("sys/kernel/realtime");
            machine.answers.kernelVersion = version;
        };
    };
    const auto memory = [](std::uint64_t soft, std::uint64_t hard) {
        return [soft, hard](MadeUp& machine) {
            machine.answers.memorySoft = machine.answers.room.limit = soft;
            machine.answers.memoryHard = hard;
        };
    };
    const Make noPriority = all({answer(&SystemAnswers::prioritySoft, 0), answer(&SystemAnswers::priorityHard, 0),
                                 answer(&SystemAnswers::priorityError, EPERM)});
    return {
        // Either sign of the kernel is enough.
        {"kernel", kGood, "6.1.0-rt, PREEMPT_RT", "", gone("sys/kernel/realtime")},
        {"kernel", kGood, "PREEMPT_RT by /sys/kernel/realtime", "", answer(&SystemAnswers::kernelVersion, "#1 SMP")},
        {"kernel", kGood, "PREEMPT_RT", "", kernel("#1 SMP PREEMPT RT Tue Jan 1")},
        {"kernel", kWorse, "PREEMPT_DYNAMIC, not PREEMPT_RT",
         "sudo apt install linux-image-rt-$(dpkg --print-architecture)  # then restart",
         kernel("#1 SMP PREEMPT_DYNAMIC")},
        {"kernel", kWorse, "PREEMPT_DYNAMIC: none voluntary (full) lazy, not", "linux-image-rt",
         all({answer(&SystemAnswers::kernelVersion, "#1 SMP PREEMPT_DYNAMIC"), file("sys/kernel/realtime", "0\n"),
              file("sys/kernel/debug/sched/preempt", "none voluntary (full) lazy\n")})},
        {"kernel", kWorse, "no preemption in the kernel", "linux-image-rt", kernel("#1 SMP Debian")},
        {"kernel", kWorse, "not PREEMPT_RT", "sudo pro enable realtime-kernel",
         all({file("sys/kernel/realtime", "0\n"), answer(&SystemAnswers::kernelVersion, "#1 SMP PREEMPT"),
              file("etc/os-release", "NAME=Ubuntu\nID=ubuntu\n")})},

        {"priority limit", kMissing, "soft 0, hard 0 (user)",
         "echo \"$(id -un) - rtprio 98\" | sudo tee /etc/security/limits.d/", noPriority},
        {"priority limit", kMissing, "soft 10, hard 90 (user)", "ulimit -r $(ulimit -Hr)",
         all({answer(&SystemAnswers::prioritySoft, 10), answer(&SystemAnswers::priorityHard, 90),
              answer(&SystemAnswers::priorityError, EPERM)})},
        {"priority limit", kGood, "soft 0, hard 0 (user), does not bind this process", "",
         all({answer(&SystemAnswers::prioritySoft, 0), answer(&SystemAnswers::priorityHard, 0)})},
        {"SCHED_FIFO", kMissing, "priority 80 is refused: Operation not permitted",
         "sudo tee /etc/security/limits.d/90-viable-rtprio.conf", noPriority},
        {"SCHED_FIFO", kMissing, "refused", "# start the container with: docker run --cap-add sys_nice",
         all({file(".dockerenv", ""), noPriority})},
        {"SCHED_FIFO", kMissing, "refused", "echo 950000 | sudo tee /sys/fs/cgroup/cpu,cpuacct/a/cpu.rt_runtime_us",
         all({file("proc/self/cgroup", "4:cpu,cpuacct:/a\n0::/\n"),
              file("sys/fs/cgroup/cpu,cpuacct/a/cpu.rt_runtime_us", "0\n"),
              answer(&SystemAnswers::priorityError, EPERM)})},

        {"memory lock", kMissing, "soft 8 MB, hard 8 MB (user); this process alone has 300 MB",
         "echo \"$(id -un) - memlock unlimited\" | sudo tee /etc/security/limits.d/", memory(8 * kMega, 8 * kMega)},
        {"memory lock", kMissing, "soft 64 kB, hard unlimited (user)", "ulimit -l unlimited  # in this shell",
         memory(64 * 1024, MemoryRoom::kUnlimited)},
        {"memory lock", kWorse, "what the loop has when it begins", "memlock unlimited",
         memory(2000 * kMega, 2000 * kMega)},
        {"memory lock", kGood, "does not bind this process", "",
         all({answer(&SystemAnswers::memorySoft, 8 * kMega), answer(&SystemAnswers::memoryHard, 8 * kMega)})},

        {"/dev/cpu_dma_latency", kWorse, "Permission denied", "sudo groupadd -rf realtime && sudo usermod",
         answer(&SystemAnswers::latencyFileError, EACCES)},
        {"/dev/cpu_dma_latency", kWorse, "No such file", "processor.max_cstate=1",
         answer(&SystemAnswers::latencyFileError, ENOENT)},
        {"/dev/cpu_dma_latency", kWorse, "No such file", "docker run --device /dev/cpu_dma_latency",
         all({file("run/.containerenv", ""), answer(&SystemAnswers::latencyFileError, ENOENT)})},
        {"/dev/cpu_dma_latency", kWorse, "Permission denied", "sudo chmod 666 /dev/cpu_dma_latency",
         all({file("run/.containerenv", ""), answer(&SystemAnswers::latencyFileError, EACCES)})},

        {"real-time throttling", kGood, "off", "", file("proc/sys/kernel/sched_rt_runtime_us", "-1\n")},
        {"real-time throttling", kWorse, "20 % of a processor", "sudo sysctl -w kernel.sched_rt_runtime_us=950000",
         file("proc/sys/kernel/sched_rt_runtime_us", "200000\n")},
        {"real-time throttling", kMissing, "0 % of a processor", "sysctl",
         file("proc/sys/kernel/sched_rt_runtime_us", "0\n")},
        {"real-time throttling", kUnknown, "not shown", "", gone("proc/sys/kernel/sched_rt_runtime_us")},

        {"processors", kWorse, "1 may be used (online: 0-3)", "taskset -c 0,1", answer(&SystemAnswers::processors, 1)},
        {"processors", kWorse, "1 may be used", "docker run --cpuset-cpus 0,1",
         all({file(".dockerenv", ""), answer(&SystemAnswers::processors, 1)})},

        {"CPU governor", kWorse, "performance on 3, powersave on 1",
         "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
         file(std::string(kCpu) + "cpu2/cpufreq/scaling_governor", "powersave\n")},
        {"CPU governor", kUnknown, "not shown", "",
         [](MadeUp& machine) {
             for (const char* cpu : {"cpu0", "cpu1", "cpu2", "cpu3"})
                 machine.remove(std::string(kCpu) + cpu + "/cpufreq");
         }},

        {"isolated CPUs", kWorse, "none", "isolcpus=3 nohz_full=3 rcu_nocbs=3 /' /etc/default/grub && sudo update-grub",
         file(std::string(kCpu) + "isolated", "\n")},
        {"isolated CPUs", kWorse, "none", "# add to the kernel's command line, and restart: isolcpus=3",
         all({file(std::string(kCpu) + "isolated", "\n"), gone("etc/default/grub")})},
        {"isolated CPUs", kWorse, "none", "# one processor cannot be set apart",
         all({file(std::string(kCpu) + "isolated", "\n"), answer(&SystemAnswers::processors, 1)})},
        {"isolated CPUs", kUnknown, "not shown", "", gone(std::string(kCpu) + "isolated")},

        {"SMT", kWorse, "on", "echo off | sudo tee /sys/devices/system/cpu/smt/control",
         file(std::string(kCpu) + "smt/active", "1\n")},
        {"SMT", kUnknown, "not shown", "", gone(std::string(kCpu) + "smt")},

        {"heat", kWorse, "throttled 12 times", "# cool the machine",
         all({file(std::string(kCpu) + "cpu0/thermal_throttle/core_throttle_count", "5\n"),
              file(std::string(kCpu) + "cpu1/thermal_throttle/core_throttle_count", "7\n")})},
        {"heat", kUnknown, "not shown", "",
         [](MadeUp& machine) {
             for (const char* cpu : {"cpu0", "cpu1", "cpu2", "cpu3"})
                 machine.remove(std::string(kCpu) + cpu + "/thermal_throttle");
         }},

        {"CPU quota", kWorse, "1.50 processors' time", "echo max | sudo tee /sys/fs/cgroup/user.slice/cpu.max",
         file("sys/fs/cgroup/user.slice/cpu.max", "150000 100000\n")},
        {"CPU quota", kWorse, "0.50 processors' time",
         "echo max | sudo tee /sys/fs/cgroup/user.slice/session.scope/cpu.max",
         [](MadeUp& machine) {  // the tightest of them
             machine.write("sys/fs/cgroup/user.slice/cpu.max", "150000 100000\n");
             machine.write("sys/fs/cgroup/user.slice/session.scope/cpu.max", "5000 10000\n");
         }},
        {"CPU quota", kWorse, "in a container, 2.00 processors' time", "docker update --cpus 0 CONTAINER",
         [](MadeUp& machine) {
             machine.write("proc/self/cgroup", "0::/\n");  // as a container sees its own group
             machine.write(".dockerenv", "");
             machine.write("sys/fs/cgroup/cpu.max", "200000 100000\n");
         }},
        {"CPU quota", kWorse, "0.25 processors' time", "echo -1 | sudo tee /sys/fs/cgroup/cpu/a/cpu.cfs_quota_us",
         all({file("proc/self/cgroup", "2:cpu:/a/b\n1:name=systemd:/c\n"),
              file("sys/fs/cgroup/cpu/a/cpu.cfs_quota_us", "25000\n"),
              file("sys/fs/cgroup/cpu/a/cpu.cfs_period_us", "100000\n"),
              file("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n")})},
        {"CPU quota", kGood, "in a container, none", "", file("proc/self/cgroup", "0::/docker/abc\n")},
        {"CPU quota", kUnknown, "not shown", "", gone("proc/self/cgroup")},

        {"virtual machine", kWorse, "yes", "virsh vcpupin", file("proc/cpuinfo", "flags\t\t: fpu hypervisor lahf\n")},
        {"virtual machine", kUnknown, "not shown", "", gone("proc/cpuinfo")},

        {"clock source", kWorse, "hpet", "echo tsc | sudo tee /sys/devices/system/clocksource/",
         file("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n")},
        {"clock source", kWorse, "acpi_pm", "sudo dmesg | grep -i -e tsc",
         all({file("sys/devices/system/clocksource/clocksource0/current_clocksource", "acpi_pm\n"),
              file("sys/devices/system/clocksource/clocksource0/available_clocksource", "hpet acpi_pm\n")})},
        {"clock source", kGood, "arch_sys_counter", "",
         file("sys/devices/system/clocksource/clocksource0/current_clocksource", "arch_sys_counter\n")},
        {"clock source", kUnknown, "not shown", "", gone("sys/devices/system/clocksource")},

        {"huge pages", kWorse, "[always] madvise never",
         "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled",
         file("sys/kernel/mm/transparent_hugepage/enabled", "[always] madvise never\n")},
        {"huge pages", kUnknown, "not shown", "", gone("sys/kernel/mm")},

        {"/dev/shm", kMissing, "this user cannot make a file there: Permission denied", "sudo chmod 1777 /dev/shm",
         answer(&SystemAnswers::sharedMemoryError, EACCES)},
        {"/dev/shm", kMissing, "Read-only", "sudo mount -o remount,rw /dev/shm",
         answer(&SystemAnswers::sharedMemoryError, EROFS)},
        {"/dev/shm", kMissing, "No such file", "sudo mkdir -p /dev/shm && sudo mount -t tmpfs",
         answer(&SystemAnswers::sharedMemoryError, ENOENT)},
        {"/dev/shm", kMissing, "No space left", "ls -lS /dev/shm", answer(&SystemAnswers::sharedMemoryError, ENOSPC)},
        {"/dev/shm", kMissing, "No space left", "docker run --shm-size 64m",
         all({file(".dockerenv", ""), answer(&SystemAnswers::sharedMemoryError, ENOSPC)})},
        {"/dev/shm", kWorse, "64 kB", "sudo mount -o remount,size=64m /dev/shm",
         answer(&SystemAnswers::sharedMemorySize, 64 * 1024)},

        {"UDP on this machine", kMissing, "does not come: Network is unreachable", "sudo ip link set lo up",
         answer(&SystemAnswers::udpError, ENETUNREACH)},
        {"UDP on this machine", kWorse, "room for 4 kB", "sudo sysctl -w net.core.rmem_default=212992",
         answer(&SystemAnswers::udpBuffer, 4096)},
    };
}

TEST(MachineCheck, EachThingThatIsWorseIsToldWithItsRemedy) {
    for (const Change& change : listChanges()) {
        SCOPED_TRACE(std::string(change.name) + ", " + change.found);
        MadeUp machine;
        change.make(machine);
        const std::vector<MachineLine> lines = machine.check();
        const MachineLine line = find(lines, change.name);
        EXPECT_EQ(line.level, change.level) << line.found;
        expectContains(line.found, {change.found});
        expectContains(line.remedy, {change.remedy});
        expectRemedies(lines);
        // Nothing else has changed, but for what is of one piece: a limit and its try, one processor and which is apart.
        const auto getPiece = [](const MachineLine& of) {
            return of.name == "SCHED_FIFO" ? "priority limit" : of.name == "isolated CPUs" ? "processors" : of.name;
        };
        for (const MachineLine& other : lines)
            EXPECT_TRUE(other.level == MachineLevel::Good || getPiece(other) == getPiece(line)) << other.name;

        machine.answers.isRoot = true;  // and may have no sudo
        const std::vector<MachineLine> ofRoot = machine.check();
        expectRemedies(ofRoot);
        for (const MachineLine& other : ofRoot) EXPECT_EQ(other.remedy.find("sudo"), std::string::npos) << other.remedy;
    }
}

TEST(MachineCheck, RootThatIsRefusedAPriorityIsInAContainer) {
    MadeUp machine;
    machine.answers.isRoot = true;
    machine.answers.prioritySoft = machine.answers.priorityHard = 0;
    machine.answers.priorityError = EPERM;
    expectContains(find(machine.check(), "SCHED_FIFO").remedy, {"docker run --cap-add sys_nice"});
    expectContains(find(machine.check(), "priority limit").found, {"(root)"});
}

TEST(MachineCheck, ALineSaysWhyALoopIsNotOfRealTime) {
    SystemAnswers answers;
    answers.room.limit = MemoryRoom::kUnlimited;
    EXPECT_EQ(explainNotRealTime(answers), "");
    answers.priorityError = EPERM;
    EXPECT_EQ(explainNotRealTime(answers), "SCHED_FIFO is refused");
    answers.room = {8 * kMega, 300 * kMega, 8 * kMega};
    EXPECT_EQ(explainNotRealTime(answers), "SCHED_FIFO is refused, memory cannot be locked");
}

TEST(MachineCheck, FilesThatAreMissingOrNonsenseAreNotShownAndNothingThrows) {
    const TemporaryFolder empty;
    const SystemAnswers answers = MadeUp().answers;
    for (const MachineLine& line : checkMachine(answers, empty.path()))
        EXPECT_TRUE(line.level == MachineLevel::Good || line.level == MachineLevel::Unknown) << line.name;
    MadeUp machine;
    for (const char* path : {"proc/sys/kernel/sched_rt_runtime_us", "proc/sys/kernel/sched_rt_period_us",
                             "proc/self/cgroup", "sys/fs/cgroup/user.slice/cpu.max", "sys/kernel/realtime"}) {
        machine.write(path, std::string("\x1b[31m\0::,,\n:::\n\xff", 16));
        expectRemedies(machine.check());
    }
    machine.write(std::string(kCpu) + "cpu0/cpufreq/scaling_governor", "\x1b[31mred\n");
    EXPECT_EQ(find(machine.check(), "CPU governor").found.find('\x1b'), std::string::npos);
}

TEST(MachineCheck, ThisMachineAnswersAndKeepsNothing) {
    const SystemAnswers answers = askSystem();
    EXPECT_FALSE(answers.kernelRelease.empty());
    EXPECT_GE(answers.processors, 1);
    EXPECT_EQ(answers.isRoot, geteuid() == 0);
    EXPECT_EQ(sched_getscheduler(0) & ~SCHED_RESET_ON_FORK, SCHED_OTHER);
    expectRemedies(checkMachine(answers));
    for (const auto& entry : std::filesystem::directory_iterator("/dev/shm"))
        EXPECT_EQ(entry.path().filename().string().rfind("viable-doctor-" + std::to_string(getpid()), 0),
                  std::string::npos);
}

}  // namespace
}  // namespace viable::test
