#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <map>
#include <memory>
#include <set>

#include "Commands.h"
#include "analysis/identification/Identification.h"
#include "core/WholeFile.h"

namespace viable {

namespace {

struct IdentifyArguments {
    std::vector<std::string> files;
    std::string robot, payload = "mass_and_centre", out, json;
    MotionRecordOptions record;
    IdentificationOptions options;
    bool isSampled = false;
};

const std::map<std::string, PayloadModel> kPayloads = {
    {"none", PayloadModel::None}, {"mass", PayloadModel::Mass}, {"mass_and_centre", PayloadModel::MassAndCentre}};

/** The robot that was named, or that of the logs. */
RobotDescription findNominal(const IdentifyArguments& arguments, const std::vector<MotionRecord>& records) {
    std::string name = arguments.robot;
    if (name.empty())
        for (const MotionRecord& record : records) {
            if (record.robot.empty())
                throw badInput(record.source, "the file does not name its robot", "Name it: `--robot NAME`.");
            if (!name.empty() && record.robot != name)
                throw badInput(record.source, "it is a log of robot " + record.robot + ", the previous one of " + name,
                               "Give logs of one robot, or name it: `--robot NAME`.");
            name = record.robot;
        }
    return loadRobot(findRobot(name, makeRobotSearchPath({}), "--robot"));
}

int identifyLogs(const IdentifyArguments& arguments) {
    std::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a write error, not a death
    if (!arguments.json.empty()) refuseExisting("--json", arguments.json);
    if (!arguments.out.empty()) refuseExisting("--out", arguments.out);
    std::vector<MotionRecord> records;
    std::set<std::string> seen;
    for (const std::string& file : arguments.files) {
        std::error_code failed;
        if (!seen.insert(std::filesystem::weakly_canonical(file, failed).string()).second)
            throw badInput(file, "this log is named twice",
                           "Its errors would look smaller than they are: name it once.");
        records.push_back(readMotionRecord(file, arguments.record));
    }
    const RobotDescription nominal = findNominal(arguments, records);
    requireDynamics(nominal, "--robot", "an identification");
    IdentificationOptions options = arguments.options;
    options.payload = kPayloads.at(arguments.payload);
    options.isTorqueHeld = !arguments.isSampled;
    const Identification found = identify(nominal, records, options);
    std::fputs(writeText(found).c_str(), stdout);
    for (const JointIdentification& joint : found.joints)
        if (joint.coulomb.isKnown && joint.coulomb.upper < 0.0)
            throw badInput(arguments.files.front(),
                           "the friction of " + joint.name + " is estimated below zero: it would drive the joint",
                           "Is the sign of the torques that of the positions, and are they the motors' torques at the "
                           "joints? No file was written.");
    if (!arguments.json.empty()) writeNew(arguments.json, writeJson(found));
    if (!arguments.out.empty()) writeNew(arguments.out, writeActuation(nominal, found));
    for (const std::string& file : {arguments.json, arguments.out})
        if (!file.empty()) std::printf("wrote %s\n", file.c_str());
    return 0;
}

}  // namespace

void addIdentifyCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<IdentifyArguments>();
    CLI::App* command = app.add_subcommand(
        "identify", "Joint friction and payload error of a real arm, from logs of its positions and torques");
    command
        ->add_option("LOG", arguments->files,
                     "Logs with positions and torques: .mcap, or CSV with JOINT_rad and JOINT_Nm")
        ->required();
    command->add_option("--robot", arguments->robot, "Robot whose description is used (default: that of the logs)");
    command->add_option("--out", arguments->out, "Write a new actuation.yaml for the robot's folder");
    command->add_option("--json", arguments->json, "Write all figures, with 95 % intervals, to this new file");
    command
        ->add_option("--payload", arguments->payload,
                     "none, mass or mass_and_centre (default): unknown mass at the tool")
        ->check(CLI::IsMember({"none", "mass", "mass_and_centre"}));
    command->add_flag("--body-masses", arguments->options.bodyMasses, "A factor on each body's mass, too");
    command->add_flag("--rotor-inertias", arguments->options.rotorInertias, "Errors of the rotors' inertias, too");
    command->add_flag("--torque-offsets", arguments->options.torqueOffsets, "A constant error of each torque, too");
    command->add_flag(
        "--sampled-torques", arguments->isSampled,
        "A torque is a sample at its time (default: it is held from its row to the next, as in logs of viable)");
    command->add_option("--columns", arguments->record.columns,
                        "NAME:UNIT,...: columns of the CSV to use, with their units");
    command->add_option("--topic", arguments->record.topic, "Topic of the joint states, where the file has several");
    command->callback([arguments, &exitCode] { exitCode = identifyLogs(*arguments); });
}

}  // namespace viable
