#include <CLI/CLI.hpp>
#include <csignal>

#include "Commands.h"
#include "analysis/smoothing/LimitVerdict.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "report/RunReport.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

/** Exit code where no limit is broken for certain, but some may be. */
constexpr int kCannotTell = 7;

struct VerifyArguments {
    std::string file, limits, signal = "real", json;
    MotionRecordOptions record;
    JudgeOptions judge;
    bool report = false;
};

/** Leaves the joints that the robot has. @param missing  is given the robot's joints that the record lacks */
std::vector<AxisLimits> readRobotLimits(const std::string& name, MotionRecord& record, std::string& missing) {
    const RobotDescription robot = loadRobot(findRobot(name, makeRobotSearchPath({}), "--limits"));
    std::vector<AxisLimits> limits;
    std::vector<MotionRecord::Joint> joints;
    std::string without;
    const std::vector<std::string> names = robot.jointNames();
    for (MotionRecord::Joint& joint : record.joints) {
        const auto found = std::find(names.begin(), names.end(), joint.name);
        if (found == names.end()) {
            detail::addItem(without, joint.name);
            continue;
        }
        const auto place = static_cast<int>(found - names.begin());
        const bool isPrismatic = robot.joints[place].type == JointType::Prismatic;
        if (isPrismatic != joint.isPrismatic && record.saysUnits)
            throw badInput(record.source + ": joint " + joint.name,
                           std::string("its readings are in ") + (joint.isPrismatic ? "m" : "rad") + "; in robot " +
                               robot.name + " the joint " + (isPrismatic ? "slides" : "turns"),
                           "Correct the unit of the column, or name another robot.");
        joint.isPrismatic = isPrismatic;
        limits.push_back(robot.limits.axis(place));
        joints.push_back(std::move(joint));
    }
    if (joints.empty())
        throw badInput(record.source, "no joint of this record is one of robot " + robot.name + ": " + without,
                       "Its joints are " + detail::join(names) + "; name the record's columns so.");
    for (const std::string& one : names)
        if (std::none_of(joints.begin(), joints.end(), [&](const auto& joint) { return joint.name == one; }))
            detail::addItem(missing, one);
    if (!without.empty())
        std::fprintf(stderr, "viable: robot %s does not have these joints of the record, which are left out: %s\n",
                     robot.name.c_str(), without.c_str());
    record.joints = std::move(joints);
    return limits;
}

std::vector<AxisLimits> findLimits(const VerifyArguments& arguments, MotionRecord& record, std::string& missing) {
    if (!arguments.limits.empty()) return readRobotLimits(arguments.limits, record, missing);
    std::vector<AxisLimits> limits;
    for (std::size_t i = 0; i < record.joints.size(); ++i)
        limits.push_back(
            (record.limits ? *record.limits : JointLimits::unlimited(1)).axis(record.limits ? static_cast<int>(i) : 0));
    return limits;
}

int verify(const VerifyArguments& arguments) {
    std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
    if (arguments.report && fs::path(arguments.file).extension() != ".mcap")
        throw badInput("--report", arguments.file + " is not a log of a run",
                       "Only a run has a report; `--json FILE` writes the verdict of any record.");
    if (!arguments.json.empty()) refuseExisting("--json", arguments.json);
    MotionRecord record = readMotionRecord(arguments.file, arguments.record);
    if (record.isCutOff)
        std::fprintf(stderr,
                     "viable: %s has no end (the run was killed or is still running): its rows so far are judged\n",
                     record.source.c_str());
    std::string missing;
    const std::vector<AxisLimits> limits = findLimits(arguments, record, missing);
    JudgeOptions options = arguments.judge;
    options.hasCurves = !arguments.json.empty() || arguments.report;
    const RecordVerdict verdict = checkRecord(record, limits, options);
    const std::string json = options.hasCurves ? writeJson(verdict, record) : "";
    if (!arguments.json.empty()) writeNew(arguments.json, json);
    std::fputs(writeText(verdict).c_str(), stdout);
    if (!missing.empty()) std::printf("not in the record, so not judged: %s\n", missing.c_str());
    if (verdict.overall() == Finding::NoLimit)
        std::printf("Nothing was judged: %s. `--limits ROBOT` names the robot whose limits count.\n",
                    arguments.limits.empty() ? "the record names no limits" : "the robot has none");
    if (!arguments.json.empty()) std::printf("wrote %s\n", arguments.json.c_str());
    if (arguments.report) {
        const fs::path file = nameVerificationFile(arguments.file);
        replaceFile(file, json);
        std::printf("wrote %s\n", file.c_str());
        const fs::path folder = fs::path(arguments.file).parent_path();
        try {
            for (const fs::path& page : writeReport(folder.empty() ? "." : folder, findShared(kReportPage)))
                std::printf("wrote %s\n", page.c_str());
        } catch (const Error& e) {  // of another log in the folder, say: the verdict stands
            std::fprintf(stderr, "viable: the report was not written: %s\n", e.what());
            if (verdict.overall() == Finding::Held || verdict.overall() == Finding::NoLimit) return e.exitCode();
        }
    }
    if (verdict.overall() == Finding::Broken) return static_cast<int>(ErrorKind::GuaranteeBroken);
    return verdict.overall() == Finding::CannotTell ? kCannotTell : 0;
}

}  // namespace

void addVerifyCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<VerifyArguments>();
    CLI::App* command = app.add_subcommand(
        "verify",
        "Did the joints keep their limits? Judges noisy readings, with error bars. Exit code 0: held, or no limit was "
        "named; 3: broken; 7: cannot be told; 2: bad input; 5: a file was not written");
    command->add_option("LOG", arguments->file, "Log of a case, another MCAP file with joint states, or CSV")
        ->required();
    command->add_option("--limits", arguments->limits, "Robot whose limits count (default: those of the log)");
    command->add_option("--signal", arguments->signal, "real: readings of the real arm (default), or nominal")
        ->check(CLI::IsMember({"real", "nominal"}));
    command->add_option(
        "--columns", arguments->record.columns,
        "NAME:UNIT,...: columns of the CSV to use, with their units (s, ms, us, ns; rad, deg; m, cm, mm)");
    command->add_option("--topic", arguments->record.topic, "Topic of the joint states, where the file has several");
    command->add_option("--confidence", arguments->judge.confidence,
                        "Probability that no limit that was held is called broken, in the whole record (0.99)");
    command->add_option("--excess", arguments->judge.excess,
                        "Share of a limit: an excess of this size must be visible for `held` (0.1)");
    command->add_option("--excess-duration", arguments->judge.excessDuration_s, "How long it lasts, in s (0.05)");
    command->add_option("--json", arguments->json, "Write verdicts and curves to this new file");
    command->add_flag("--report", arguments->report,
                      "Write the report of the run again, with the verdict (CASE.verify.json beside the log)");
    command->callback([arguments, &exitCode] {
        arguments->record.arm = arguments->signal == "nominal" ? LoggedArm::Nominal : LoggedArm::Real;
        exitCode = verify(*arguments);
    });
}

}  // namespace viable
