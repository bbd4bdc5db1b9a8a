#include "page/LiveFrame.h"

#include "report/Obstacles.h"
#include "report/Scene.h"

namespace viable {

namespace {

using nlohmann::json;

/** Writes numbers, or only their names and counts. */
class Writer {
public:
    explicit Writer(bool describes) : describes_(describes) {}

    void add(const char* name, double value) { add(name, &value, 1, 1); }
    /** @param given  of `count` numbers; where there are fewer, the rest are not numbers */
    void add(const char* name, const double* values, Eigen::Index given, Eigen::Index count) {
        if (describes_) return fields_.push_back({name, count});
        for (Eigen::Index i = 0; i < count; ++i) {
            const double value = i < given ? values[i] : kNan;
            bytes_.append(reinterpret_cast<const char*>(&value),
                          sizeof value);  // little-endian, as all machines it runs on
        }
    }
    void add(const char* name, const Pose& pose) {
        const auto& q = pose.orientation;
        const double values[] = {pose.position.x(), pose.position.y(), pose.position.z(), q.w(), q.x(), q.y(), q.z()};
        add(name, values, 7, 7);
    }

    json releaseFields() { return std::move(fields_); }
    std::string releaseBytes() { return std::move(bytes_); }

private:
    const bool describes_;
    json fields_ = json::array();
    std::string bytes_;
};

int codeOf(const JointIntervention& joint) {
    if (joint.limit == LimitKind::None) return 0;
    return 2 * static_cast<int>(joint.limit) - (joint.side == LimitSide::Upper ? 0 : 1);
}

void write(Writer& out, double now_s, const LiveStatus& status, const TeleoperationFeed::Status* hand, int n) {
    const TickRecord& record = status.record;
    out.add("now_s", now_s);
    out.add("time_s", status.time_s);
    out.add("command_s", status.commandTime_s);
    out.add("state", static_cast<double>(status.state));
    out.add("take", static_cast<double>(record.take));
    out.add("missed", static_cast<double>(status.missed));
    out.add("lost_rows", static_cast<double>(status.lostRows));
    out.add("worst_us", status.worstCompute_us);
    out.add("compute_us", record.compute_us);
    out.add("braking", record.braking ? 1.0 : 0.0);
    out.add("status", static_cast<double>(record.status));
    out.add("hand", hand ? static_cast<double>(hand->state) : kNan);
    out.add("refusal", hand ? static_cast<double>(hand->refusal) : kNan);
    out.add("hand_age_s", hand ? hand->age_s : kNan);
    out.add("tool", record.tool);
    out.add("target", record.command.tool);
    const LimitReport& nearest = record.reports[LimitKind::Clearance];
    out.add("clearance", nearest.isKnown ? nearest.margin : kNan);
    const double places[] = {static_cast<double>(nearest.link), static_cast<double>(nearest.other),
                             static_cast<double>(nearest.otherLink)};
    out.add("nearest", places, 3, 3);
    out.add("on_arm", nearest.onArm.data(), 3, 3);
    out.add("on_obstacle", nearest.onOther.data(), 3, 3);
    const ContactReport& contact = record.contact;
    out.add("pressing", contact.pressing);
    out.add("force", contact.force.data(), 3, 3);
    out.add("touched_at", contact.point.data(), 3, 3);
    out.add("touched", static_cast<double>(contact.obstacle));

    const auto addJoints = [&](const char* name, const JointVector& values) {
        out.add(name, values.data(), values.size(), n);
    };
    addJoints("q", record.nominal.q);
    addJoints("qd", record.nominal.qd);
    addJoints("qdd", record.nominal.qdd);
    addJoints("jerk", record.nominal.jerk);
    addJoints("real_q", record.real.q);
    addJoints("real_qd", record.real.qd);
    addJoints("tau", record.motorTorque.size() == n ? record.motorTorque : record.filterTorque);
    addJoints("target_q", record.command.q);
    double rest[kMaxJoints], limit[kMaxJoints];
    for (int i = 0; i < n; ++i) {
        rest[i] = record.stops[i].rest;
        limit[i] = codeOf(record.joints[i]);
    }
    out.add("rest_q", rest, n, n);
    out.add("limit", limit, n, n);
    const JointLimits& limits = record.limits;
    const auto addBounds = [&](const std::string& name, const JointBounds& bounds) {
        addJoints((name + "_lower").c_str(), bounds.lower);
        addJoints((name + "_upper").c_str(), bounds.upper);
    };
    addBounds("position", limits.position);
    addBounds("velocity", limits.velocity);
    addBounds("acceleration", limits.acceleration);
    addBounds("jerk_limit", limits.jerk);
}

}  // namespace

json describeFrame(int joints) {
    Writer writer(true);
    write(writer, 0.0, {}, nullptr, joints);
    return writer.releaseFields();
}

std::string encodeFrame(double now_s, const LiveStatus& status, const TeleoperationFeed::Status* hand) {
    Writer writer(false);
    write(writer, now_s, status, hand, static_cast<int>(status.record.nominal.q.size()));
    return writer.releaseBytes();
}

std::string describeLive(const CasePlan& plan, const std::string& title, bool hasHand, bool movesJoints,
                         bool takesObstacles, bool hasContact) {
    detail::BinaryBlock block;
    json joints = json::array();
    for (const JointDescription& joint : plan.robot.joints) joints.push_back({{"name", joint.name}});
    json all;
    all["format"] = 1;
    all["title"] = title;
    all["case"] = plan.name;
    all["scene"] = detail::describeScene(plan.robot.folder, block, joints);
    all["robot"] = {{"name", plan.robot.name}, {"joints", joints}};
    all["environments"] = json::array();
    json links = json::array(), obstacles = json::array();
    if (const ConfigNode* environment = plan.resolved.find("environment")) {
        json one = detail::describeEnvironment(*environment, "", plan.robot.folder, block);
        if (!one.is_null()) {
            for (const json& obstacle : one["obstacles"]) obstacles.push_back(obstacle["name"]);
            all["environments"].push_back(std::move(one));
        }
        if (plan.geometry) links = plan.geometry->links;
    }
    if (takesObstacles)
        for (const std::string& name : PlacedObstacles::listNames()) obstacles.push_back(name);
    all["places"] = takesObstacles ? PlacedObstacles::kMost : 0;
    all["links"] = links;
    all["obstacles"] = obstacles;
    all["moves"] = !hasHand ? "" : movesJoints ? "joints" : "tool";
    all["has_real"] = plan.realPlant.has_value();
    all["has_contact"] = hasContact;
    all["tick_s"] = plan.tick_s;
    for (int kind = 1; kind < countLimitKinds(); ++kind)
        all["limits"].push_back(getName(static_cast<LimitKind>(kind), LimitSide::Neither));
    all["fields"] = describeFrame(plan.robot.size());
    all["binary"] = block.encode();
    return all.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace viable
