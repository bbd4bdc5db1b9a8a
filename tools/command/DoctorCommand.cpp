#include <pwd.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <thread>

#include "Commands.h"
#include "core/Text.h"
#include "doctor/MachineCheck.h"
#include "doctor/MachineMeasure.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

/** Exit code where the measurement could not be made. */
constexpr int kNotMeasured = 7;

constexpr double kShortestMeasure_s = 0.1, kLongestMeasure_s = 86400.0;
constexpr double kShortestTick_s = 50e-6, kLongestTick_s = 0.1;

struct DoctorArguments {
    double measure_s = 5.0, tick_s = 0.001;
    int cpu = -1, priority = 80;
    bool isJson = false;
};

std::string getUserName() {
    const passwd* const user = getpwuid(geteuid());
    return user ? user->pw_name : std::to_string(geteuid());
}

double readLoad() {
    double load = 0.0;
    return getloadavg(&load, 1) == 1 ? load : 0.0;
}

const char* getName(MemoryLock lock) {
    return lock == MemoryLock::All ? "all" : lock == MemoryLock::Present ? "present" : "none";
}

void refuseOutside(const char* option, double value, double lowest, double highest, const char* unit) {
    if (value >= lowest && value <= highest) return;
    throw badInput(option, detail::formatNumber(value) + " is not possible",
                   "Choose " + detail::formatNumber(lowest) + " to " + detail::formatNumber(highest) + unit + ".");
}

void checkArguments(const DoctorArguments& arguments) {
    if (arguments.measure_s != 0.0)
        refuseOutside("--measure", arguments.measure_s, kShortestMeasure_s, kLongestMeasure_s,
                      " s, or 0: no measurement");
    refuseOutside("--tick", arguments.tick_s, kShortestTick_s, kLongestTick_s, " s");
    refuseOutside("--priority", arguments.priority, 1, 99, "");
    const long processors = sysconf(_SC_NPROCESSORS_CONF);
    if (arguments.cpu != -1) refuseOutside("--cpu", arguments.cpu, 0, static_cast<double>(processors - 1), "");
}

/** How the table names the second half. */
std::string describeGranted(const Measurement& measured) {
    std::string text = "SCHED_FIFO " + std::to_string(measured.grantedPriority);
    if (measured.memoryLock != MemoryLock::None) text += ", memory locked";
    if (measured.holdsLatency) text += ", no deep sleep";
    if (measured.cpu >= 0) text += ", CPU " + std::to_string(measured.cpu);
    return text;
}

std::string formatTimes(const LatencyHistogram& times) {
    if (times.count() == 0) return detail::format("%9s %9s %9s %9s", "-", "-", "-", "-");
    return detail::format("%9.1f %9.1f %9.1f %9.1f", times.calcQuantile_us(0.5), times.calcQuantile_us(0.99),
                          times.calcQuantile_us(0.999), 1e-3 * static_cast<double>(times.worst_ns()));
}

std::string formatCount(const LoopTimes& times, std::int64_t count) {
    if (times.ticks == 0) return "-";
    return std::to_string(count) + " of " + std::to_string(times.ticks);
}

void printTable(const Measurement& measured, double load) {
    constexpr int kName = 31, kHalf = 39;
    std::printf("\nMeasured for %g s at a tick of %g ms, in turns, beside a load of %.1f on %u processors:\n\n",
                measured.duration_s, 1e3 * measured.tick_s, load, std::thread::hardware_concurrency());
    std::printf("%-*s   %-*s   %s\n", kName, "", kHalf, "without priority",
                measured.grantedPriority > 0 ? describeGranted(measured).c_str() : "with priority: refused");
    const std::string head = detail::format("%9s %9s %9s %9s", "p50", "p99", "p99.9", "worst");
    std::printf("%-*s   %s   %s\n", kName, "[us]", head.c_str(), head.c_str());
    const auto printRow = [&](const char* name, LatencyHistogram LoopTimes::*times) {
        std::printf("%-*s   %s   %s\n", kName, name, formatTimes(measured.plain.*times).c_str(),
                    formatTimes(measured.priority.*times).c_str());
    };
    printRow("wake-up, late by", &LoopTimes::wakeUp);
    printRow("the same work, takes", &LoopTimes::work);
    printRow("UDP, another process and back", &LoopTimes::udp);
    printRow("shared memory, there and back", &LoopTimes::sharedMemory);
    const auto printCount = [&](const char* name, std::int64_t LoopTimes::*count) {
        std::printf("%-*s   %*s   %*s\n", kName, name, kHalf,
                    formatCount(measured.plain, measured.plain.*count).c_str(), kHalf,
                    formatCount(measured.priority, measured.priority.*count).c_str());
    };
    printCount("ticks missed", &LoopTimes::missed);
    printCount("answers lost", &LoopTimes::lost);
    if (!measured.refusals.empty()) std::printf("\nRefused with priority:\n");
    for (const RealTimeRefusal& refusal : measured.refusals)
        std::printf("  %s: %s\n", refusal.what.c_str(), refusal.why.c_str());
}

void printLines(const std::vector<MachineLine>& lines, const SystemAnswers& answers) {
    std::printf("Real time on this machine, for the user %s:\n\n", makePrintable(getUserName()).c_str());
    for (const MachineLine& line : lines) {
        std::printf("%-8s %-22s %s\n", getName(line.level), line.name.c_str(), line.found.c_str());
        if (!line.remedy.empty()) std::printf("             %s\n", line.remedy.c_str());
    }
    const std::string why = explainNotRealTime(answers);
    if (why.empty())
        std::printf("\nA loop of this user gets a real-time priority and locked memory.\n");
    else
        std::printf("\nA loop of this user runs as not real time: %s.\n", why.c_str());
}

nlohmann::json makeJson(const LoopTimes& times) {
    return {{"wake_up", times.wakeUp.toJson()},
            {"work", times.work.toJson()},
            {"udp_round_trip", times.udp.toJson()},
            {"shared_memory_round_trip", times.sharedMemory.toJson()},
            {"ticks", times.ticks},
            {"ticks_missed", times.missed},
            {"answers_lost", times.lost}};
}

nlohmann::json makeJson(const Measurement& measured, double load) {
    nlohmann::json json = {{"duration_s", measured.duration_s},
                           {"tick_s", measured.tick_s},
                           {"load", load},
                           {"without_priority", makeJson(measured.plain)},
                           {"with_priority", nullptr},
                           {"refused", nlohmann::json::array()}};
    for (const RealTimeRefusal& refusal : measured.refusals)
        json["refused"].push_back({{"what", refusal.what}, {"why", refusal.why}, {"remedy", refusal.remedy}});
    if (measured.grantedPriority > 0) {
        nlohmann::json& half = json["with_priority"] = makeJson(measured.priority);
        half["priority"] = measured.grantedPriority;
        half["memory_lock"] = getName(measured.memoryLock);
        half["holds_latency"] = measured.holdsLatency;
        half["cpu"] = measured.cpu;
    }
    return json;
}

nlohmann::json makeJson(const std::vector<MachineLine>& lines, const SystemAnswers& answers) {
    nlohmann::json json = {{"user", makePrintable(getUserName())},
                           {"real_time", explainNotRealTime(answers).empty()},
                           {"not_real_time_because", explainNotRealTime(answers)},
                           {"lines", nlohmann::json::array()},
                           {"measured", nullptr}};
    for (const MachineLine& line : lines)
        json["lines"].push_back(
            {{"name", line.name}, {"found", line.found}, {"level", getName(line.level)}, {"remedy", line.remedy}});
    return json;
}

int runDoctor(const DoctorArguments& arguments) {
    checkArguments(arguments);
    const SystemAnswers answers = askSystem(arguments.priority);
    const std::vector<MachineLine> lines = checkMachine(answers);
    if (!arguments.isJson) {
        printLines(lines, answers);
        std::fflush(stdout);  // before the measurement, which lasts
    }
    std::optional<Measurement> measured;
    std::string trouble;
    const double load = readLoad();  // of others
    if (arguments.measure_s > 0.0) {
        if (!arguments.isJson) std::fprintf(stderr, "measuring for %g s ...\n", arguments.measure_s);
        try {
            measured =
                measureMachine({arguments.measure_s, arguments.tick_s, {arguments.cpu, arguments.priority, true}});
        } catch (const std::system_error& e) {
            trouble = e.what();
        }
    }
    if (arguments.isJson) {
        nlohmann::json json = makeJson(lines, answers);
        if (measured) json["measured"] = makeJson(*measured, load);
        if (!trouble.empty()) json["not_measured_because"] = trouble;
        std::printf("%s\n", json.dump(1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    } else if (measured) {
        printTable(*measured, load);
    }
    if (trouble.empty()) return 0;
    std::fprintf(stderr,
                 "viable: the measurement could not be made: %s. See the lines on /dev/shm, UDP and processes above "
                 "(`ulimit -u`, `ulimit -n`).\n",
                 trouble.c_str());
    return kNotMeasured;
}

}  // namespace

void addDoctorCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<DoctorArguments>();
    CLI::App* command =
        app.add_subcommand("doctor",
                           "Can this machine run a loop in real time? A remedy for what it lacks, and a measurement. "
                           "Exit code 0: told, whatever it found; 7: the measurement could not be made");
    command->add_option("--measure", arguments->measure_s, "For how long [s], both halves together; 0: not at all")
        ->capture_default_str();
    command->add_option("--tick", arguments->tick_s, "Tick of the measured loop [s]")->capture_default_str();
    command->add_option("--cpu", arguments->cpu, "Processor of the measured loop with priority; -1: any")
        ->capture_default_str();
    command->add_option("--priority", arguments->priority, "Of SCHED_FIFO, 1 to 99")->capture_default_str();
    command->add_flag("--json", arguments->isJson, "All of it for programs, with the histograms");
    command->callback([arguments, &exitCode] { exitCode = runDoctor(*arguments); });
}

}  // namespace viable
