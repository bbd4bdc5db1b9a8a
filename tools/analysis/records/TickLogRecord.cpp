#include <algorithm>
#include <cmath>

#include "analysis/records/RecordReaders.h"
#include "core/Text.h"
#include "log/LogMetadata.h"
#include "records/LogReader.h"

namespace viable::detail {

static bool areSame(const JointVector& a, const JointVector& b) {
    return a.size() == b.size() && (a.array() == b.array()).all();
}

static bool areSame(const JointBounds& a, const JointBounds& b) {
    return areSame(a.lower, b.lower) && areSame(a.upper, b.upper);
}

/** False also for limits that hold something that is NaN. */
static bool areSame(const JointLimits& a, const JointLimits& b) {
    return areSame(a.position, b.position) && areSame(a.velocity, b.velocity) &&
           areSame(a.acceleration, b.acceleration) && areSame(a.jerk, b.jerk);
}

static bool isWhole(const JointLimits& limits, Eigen::Index n) {
    for (const JointBounds* bounds : {&limits.position, &limits.velocity, &limits.acceleration, &limits.jerk})
        if (bounds->lower.size() != n || bounds->upper.size() != n) return false;
    return areSame(limits, limits);
}

MotionRecord readTickLog(const std::filesystem::path& file, LoggedArm arm) {
    LogReader reader(file);
    const bool isReal = arm == LoggedArm::Real;
    if (isReal && !reader.layout().hasRealPlant)
        throw badInput(file.string(), "the log has no real arm", kNoRealArmRemedy);

    MotionRecord record;
    record.isCutOff = !reader.isComplete();
    const LogMetadata metadata = readLogMetadata(reader.metadata(), reader.layout().jointNames);
    metadata.refuseDamaged(LogMetadata::kPrismaticJoints, file.string());
    for (const std::string& name : reader.layout().jointNames) {
        MotionRecord::Joint joint;
        joint.name = name;
        joint.isPrismatic = std::count(metadata.prismaticJoints.begin(), metadata.prismaticJoints.end(), name) > 0;
        record.joints.push_back(std::move(joint));
    }
    record.robot = metadata.robot;

    const auto n = static_cast<Eigen::Index>(record.joints.size());
    const auto at = [](const JointVector& v, Eigen::Index i) {
        return i < v.size() ? v[i] : std::numeric_limits<double>::quiet_NaN();
    };
    bool isConstant = true, hasTorque = false;
    double first_s = 0.0, last_s = 0.0;
    TickRecord row;
    for (std::size_t count = 1; reader.read(row); ++count) {
        const std::string where = file.string() + ": row " + std::to_string(count);
        if (!std::isfinite(row.time_s))
            throw badInput(where, "its time is not a finite number", "The log was not written by viable");
        if (record.times_s.empty()) {
            first_s = row.time_s;
            record.begin = formatNumber(first_s);
            isConstant = isWhole(row.limits, n);
            if (isConstant) record.limits = row.limits;
        } else if (!(row.time_s - first_s > last_s)) {
            throw notAscending(where, formatNumber(first_s + last_s), formatNumber(row.time_s));
        }
        last_s = row.time_s - first_s;
        record.times_s.push_back(last_s);
        isConstant = isConstant && areSame(row.limits, *record.limits);
        for (Eigen::Index i = 0; i < n; ++i) {
            MotionRecord::Joint& joint = record.joints[i];
            const double q = at(isReal ? row.real.q : row.nominal.q, i);
            if (std::isinf(q)) throw infiniteReading(where + ", time " + formatNumber(row.time_s) + " s", joint.name);
            joint.positions.push_back(q);
            if (!isReal) continue;
            joint.torques.push_back(at(row.motorTorque, i));
            hasTorque = hasTorque || std::isfinite(joint.torques.back());
        }
    }
    if (!hasTorque)
        for (MotionRecord::Joint& joint : record.joints) joint.torques.clear();
    if (!isConstant) record.limits.reset();
    if (isReal && record.limits) {
        metadata.refuseDamaged(LogMetadata::kRealLimits, file.string());
        if (metadata.realLimits) {  // what the run held on the real arm
            record.limits->position = metadata.realLimits->position;
            record.limits->velocity = metadata.realLimits->velocity;
        }
    }
    return record;
}

}  // namespace viable::detail
