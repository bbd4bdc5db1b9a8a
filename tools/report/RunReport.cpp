#include "report/RunReport.h"

#include <deque>

#include "core/AtOnce.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "experiment/RunningCase.h"
#include "log/LogMetadata.h"
#include "records/LogReader.h"
#include "report/Obstacles.h"
#include "report/Page.h"
#include "report/Scene.h"
#include "report/Tracks.h"

namespace viable {

namespace {

namespace fs = std::filesystem;
using detail::BinaryBlock;
using detail::format;
using nlohmann::json;

/** What is drawn of one joint over time: name in the page's data, and value in a row. */
struct Quantity {
    const char* name;
    double (*get)(const TickRecord&, int joint);
    bool needsRealArm;
};

double at(const JointVector& v, int i) {
    return i < v.size() ? v[i] : kNan;
}

const Quantity kQuantities[] = {
    {"nominal_q", [](const TickRecord& r, int i) { return at(r.nominal.q, i); }, false},
    {"nominal_qd", [](const TickRecord& r, int i) { return at(r.nominal.qd, i); }, false},
    {"nominal_qdd", [](const TickRecord& r, int i) { return at(r.nominal.qdd, i); }, false},
    {"nominal_jerk", [](const TickRecord& r, int i) { return at(r.nominal.jerk, i); }, false},
    {"real_q", [](const TickRecord& r, int i) { return at(r.real.q, i); }, true},
    {"real_qd", [](const TickRecord& r, int i) { return at(r.real.qd, i); }, true},
    {"error", [](const TickRecord& r, int i) { return at(r.real.q, i) - at(r.nominal.q, i); }, true},
    // The bound is one of the true arm; readings deviate by noise and rounding besides.
    {"error_true", [](const TickRecord& r, int i) { return at(r.actual.q, i) - at(r.nominal.q, i); }, true},
    {"error_velocity", [](const TickRecord& r, int i) { return at(r.actual.qd, i) - at(r.nominal.qd, i); }, true},
    {"tau_desired", [](const TickRecord& r, int i) { return at(r.desiredTorque, i); }, false},
    {"tau_filter", [](const TickRecord& r, int i) { return at(r.filterTorque, i); }, false},
    {"tau_robust", [](const TickRecord& r, int i) { return at(r.robustTorque, i); }, true},
    {"tau_motor", [](const TickRecord& r, int i) { return at(r.motorTorque, i); }, true},
    {"margin", [](const TickRecord& r, int i) { return r.stops[i].margin; }, false},
    {"position_lower", [](const TickRecord& r, int i) { return at(r.limits.position.lower, i); }, false},
    {"position_upper", [](const TickRecord& r, int i) { return at(r.limits.position.upper, i); }, false},
    {"velocity_lower", [](const TickRecord& r, int i) { return at(r.limits.velocity.lower, i); }, false},
    {"velocity_upper", [](const TickRecord& r, int i) { return at(r.limits.velocity.upper, i); }, false},
    {"acceleration_lower", [](const TickRecord& r, int i) { return at(r.limits.acceleration.lower, i); }, false},
    {"acceleration_upper", [](const TickRecord& r, int i) { return at(r.limits.acceleration.upper, i); }, false},
    {"jerk_lower", [](const TickRecord& r, int i) { return at(r.limits.jerk.lower, i); }, false},
    {"jerk_upper", [](const TickRecord& r, int i) { return at(r.limits.jerk.upper, i); }, false},
};
constexpr std::size_t kQuantityCount = std::size(kQuantities);
/** Differentiated once and twice from the measured velocity, as Fig. 9 of the paper shows them. */
constexpr const char* kDerivatives[] = {"real_qdd", "real_jerk"};
/** Columns that only some logs have, by name: what pushes the real arm from outside. */
constexpr std::size_t kExternal = kQuantityCount + std::size(kDerivatives);
constexpr std::size_t kTracksPerJoint = kExternal + 1;
/** Of the whole arm, after those of the joints: clearance, pressing force, distance of each arm's tool from its command. */
constexpr std::size_t kArmTracks = 4;
/** Buckets of rows at most: what a wide screen shows, and what shows each row of half a minute when it is enlarged. Even. */
constexpr std::size_t kShownBuckets = 4000, kFullBuckets = 32000;

/** What the replay shows of a tick's clearance, in this order. */
const LimitReport& getNearest(const TickRecord& r) {
    return r.reports[LimitKind::Clearance];
}
constexpr double (*kNearest[])(const TickRecord&) = {
    [](const TickRecord& r) { return getNearest(r).isKnown ? getNearest(r).margin : kNan; },
    [](const TickRecord& r) { return double(getNearest(r).link); },
    [](const TickRecord& r) { return double(getNearest(r).other); },
    [](const TickRecord& r) { return double(getNearest(r).otherLink); },
    [](const TickRecord& r) { return getNearest(r).onArm.x(); },
    [](const TickRecord& r) { return getNearest(r).onArm.y(); },
    [](const TickRecord& r) { return getNearest(r).onArm.z(); },
    [](const TickRecord& r) { return getNearest(r).onOther.x(); },
    [](const TickRecord& r) { return getNearest(r).onOther.y(); },
    [](const TickRecord& r) { return getNearest(r).onOther.z(); },
};

constexpr int kFirstArmKind = static_cast<int>(kFirstArmLimit), kArmBits = 2 * (kFirstArmKind - 1);
static_assert(kArmBits + kMostLimitKinds - kFirstArmKind <= 16, "the page has 16 bits for acting limits");

/** A limit's bit in the page: 1 position_lower, 2 position_upper, 4 velocity_lower, ... 512 torque_upper, then one for each
limit of the whole arm; 0 none. */
std::uint16_t toBit(const JointIntervention& joint) {
    if (joint.limit == LimitKind::None) return 0;
    const int kind = static_cast<int>(joint.limit);
    const int place =
        kind < kFirstArmKind ? 2 * (kind - 1) + (joint.side == LimitSide::Upper) : kArmBits + kind - kFirstArmKind;
    return static_cast<std::uint16_t>(1u << place);
}

/** The names of the bits. */
json describeBits() {
    json names = json::array();
    for (int kind = 1; kind < kFirstArmKind; ++kind)
        for (const LimitSide side : {LimitSide::Lower, LimitSide::Upper})
            names.push_back(getName(static_cast<LimitKind>(kind), side));
    for (const LimitKind kind : listArmLimits()) names.push_back(getName(kind, getLimitRow(kind).side));
    return names;
}

/** How many ticks took how long. */
class TickTimes {
public:
    void add(double us, double tick_us) {
        if (!(us > 0.0)) return;
        times_.add_us(us);
        countLate(us, tick_us);
    }
    void countLate(double us, double tick_us) { late_ += us >= tick_us; }
    json describe() const {
        json edges = json::array(), counts = json::array();
        times_.visitCoarseBuckets([&](std::int64_t lower_ns, std::int64_t upper_ns, std::int64_t count) {
            if (edges.empty()) edges.push_back(1e-3 * static_cast<double>(std::max<std::int64_t>(lower_ns, 1)));
            edges.push_back(1e-3 * static_cast<double>(upper_ns));
            counts.push_back(count);
        });
        return {{"edges_us", edges}, {"counts", counts}, {"late", late_}};
    }

private:
    LatencyHistogram times_;
    std::int64_t late_ = 0;  // that took a tick or longer
};

/** The columns external.<joint>.tau_Nm; none where the log has not all of them. */
std::vector<const LogColumn*> findExternalTorque(const LogReader& reader) {
    std::vector<const LogColumn*> columns;
    for (const std::string& joint : reader.layout().jointNames)
        for (const LogColumn& column : reader.columns())
            if (column.name() == "external." + joint + ".tau_Nm") columns.push_back(&column);
    if (columns.size() != reader.layout().jointNames.size()) columns.clear();
    return columns;
}

/** Per joint what holds in the whole run: the limits of the real joint, when the nominal arm has tighter ones, and how
far the real joint may be from the nominal one. Infinities are left out. */
std::vector<json> readConstants(const LogMetadata& metadata, std::size_t n) {
    std::vector<json> joints(n, json::object());
    const auto add = [&](const char* name, const JointVector& values) {
        for (std::size_t i = 0; i < n; ++i)
            if (const double x = values[static_cast<Eigen::Index>(i)]; std::isfinite(x)) joints[i][name] = x;
    };
    if (const std::optional<JointLimits>& limits = metadata.realLimits) {
        add("real_position_lower", limits->position.lower);
        add("real_position_upper", limits->position.upper);
        add("real_velocity_lower", limits->velocity.lower);
        add("real_velocity_upper", limits->velocity.upper);
    }
    if (const auto& bound = metadata.bound) {
        add("bound_position", bound->position);
        add("bound_velocity", bound->velocity);
        add("bound_measured", bound->measured);
    }
    return joints;
}

/** Where the real arm's tool is; empty: there is no such arm, or its robot's folder is not there any more. */
std::function<Pose(const JointVector&)> findTool(const LogReader& reader, const LogMetadata& metadata) {
    try {
        if (!reader.layout().hasRealPlant) return nullptr;
        const RobotDescription robot = loadRobot(metadata.robot);  // another one by now?
        if (robot.jointNames() == reader.layout().jointNames) return makeToolCalculator(robot);
    } catch (const Error&) {
    }
    return nullptr;
}

/** Everything of one log that the page shows. */
class CaseData {
public:
    CaseData(const LogReader& reader, const LogMetadata& metadata, std::size_t buckets)
        : n_(static_cast<int>(reader.layout().jointNames.size())),
          hasRealArm_(reader.layout().hasRealPlant),
          external_(findExternalTorque(reader)),
          constants_(readConstants(metadata, reader.layout().jointNames.size())),
          hasEnvironment_(reader.layout().limits.has(LimitKind::Clearance)),
          hasContact_(reader.layout().hasContact),
          hasToolCommand_(reader.layout().commandSpace == MotionCommand::Space::Tool),
          links_(metadata.links.value_or(std::vector<std::string>())),
          obstacles_(metadata.obstacles.value_or(std::vector<std::string>())),
          calcTool_(findTool(reader, metadata)),
          tracks_(reader.layout().jointNames.size() * kTracksPerJoint + kArmTracks, buckets),
          limits_(reader.layout().jointNames.size(), detail::CodeTracks::Join::Union, buckets),
          status_(1, detail::CodeTracks::Join::Largest, buckets),
          nominal_(reader.layout().jointNames.size()),
          real_(reader.layout().jointNames.size()),
          rest_(reader.layout().jointNames.size()),
          nearest_(std::size(kNearest) + 1),
          values_(reader.layout().jointNames.size() * kTracksPerJoint + kArmTracks, kNan),
          pose_(reader.layout().jointNames.size()),
          actives_(reader.layout().jointNames.size()) {}

    void add(const TickRecord& r) {
        if (rows_ == 0) firstTime_s_ = r.time_s;
        if (rows_ == 1) tick_s_ = r.time_s - firstTime_s_;
        addTake(r);
        for (int i = 0; i < n_; ++i) {
            for (std::size_t k = 0; k < kQuantityCount; ++k) values_[index(i, k)] = kQuantities[k].get(r, i);
            double &acceleration = values_[index(i, kQuantityCount)], &jerk = values_[index(i, kQuantityCount + 1)];
            const double last = acceleration;
            acceleration = rows_ > 0 && tick_s_ > 0.0 ? (at(r.real.qd, i) - at(lastVelocity_, i)) / tick_s_ : kNan;
            jerk = (acceleration - last) / tick_s_;  // not a number before the third row
            if (!external_.empty()) values_[index(i, kExternal)] = external_[i]->getNumber(r);
            actives_[i] = toBit(r.joints[i]);
        }
        lastVelocity_ = r.real.qd;
        if (hasEnvironment_) addClearance(r);
        if (hasContact_) addContact(r.contact, r.time_s);
        if (hasToolCommand_) addTool(r);
        tracks_.add(values_);
        limits_.add(actives_);
        // 0 passed, 1 modified, 2 stopped_by_plan, 3 recovering, 4 infeasible, 5 invalid or faulted.
        status_.add({std::min<std::uint16_t>(static_cast<std::uint16_t>(r.status), 5)});
        addPose(nominal_, r.nominal.q);
        if (hasRealArm_) addPose(real_, r.real.q);
        // How long a tick is only the second row tells: whether the first one was late, too.
        const double tick_us = rows_ > 0 ? 1e6 * tick_s_ : std::numeric_limits<double>::infinity();
        if (rows_ == 0) firstCompute_us_ = r.compute_us;
        if (rows_ == 1) times_.countLate(firstCompute_us_, tick_us);
        times_.add(r.compute_us, tick_us);
        if (r.interval_us > 0.0) jitter_.add(std::abs(r.interval_us - 1e6 * tick_s_), tick_us);
        ++rows_;
    }

    json describe(BinaryBlock& block) const {
        json joints = json::array();
        for (int i = 0; i < n_; ++i) {
            json series = constants_[i];
            for (std::size_t k = 0; k < kQuantityCount; ++k)
                series[kQuantities[k].name] =
                    isShown(kQuantities[k]) ? describeSeries(index(i, k), block) : json(nullptr);
            for (std::size_t k = 0; k < std::size(kDerivatives); ++k)
                series[kDerivatives[k]] =
                    hasRealArm_ ? describeArray(index(i, kQuantityCount + k), block) : json(nullptr);
            if (!external_.empty()) series["tau_external"] = describeArray(index(i, kExternal), block);
            joints.push_back({{"series", series}, {"active", block.add(limits_.codes(static_cast<std::size_t>(i)))}});
        }
        const double tick = tick_s_ > 0.0 ? tick_s_ : 1e-3;
        json one = {{"rows", rows_},
                    {"tick_s", tick},
                    {"t0", firstTime_s_},
                    {"step_s", tick * static_cast<double>(tracks_.rowsPerBucket())},
                    {"buckets", tracks_.buckets()},
                    {"joints", joints},
                    {"status", block.add(status_.codes(0))},
                    {"tick_time", times_.describe()},
                    {"jitter", jitter_.describe()},
                    {"takes", takes_},
                    {"replay",
                     {{"step_s", tick * static_cast<double>(nominal_.rowsPerSample())},
                      {"n", nominal_.count()},
                      {"nominal", block.add(nominal_.data())},
                      {"real", hasRealArm_ ? block.add(real_.data()) : json(nullptr)}}}};
        if (hasContact_) {
            one["replay"]["contact"] = block.add(contact_.data());
            one["contact"] = {{"obstacles", obstacles_},
                              {"pressing", describeArray(contactTrack(), block)},
                              {"peak_N", hardest_.pressing},
                              {"peak_s", hardest_s_},
                              {"peak_obstacle", hardest_.obstacle},
                              {"last_N", values_[contactTrack()]}};
        }
        if (hasToolCommand_)
            one["tool"] = {{"nominal", describeArray(toolTrack(), block)},
                           {"real", calcTool_ ? describeArray(toolTrack() + 1, block) : json(nullptr)}};
        if (!hasEnvironment_) return one;
        one["replay"]["rest"] = block.add(rest_.data());
        one["replay"]["nearest"] = block.add(nearest_.data());
        const bool hasLooked = isKnown(clearanceTrack());  // a filter
        one["clearance"] = {{"links", links_},
                            {"obstacles", obstacles_},
                            {"distance", hasLooked ? describeArray(clearanceTrack(), block) : json(nullptr)},
                            {"environment", nullptr}};
        return one;
    }

private:
    /** What the true arm does wrong is of interest beside its bound. */
    bool isShown(const Quantity& quantity) const {
        if (std::string(quantity.name).rfind("error_", 0) == 0 && !constants_.at(0).contains("bound_position"))
            return false;
        return !quantity.needsRealArm || hasRealArm_;
    }
    std::size_t index(int joint, std::size_t quantity) const {
        return static_cast<std::size_t>(joint) * kTracksPerJoint + quantity;
    }
    std::size_t clearanceTrack() const { return index(n_, 0); }
    std::size_t contactTrack() const { return index(n_, 1); }
    std::size_t toolTrack() const { return index(n_, 2); }
    void addTool(const TickRecord& r) {
        const auto calcDistance = [&](const Pose& tool) { return (tool.position - r.command.tool.position).norm(); };
        values_[toolTrack()] = calcDistance(r.tool);
        if (calcTool_)
            values_[toolTrack() + 1] = calcDistance(calcTool_(r.actual.q.size() == n_ ? r.actual.q : r.real.q));
    }
    void addPose(detail::Samples& samples, const JointVector& q) {
        for (int i = 0; i < n_; ++i) pose_[i] = at(q, i);
        samples.add(pose_);
    }
    void addTake(const TickRecord& r) {
        if (r.take > 0 && r.take != take_) takes_.push_back({{"number", r.take}, {"from_s", r.time_s}});
        if (r.take > 0) takes_.back()["to_s"] = r.time_s;
        take_ = r.take;
    }
    /** The clearance of a row, where the stop rests and how long it takes. */
    void addClearance(const TickRecord& r) {
        double duration_s = 0.0;
        for (int i = 0; i < n_; ++i) {
            const TickRecord::Stop& stop = r.stops[i];
            pose_[i] = stop.rest;
            duration_s = std::max(duration_s, stop.duration_s);
        }
        rest_.add(pose_);
        nearestRow_.clear();
        for (const auto get : kNearest) nearestRow_.push_back(get(r));
        nearestRow_.push_back(duration_s);
        nearest_.add(nearestRow_);
        values_[clearanceTrack()] = nearestRow_.front();
    }
    void addContact(const ContactReport& contact, double time_s) {
        const auto &f = contact.force, &p = contact.point;
        contact_.add(
            {contact.pressing, f.x(), f.y(), f.z(), p.x(), p.y(), p.z(), static_cast<double>(contact.obstacle)});
        values_[contactTrack()] = contact.pressing;
        if (!(contact.pressing > hardest_.pressing)) return;
        hardest_ = contact;
        hardest_s_ = time_s;
    }
    /** A number where the value never changes, null where there is none (no limit), else an array. */
    json describeSeries(std::size_t track, BinaryBlock& block) const {
        const std::vector<float>&least = tracks_.least(track), &largest = tracks_.largest(track);
        const std::string name = kQuantities[track % kTracksPerJoint].name;
        const bool isLimit = name.find("_lower") != std::string::npos || name.find("_upper") != std::string::npos;
        if (isLimit && !isKnown(track)) return nullptr;
        if (isLimit && std::all_of(least.begin(), least.end(), [&](float x) { return x == least[0]; }) &&
            least == largest)
            return least[0];
        return describeArray(track, block);
    }
    bool isKnown(std::size_t track) const {
        const std::vector<float>& least = tracks_.least(track);
        return std::any_of(least.begin(), least.end(), [](float x) { return !std::isnan(x); });
    }

    json describeArray(std::size_t track, BinaryBlock& block) const {
        const std::vector<float>&least = tracks_.least(track), &largest = tracks_.largest(track);
        if (tracks_.rowsPerBucket() == 1) return block.add(least);
        std::vector<float> both;
        both.reserve(2 * least.size());
        for (std::size_t i = 0; i < least.size(); ++i) {
            both.push_back(least[i]);
            both.push_back(largest[i]);
        }
        return block.add(both);
    }

    int n_;
    bool hasRealArm_;
    std::vector<const LogColumn*> external_;  // one per joint, or none
    std::vector<json> constants_;             // of each joint
    bool hasEnvironment_, hasContact_, hasToolCommand_;
    json links_, obstacles_;                            // names
    std::function<Pose(const JointVector&)> calcTool_;  // of the real arm; empty: nobody knows
    detail::Tracks tracks_;
    detail::CodeTracks limits_, status_;
    detail::Samples nominal_, real_, rest_, nearest_, contact_{8, detail::Samples::Keep::Largest};
    ContactReport hardest_;
    double hardest_s_ = 0.0;
    std::vector<double> values_, pose_, nearestRow_;
    std::vector<std::uint16_t> actives_;
    TickTimes times_, jitter_;
    json takes_ = json::array();
    std::int64_t take_ = 0;  // of the last row
    JointVector lastVelocity_;
    std::int64_t rows_ = 0;
    double firstTime_s_ = 0.0, firstCompute_us_ = 0.0, tick_s_ = 0.0;
};

/** A.part2.mcap and so on, of a log in several files (LogSeries): shown is the first one. */
bool isLaterPart(const fs::path& log) {
    const std::string part = log.stem().extension().string();
    return part.size() > 5 && part.compare(0, 5, ".part") == 0 &&
           part.find_first_not_of("0123456789", 5) == std::string::npos;
}

/** The logs of a run: in the summary's order, then what it does not name (a run that was killed has none). */
std::vector<fs::path> listLogs(const fs::path& folder, const json& summary) {
    std::vector<fs::path> logs;
    std::error_code failed;
    for (const json& one : summary.value("cases", json::array()))
        for (const char* extension : {".recovered.mcap", ".mcap"}) {
            const fs::path log = folder / (one.value("name", "") + extension);
            if (!fs::is_regular_file(log, failed)) continue;
            logs.push_back(log);
            break;
        }
    std::vector<fs::path> others;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder, failed)) {
        const fs::path& log = entry.path();
        if (log.extension() != ".mcap" || isLaterPart(log) || std::find(logs.begin(), logs.end(), log) != logs.end())
            continue;
        // Of a log that was recovered only the whole one is shown.
        if (log.stem().extension() != ".recovered" &&
            fs::exists(fs::path(log).replace_extension(".recovered.mcap"), failed))
            continue;
        others.push_back(log);
    }
    std::sort(others.begin(), others.end());
    logs.insert(logs.end(), others.begin(), others.end());
    return logs;
}

/** The case of a log: X.mcap, or X.recovered.mcap. */
std::string getCase(const fs::path& log) {
    const fs::path stem = log.stem();
    return stem.extension() == ".recovered" ? stem.stem().string() : stem.string();
}

/** The unit of distances that are of all joints together, a thousandth. */
const char* getSharedUnit(const json& joints) {
    const auto slides = [](const json& joint) { return joint.value("kind", "") == "prismatic"; };
    const auto count = std::count_if(joints.begin(), joints.end(), slides);
    return count == 0 ? "mrad" : count == static_cast<std::ptrdiff_t>(joints.size()) ? "mm" : "mrad and mm";
}

/** A figure of a limit of the whole arm, of a case of summary.json; null: it has none.
@param arm  "nominal", "real" */
json findFigure(const json& one, LimitKind kind, const char* arm, const LimitFigure::Member& member) {
    const LimitRow& row = getLimitRow(kind);
    const json block = one.value(row.block, json(nullptr));
    const json record = block.is_object() ? block.value(arm, json(nullptr)) : json(nullptr);
    if (!record.is_object()) return nullptr;
    for (const LimitFigure& figure : row.figures)
        if (figure.member == member) return record.value(figure.key, json(nullptr));
    return nullptr;
}
std::optional<std::int64_t> countBroken(const json& one, LimitKind kind, const char* arm) {
    const json ticks = findFigure(one, kind, arm, &ArmLimitRecord::brokenTicks);
    return ticks.is_number_integer() ? std::optional(ticks.get<std::int64_t>()) : std::nullopt;
}

/** How far an arm was from its command, RMS. @param arm  "" or "real_" */
std::string formatCommandError(const json& one, const std::string& arm, const char* unit) {
    const auto find = [&](const char* key) { return one.value(arm + key, json(nullptr)); };
    const json tool = find("tool_error_rms_m"), angle = find("tool_error_rms_rad"),
               joints = find("command_error_rms_rad");
    if (tool.is_number() && angle.is_number())
        return format("%.3g mm, %.3g\u00b0", 1e3 * tool.get<double>(), angle.get<double>() / kDegree);
    return joints.is_number() ? format("%.3g %s", 1e3 * joints.get<double>(), unit) : "-";
}

/** The comparison of the cases, from summary.json. @param joints  of the robot, as the page has them */
json describeTable(const json& summary, const std::vector<fs::path>& logs, const json& joints) {
    const char* const unit = getSharedUnit(joints);
    json rows = json::array();
    std::string missing;
    const json cases = summary.value("cases", json::array());
    std::vector<LimitKind> shown = {LimitKind::Clearance};
    json columns = {"case", "filter", "command error", "command error, real"};
    for (const char* name : {"position", "velocity", "acceleration", "jerk", "outside", "real - nominal max",
                             "real - nominal RMS", "infeasible", "changed", "chatter", "collisions", "least clearance",
                             "collisions, real", "least clearance, real"})
        columns.push_back(name);
    const auto isCounted = [&](LimitKind kind) {
        return std::any_of(cases.begin(), cases.end(),
                           [&](const json& one) { return countBroken(one, kind, "nominal").has_value(); });
    };
    for (const LimitKind kind : listArmLimits()) {
        const LimitRow& row = getLimitRow(kind);
        if (kind == LimitKind::Clearance || row.heading == "-" || !isCounted(kind)) continue;
        shown.push_back(kind);
        for (const char* end : {"", ", real"}) {
            columns.push_back(row.label + ", ticks beyond" + end);
            columns.push_back(row.label + ", worst" + end);
        }
    }
    const bool hasContact =
        std::any_of(cases.begin(), cases.end(), [](const json& one) { return one.contains("contact"); });
    for (const char* column : {"touched", "largest force", "force at the end"})
        if (hasContact) columns.push_back(column);
    for (const json& one : cases) {
        const std::string name = one.value("name", "");
        const bool hasLog =
            std::any_of(logs.begin(), logs.end(), [&](const fs::path& log) { return getCase(log) == name; });
        if (!hasLog) missing += (missing.empty() ? " Without a log here: " : ", ") + name;
        json row = json::array({one.value("name", ""), one.value("filter", ""), formatCommandError(one, "", unit),
                                formatCommandError(one, "real_", unit)});
        for (const char* quantity : {"position", "velocity", "acceleration", "jerk"}) {
            double worst = 0.0;
            bool exists = false, isEndless = false;
            for (const auto& joint : one.at("limits").at(quantity).items()) {
                const json& use = joint.value().at("worst_use");
                exists |= !use.is_null();
                isEndless |= use.is_string();
                if (use.is_number()) worst = std::max(worst, use.get<double>());
            }
            row.push_back(!exists ? "no limit" : isEndless ? "inf" : detail::formatPercent(worst) + " %");
        }
        std::int64_t outside = 0;
        for (const auto& quantity : one.at("limits").items())
            for (const auto& joint : quantity.value().items())
                outside += joint.value().value("ticks_outside", std::int64_t{0});
        row.push_back(std::to_string(outside));
        const json& tracking = one.contains("tracking") ? one["tracking"] : json(nullptr);
        for (const char* key : {"max_rad", "rms_rad"})
            row.push_back(tracking.is_object() ? detail::formatPlain(1e3 * tracking.value(key, 0.0)) + " " + unit
                                               : "-");
        row.push_back(std::to_string(one.value("infeasible_ticks", std::int64_t{0})));
        const double changed = one.value("changed_share", kNan);
        row.push_back(std::isnan(changed) ? "-" : format("%.1f %%", 100.0 * changed));
        const json chatter = one.value("chatter", json(nullptr));
        row.push_back(chatter.is_number() ? format("%.3g %%", 100.0 * chatter.get<double>()) : "-");
        for (const LimitKind kind : shown) {
            const bool isLength = kind == LimitKind::Clearance;
            for (const char* arm : {"nominal", "real"}) {
                const auto ticks = countBroken(one, kind, arm);
                row.push_back(ticks ? std::to_string(*ticks) : "-");
                const json worst = findFigure(one, kind, arm, &ArmLimitRecord::worst);
                row.push_back(worst.is_number() ? format("%.3g %s", (isLength ? 1e3 : 1.0) * worst.get<double>(),
                                                         isLength ? "mm" : getUnit(kind, false))
                                                : "-");
            }
        }
        if (hasContact) {
            const json contact = one.value("contact", json(nullptr));
            const bool touches = contact.is_object() && contact.value("ticks", std::int64_t{0}) > 0;
            row.push_back(touches ? contact.value("obstacle", "") : contact.is_object() ? "nothing" : "-");
            for (const char* force : {"peak_N", "last_N"})
                row.push_back(touches ? format("%.3g N", contact.value(force, 0.0)) : "-");
        }
        rows.push_back(row);
    }
    return {
        {"columns", columns},
        {"rows", rows},
        {"note",
         std::string("Worst use of each limit by the nominal arm. outside: joint-ticks beyond any limit; "
                     "infeasible: ticks ") +
             "without an admissible choice; changed: share of ticks that the filter changed; command error: RMS "
             "distance of the tool, or of the joints, to the commanded ones within the limits; chatter: RMS jerk of "
             "joints pressed against a position limit at rest, in percent of the jerk limit." +
             (isCounted(LimitKind::Clearance)
                  ? " collisions: ticks in which the arm touches an obstacle or itself; least clearance: "
                    "in the whole run, as found afterwards without the filter."
                  : "") +
             (hasContact ? " touched: by the real arm, where it presses hardest." : "") +
             (missing.empty() ? "" : missing + ".")}};
}

/** The cases' resolved files in one: what stands before the cases once, as far as it is the same. */
std::string joinFiles(const std::vector<std::string>& files) {
    const std::string mark = "\ncases:\n";
    std::string text;
    for (const std::string& file : files) {
        const std::size_t begin = file.find(mark);
        const bool continues = begin != std::string::npos && !text.empty() &&
                               text.compare(0, begin + mark.size(), file, 0, begin + mark.size()) == 0;
        if (continues)
            text += file.substr(begin + mark.size());
        else
            text += (text.empty() ? "" : "\n# what differs\n") + file;
    }
    return text;
}

/** The names of a case's plugins of a kind: of the library .../viable_filter_tosbp.so it is "tosbp". */
std::string getPlugin(const LogMetadata& metadata, const std::string& kind) {
    const auto entry = metadata.libraries.find(kind);
    if (entry == metadata.libraries.end()) return "";
    const std::string prefix = "viable_" + kind + "_";
    std::string names;
    for (const std::string& library : entry->second) {
        const std::string stem = fs::path(library).stem().string();
        detail::addItem(names, stem.rfind(prefix, 0) == 0 ? stem.substr(prefix.size()) : stem, " + ");
    }
    return names;
}

/** What `viable verify` found out about a case, from CASE.verify.json beside its log. Only what is of the form that the
page knows goes into it. Throws std::exception with the reason where the file is damaged or of something else. */
class VerificationFile {
public:
    /** @param shift_s  time of the log's first row; the file's times count from there */
    VerificationFile(const fs::path& file, double shift_s, BinaryBlock& block)
        : file_(file), shift_s_(shift_s), block_(block) {}

    json read(const std::string& caseName, const std::vector<std::string>& joints) const {
        const json all = json::parse(readWhole(file_).value_or(""), nullptr, false);
        if (!all.is_object()) throw std::runtime_error("it is not a JSON object, or cut off");
        if (const json& schema = all.at("schema"); schema != 1)
            throw std::runtime_error("it has schema " + schema.dump(-1, ' ', true, json::error_handler_t::replace) +
                                     ", this version knows 1");
        const std::string source = fs::path(all.at("log").get<std::string>()).filename().string();
        if (getCase(source) != caseName) throw std::runtime_error("it is about " + source);
        json one = {{"signal", all.value("signal", "real")},
                    {"verdict", readVerdict(all)},
                    {"confidence", all.at("confidence").get<double>()},
                    {"excess", all.at("excess").get<double>()},
                    {"excess_duration_s", all.at("excess_duration_s").get<double>()},
                    {"begin_s", all.at("begin_s").get<double>() + shift_s_},
                    {"end_s", all.at("end_s").get<double>() + shift_s_},
                    {"samples", all.at("samples").get<std::int64_t>()},
                    {"joints", json::array()}};
        std::vector<std::string> names;
        for (const json& joint : all.at("joints")) names.push_back(joint.at("name").get<std::string>());
        if (names != joints) throw std::runtime_error("its joints are not those of the log");
        for (const json& joint : all.at("joints")) one["joints"].push_back(readJoint(joint));
        return one;
    }

private:
    static constexpr const char* kJudged[] = {"position", "velocity", "acceleration", "jerk"};
    static constexpr const char* kVerdicts[] = {"held", "broken", "cannot_tell", "no_limit"};
    /** Lower and upper end of what is drawn: in the page, in the file. */
    static constexpr const char* kCurves[][3] = {
        {"raw", "raw_least", "raw_largest"}, {"mean", "mean_least", "mean_largest"}, {"band", "low", "high"}};

    static std::string readVerdict(const json& from) {
        const std::string word = from.at("verdict").get<std::string>();
        if (std::find(std::begin(kVerdicts), std::end(kVerdicts), word) == std::end(kVerdicts))
            throw std::runtime_error("it has an unknown verdict");
        return word;
    }
    /** The numbers of these names, null where the file has null. */
    static json readNumbers(const json& from, std::initializer_list<const char*> names) {
        json numbers = json::object();
        for (const char* name : names) {
            const json& value = from.at(name);
            numbers[name] = value.is_null() ? json(nullptr) : json(value.get<double>());
        }
        return numbers;
    }
    json readJoint(const json& from) const {
        json one = readNumbers(from, {"noise", "quantum", "window_s", "left_out"});
        one["unit"] = from.at("unit").get<std::string>();
        const json& trouble = from.at("trouble");
        one["trouble"] = trouble.is_null() ? json(nullptr) : json(trouble.get<std::string>());
        for (const char* name : kJudged) one["limits"][name] = readLimit(from.at("limits").at(name));
        const json& curves = from.at("curves");
        one["curves"] = curves.is_null() ? json(nullptr) : readCurves(curves);
        return one;
    }
    json readLimit(const json& from) const {
        json one = readNumbers(from, {"lower", "upper", "lowest", "highest", "deviation", "judged", "visible_excess"});
        one["verdict"] = readVerdict(from);
        one["unit"] = from.at("unit").get<std::string>();
        one["broken"] = nullptr;
        if (one["verdict"] != "broken") return one;
        const json& broken = from.at("broken");
        one["broken"] = {{"side", broken.at("side") == "upper" ? "upper" : "lower"},
                         {"first_s", broken.at("first_s").get<double>() + shift_s_},
                         {"worst_s", broken.at("worst_s").get<double>() + shift_s_},
                         {"excess", broken.at("excess").get<double>()},
                         {"certain_excess", broken.at("certain_excess").get<double>()},
                         {"duration_s", broken.at("duration_s").get<double>()}};
        return one;
    }
    json readCurves(const json& from) const {
        const double step_s = from.at("step_s").get<double>();
        const std::size_t n = from.at("n").get<std::size_t>();
        if (!(step_s > 0.0) || n == 0) throw std::runtime_error("it has curves without times");
        json all = {{"t0", from.at("t0").get<double>() + shift_s_}, {"step_s", step_s}, {"n", n}};
        for (const char* quantity : kJudged)
            for (const auto& [name, lower, upper] : kCurves)
                all[quantity][name] =
                    block_.add(joinPairs(from.at(quantity).at(lower), from.at(quantity).at(upper), n));
        return all;
    }
    /** Two arrays of numbers in turns; null is not a number. */
    static std::vector<float> joinPairs(const json& lower, const json& upper, std::size_t n) {
        if (!lower.is_array() || !upper.is_array() || lower.size() != n || upper.size() != n)
            throw std::runtime_error("it has curves that do not fit together");
        std::vector<float> both;
        both.reserve(2 * n);
        for (std::size_t i = 0; i < n; ++i)
            for (const json* end : {&lower[i], &upper[i]}) {
                const double x = end->is_null() ? kNan : end->get<double>();
                both.push_back(static_cast<float>(
                    std::abs(x) <= static_cast<double>(std::numeric_limits<float>::max()) ? x : kNan));
            }
        return both;
    }

    fs::path file_;
    double shift_s_;
    BinaryBlock& block_;
};

/** Adds what `viable verify` left beside a case's log; where that cannot be used, a note why. */
void addVerification(const fs::path& log, const LogReader& reader, json& one, BinaryBlock& block) {
    const fs::path file = nameVerificationFile(log);
    std::error_code failed;
    if (!fs::exists(file, failed)) return;
    const auto note = [&](const std::string& why) {
        one["verification_note"] = file.filename().string() + " is not shown: " + why + ".";
    };
    try {
        const VerificationFile verification(file, one.at("t0").get<double>(), block);
        one["verification"] = verification.read(getCase(log), reader.layout().jointNames);
    } catch (const json::exception& problem) {
        const std::string text = problem.what();  // after the library's own number of the error
        const std::size_t begin = text.find("] ");
        note("it is damaged: " + (begin == std::string::npos ? text : text.substr(begin + 2)));
    } catch (const std::exception& problem) {
        note(problem.what());
    }
}

/** So many are read at once: each takes some megabytes, and a file that is open. */
constexpr std::size_t kOpenLogs = 8;

/** A log, its rows read or not yet. */
struct OpenLog {
    OpenLog(fs::path log, std::size_t buckets)
        : file(std::move(log)),
          reader(file),
          metadata(readLogMetadata(reader.metadata(), reader.layout().jointNames)),
          data(reader, metadata, buckets) {}
    void readRows() {
        TickRecord record;
        while (reader.read(record)) data.add(record);
    }

    fs::path file;
    LogReader reader;
    LogMetadata metadata;
    CaseData data;
};

json describeCase(const OpenLog& log, const json& summary, BinaryBlock& block) {
    const LogReader& reader = log.reader;
    const LogMetadata& metadata = log.metadata;
    json one = log.data.describe(block);
    one["name"] = getCase(log.file);
    one["filter"] = getPlugin(metadata, "filter");
    one["robust_loop"] = getPlugin(metadata, "robust_loop");
    one["plant"] = getPlugin(metadata, "plant");
    one["guarantees"] = false;
    const char* const noEnd = "the log has no end: the run was killed or is still running";
    one["verdict"] = reader.isComplete() ? "there is no summary of this case" : noEnd;
    one["grade"] = "doubtful";
    one["stop"] = nullptr;
    one["details"] = "";
    for (const json& known : summary.value("cases", json::array())) {
        if (known.value("name", "") != one["name"]) continue;
        one["guarantees"] = known.value("guarantees_limits", known.value("promises_limits", false));
        const std::string stop = known.value("stop", "");
        const bool isEnded = known.value("exit_code", 1) != 0 || stop.find(" ended the case: ") != std::string::npos;
        // Older summaries have no grade, and do not tell all that makes a case worse.
        const char* const atBest = isEnded ? "failed" : known.value("limits_kept", false) ? "doubtful" : "broken";
        const std::string grade = known.value("grade", atBest);
        if (reader.isComplete() || grade != "good") one["grade"] = grade;
        one["verdict"] = (reader.isComplete() ? "" : std::string(noEnd) + "; ") + known.value("verdict", "");
        const std::string sentence = known.value("sentence", "");  // older summaries have none
        one["sentence"] = (reader.isComplete() || sentence.empty() ? "" : std::string(noEnd) + "; ") + sentence;
        one["details"] = known.value("account", "");
        if (!stop.empty()) one["stop"] = {{"time_s", known.value("stop_time_s", 0.0)}, {"message", stop}};
    }
    addVerification(log.file, reader, one, block);
    return one;
}

Error refuseSummary(const fs::path& folder) {
    return badInput((folder / "summary.json").string(), "this is not a summary of a run",
                    "Run the experiment again, or remove the file: the report is then made from the logs alone.");
}

/** An empty object where there is no file. */
json readSummary(const fs::path& folder) {
    const std::string text = readWhole(folder / "summary.json").value_or("");
    json summary = text.empty() ? json::object() : json::parse(text, nullptr, false);
    if (!summary.is_object()) throw refuseSummary(folder);
    return summary;
}

/** What one page can show together: logs of the same arm. */
struct Arm {
    std::string robot;  ///< its folder
    std::vector<std::string> joints;
    std::vector<fs::path> logs;
};

std::vector<Arm> groupByArm(const std::vector<fs::path>& logs) {
    std::vector<Arm> arms;
    for (const fs::path& log : logs) {
        const LogReader reader(log);
        const std::string robot = readLogMetadata(reader.metadata(), reader.layout().jointNames).robot;
        const std::vector<std::string>& joints = reader.layout().jointNames;
        const auto same = std::find_if(arms.begin(), arms.end(),
                                       [&](const Arm& arm) { return arm.robot == robot && arm.joints == joints; });
        if (same == arms.end())
            arms.push_back({robot, joints, {log}});
        else
            same->logs.push_back(log);
    }
    return arms;
}

/** The joints as the page wants them; which of them slide is in the log. */
json describeJoints(const OpenLog& log) {
    const std::vector<std::string>& sliding = log.metadata.prismaticJoints;
    json joints = json::array();
    for (const std::string& name : log.reader.layout().jointNames) {
        const bool slides = std::find(sliding.begin(), sliding.end(), name) != sliding.end();
        joints.push_back({{"name", name}, {"kind", slides ? "prismatic" : "revolute"}});
    }
    return joints;
}

/** The title in the resolved experiment file; empty where there is none. */
std::string findTitle(const std::vector<std::string>& files) {
    try {
        for (const std::string& file : files)
            if (const ConfigNode root = parseConfig(file, "experiment.yaml"); root.find("title"))
                return root.find("title")->text;
    } catch (const Error&) {
    }
    return "";
}

/** What stood around the arm in the cases, equal surroundings once. */
class Environments {
public:
    /** The index of the surroundings of a log's case; null where it has none.
    @param map  the hash of its map. @param file  the resolved experiment file of the case */
    json add(const std::string& map, const std::string& file, const fs::path& robot, BinaryBlock& block) {
        try {
            const ConfigNode root = parseConfig(file, "experiment.yaml");
            const ConfigNode* environment = root.find("environment");
            if (!environment) return nullptr;
            const auto [known, isNew] = indices_.emplace(map + writeConfig(*environment), nullptr);
            if (!isNew) return known->second;
            json one = detail::describeEnvironment(*environment, map, robot, block);
            if (one.is_null()) return nullptr;
            known->second = list_.size();
            list_.push_back(std::move(one));
            return known->second;
        } catch (const Error&) {
            return nullptr;  // a report of a log of another version must not need its file
        }
    }
    const json& list() const { return list_; }

private:
    std::map<std::string, json> indices_;  // by the map's and the block's text
    json list_ = json::array();
};

/** Throws json::exception where the summary has another shape. */
fs::path composeReport(const fs::path& folder, const std::string& fileName, const detail::Page& page, const Arm& arm,
                       const json& summary, std::size_t buckets) {
    BinaryBlock block;
    json data = {{"format", 1},        {"file", summary.value("experiment", "")},
                 {"robot", nullptr},   {"scene", nullptr},
                 {"summary", nullptr}, {"cases", json::array()}};
    std::vector<std::string> yaml;
    Environments environments;
    for (std::size_t first = 0; first < arm.logs.size(); first += kOpenLogs) {
        std::deque<OpenLog> logs;
        for (std::size_t i = first; i < std::min(arm.logs.size(), first + kOpenLogs); ++i)
            logs.emplace_back(arm.logs[i], buckets);
        detail::forEachAtOnce(logs.size(), [&](std::size_t i) { logs[i].readRows(); });
        for (const OpenLog& log : logs) {
            if (data["robot"].is_null()) {
                data["robot"] = {{"name", fs::path(arm.robot).filename().string()}, {"joints", describeJoints(log)}};
                data["scene"] = detail::describeScene(arm.robot, block, data["robot"]["joints"]);
            }
            json& one = data["cases"].emplace_back(describeCase(log, summary, block));
            for (const LogAttachment& attachment : log.reader.attachments()) {
                if (attachment.name != "experiment.yaml") continue;
                yaml.push_back(attachment.data);
                if (one.contains("clearance"))
                    one["clearance"]["environment"] =
                        environments.add(log.metadata.mapSha256, attachment.data, arm.robot, block);
            }
        }
    }
    data["summary"] = describeTable(summary, arm.logs, data["robot"].is_null() ? json() : data["robot"]["joints"]);
    if (!environments.list().empty()) data["environments"] = environments.list();
    data["yaml"] = joinFiles(yaml);
    const std::string title = summary.value("title", findTitle(yaml));
    data["limits"] = describeBits();  // of logs that have been read
    data["title"] = title.empty() ? folder.filename().string() : title;
    const fs::path file = folder / fileName;
    page.write(file, std::move(data), block);
    return file;
}

}  // namespace

fs::path nameVerificationFile(const fs::path& log) {
    return log.parent_path() / (getCase(log) + ".verify.json");
}

std::vector<fs::path> writeReport(const fs::path& folder, const fs::path& pageFile, bool isFull) {
    std::error_code failed;
    if (!fs::is_directory(folder, failed))
        throw badInput(folder.string(), "there is no such folder", "Name the folder of a run.");
    const detail::Page page(pageFile);
    try {
        const fs::path run = fs::canonical(folder);
        const json summary = readSummary(run);
        const std::vector<fs::path> logs = listLogs(run, summary);
        if (logs.empty())
            throw badInput(folder.string(), "there is no log (.mcap) in this folder", "Name the folder of a run.");
        std::vector<fs::path> reports;
        for (const Arm& arm : groupByArm(logs)) {
            const std::string name =
                reports.empty() ? "report.html" : "report_" + std::to_string(reports.size() + 1) + ".html";
            reports.push_back(composeReport(run, name, page, arm, summary, isFull ? kFullBuckets : kShownBuckets));
        }
        return reports;
    } catch (const json::exception&) {
        throw refuseSummary(folder);
    }
}

}  // namespace viable
