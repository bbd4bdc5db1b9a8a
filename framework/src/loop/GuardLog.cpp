#include "viable/loop/GuardLog.h"

#include "log/LogMetadata.h"
#include "log/Recorder.h"

namespace viable {

static LogOpening makeOpening(const std::filesystem::path& file, const RobotDescription& robot, bool hasRealArm) {
    LogOpening opening;
    opening.layout.jointNames = robot.jointNames();
    // The law of a TorqueGuard has its command for itself: what is there is the tool at the start.
    opening.layout.commandSpace = hasRealArm ? MotionCommand::Space::Tool : MotionCommand::Space::Joint;
    opening.layout.hasRealPlant = opening.layout.hasExternalTorque = hasRealArm;
    LogMetadata metadata;
    metadata.caseName = file.stem().string();
    metadata.version = VIABLE_VERSION;
    if (!robot.folder.empty()) metadata.robot = std::filesystem::absolute(robot.folder).lexically_normal().string();
    for (const JointDescription& joint : robot.joints)
        if (joint.type == JointType::Prismatic) metadata.prismaticJoints.push_back(joint.name);
    opening.metadata = writeLogMetadata(std::move(metadata));
    return opening;
}

struct GuardLog::Inside {
    explicit Inside(std::unique_ptr<LogWriter> writer) : recorder(std::move(writer)) {}
    Recorder recorder;
};

GuardLog::GuardLog(const std::filesystem::path& file, const RobotDescription& robot, bool hasRealArm)
    : inside_(std::make_unique<Inside>(std::make_unique<LogWriter>(file, makeOpening(file, robot, hasRealArm)))) {}
GuardLog::~GuardLog() = default;
GuardLog::GuardLog(GuardLog&&) noexcept = default;
GuardLog& GuardLog::operator=(GuardLog&&) noexcept = default;

bool GuardLog::append(const TickRecord& record) noexcept {
    return inside_->recorder.append(record);
}

std::string GuardLog::finish() {
    return inside_->recorder.finish().error;
}

}  // namespace viable
