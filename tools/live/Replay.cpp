#include "live/Replay.h"

#include <cstring>

#include "core/Text.h"
#include "experiment/ExperimentFile.h"
#include "experiment/RunningCase.h"
#include "live/PlacedObstacles.h"
#include "records/LogReader.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

/** The rows of a log, one file after the other. */
class Rows {
public:
    explicit Rows(const fs::path& file) : file_(file), reader_(std::make_unique<LogReader>(file)) {}

    const LogReader& reader() const { return *reader_; }

    /** Obstacles by hand that came since the last call, oldest first. */
    std::vector<PlacedObstacles::Version> readPlaced() {
        std::vector<PlacedObstacles::Version> all;
        for (; attached_ < reader_->attachments().size(); ++attached_) {
            const LogAttachment& attachment = reader_->attachments()[attached_];
            if (attachment.name.rfind(PlacedObstacles::kAttachment, 0) == 0)
                all.push_back(
                    PlacedObstacles::readVersion(attachment.data, file_.string() + " (" + attachment.name + ")"));
        }
        return all;
    }

    /** False: there are no more. */
    bool read(TickRecord& row) {
        while (!reader_->read(row)) {
            isComplete_ &= reader_->isComplete();
            const fs::path next = LogSeries::nameFile(file_, number_ + 1);
            std::error_code error;
            if (!fs::exists(next, error)) {
                isComplete_ &= LogSeries::listLater(file_).size() < static_cast<std::size_t>(number_);
                return false;
            }
            reader_ = std::make_unique<LogReader>(next);
            attached_ = 0;
            ++number_;
        }
        return true;
    }
    /** Each file has its end, and none is missing; known when all has been read. */
    bool isComplete() const { return isComplete_; }

private:
    const fs::path file_;
    std::unique_ptr<LogReader> reader_;
    std::size_t attached_ = 0;
    int number_ = 1;
    bool isComplete_ = true;
};

/** Puts the obstacles of a log around the arm again, in the very ticks in which its filter learned of them: the age that it
told says so. */
class RecordedSurroundings {
public:
    explicit RecordedSurroundings(const ConfiguredCase& configured) : configured_(configured) {}

    /** Before the tick of a row, which has been read from `rows`. */
    void put(Rows& rows, const TickRecord& row) {
        SurroundingsFeed* const feed = configured_.feed.get();
        if (!feed) return;
        for (PlacedObstacles::Version& version : rows.readPlaced()) ahead_.push_back(std::move(version));
        // An age of 0 is told where the filter did not run; a version is at least a tick old when it does.
        const double tick_s = configured_.plan.tick_s;
        const double age_s = row.reports[LimitKind::Clearance].age_s;
        if (row.missed || age_s < 0.5 * tick_s) return;
        const double stamp_s = row.time_s - age_s, tolerance_s = 0.25 * tick_s;
        for (std::size_t k = 0; k < ahead_.size(); ++k) {
            if (std::abs(ahead_[k].stamp_s - stamp_s) > tolerance_s) continue;
            feed->put(PlacedObstacles::surround(configured_, ahead_[k].all), ahead_[k].stamp_s);
            ahead_.erase(ahead_.begin(), ahead_.begin() + static_cast<std::ptrdiff_t>(k) + 1);
            return;
        }
    }
    /** After it. */
    void renumber(TickRecord& now) const {
        if (configured_.feed && configured_.plan.environment)
            PlacedObstacles::renumber(*configured_.feed->view().surroundings, *configured_.plan.environment,
                                      now.reports[LimitKind::Clearance]);
    }

private:
    const ConfiguredCase& configured_;
    std::deque<PlacedObstacles::Version> ahead_;
};

/** Gives what was recorded; `row` is the present tick's. */
class RecordedCommand : public CommandSource {
public:
    RecordedCommand(MotionCommand::Space space, JointLimits limits, const TickRecord& row)
        : space_(space), limits_(std::move(limits)), row_(row) {}
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    CommandTraits traits() const override { return {space_}; }
    TickStatus sample(double, MotionCommand& out) override {
        out = row_.command;
        out.space = space_;  // a log says it once, not in its rows
        return TickStatus::Ok;
    }
    const JointLimits* sampleLimits(double) override {
        if (isRefused) return &none_;
        const auto isSame = [](const JointBounds& a, const JointBounds& b) {
            return a.lower == b.lower && a.upper == b.upper;
        };
        const JointLimits& now = row_.limits;
        if (isSame(now.position, limits_.position) && isSame(now.velocity, limits_.velocity) &&
            isSame(now.acceleration, limits_.acceleration) && isSame(now.jerk, limits_.jerk))
            return nullptr;
        limits_ = now;
        return &limits_;
    }

    /** The limits that it gave were not usable, as the log does not show. */
    bool isRefused = false;

private:
    const MotionCommand::Space space_;
    JointLimits limits_;
    const JointLimits none_;
    const TickRecord& row_;
};

/** Reports what was read, and gives what the motors gave. What the plant says of itself is asked of the true one. */
class RecordedPlant : public RealPlant {
public:
    RecordedPlant(PluginPtr<RealPlant> plant, const TickRecord& row, const std::int64_t& ticksPassed)
        : plant_(std::move(plant)), row_(row), ticksPassed_(ticksPassed) {}
    void configure(const RunSetup&, const Parameters&) override {}
    /** Where the log's nominal arm began, which of a robot is where that stood. */
    void reset(const MotionState&) override {
        start_ = {row_.nominal.q, row_.nominal.qd};
        isReset_ = plant_->traits().hasClock;  // another one's first reading is that of the first tick
    }
    const JointState& measured() const override { return isReset_ ? start_ : row_.real; }
    const JointState& actual() const override { return row_.actual; }
    TickStatus advance(const JointVector&, JointVector& applied) override {
        applied = row_.motorTorque;
        return TickStatus::Ok;
    }
    const JointVector* externalTorque() const override {
        return plant_->externalTorque() ? &row_.externalTorque : nullptr;
    }
    const ContactReport* contact() const override { return plant_->contact() ? &row_.contact : nullptr; }
    PlantTraits traits() const override { return plant_->traits(); }
    TickStatus read(std::int64_t& ticksPassed) override {
        isReset_ = false;
        ticksPassed = ticksPassed_;
        return isGone ? TickStatus::Faulted : TickStatus::Ok;
    }

    bool isGone = false;

private:
    const PluginPtr<RealPlant> plant_;
    const TickRecord& row_;
    const std::int64_t& ticksPassed_;
    JointState start_;
    bool isReset_ = false;
};

template <class Interface, class Mine>
void put(PluginPtr<Interface>& place, std::unique_ptr<Mine> mine) {
    place = PluginPtr<Interface>(mine.release(), [](void* object) { delete static_cast<Interface*>(object); });
}

/** Measured on the clock: what was computed has no such unit. */
bool isTime(const std::string& column) {
    return column.size() > 3 && column.compare(column.size() - 3, 3, "_us") == 0;
}

bool isSame(double a, double b) {
    return std::memcmp(&a, &b, sizeof a) == 0 || (a != a && b != b);
}

/** "nominal.joint1.q_rad is 0.5 in the log and 0.25 in the replay"; empty: none differs. */
std::string findDifference(const std::vector<LogColumn>& columns, const TickRecord& logged, const TickRecord& now) {
    for (const LogColumn& column : columns) {
        if (isTime(column.name())) continue;
        const bool isNumber = !column.isText() && !column.isInteger();
        if (isNumber && isSame(column.getNumber(logged), column.getNumber(now))) continue;
        const auto show = [&](const TickRecord& row) {
            return isNumber          ? detail::format("%.17g", column.getNumber(row))
                   : column.isText() ? std::string(column.getText(row))
                                     : std::to_string(column.getInteger(row));
        };
        const std::string before = show(logged), after = show(now);
        if (!isNumber && before == after) continue;
        return column.name() + " is " + before + " in the log and " + after + " in the replay";
    }
    return {};
}

/** Why the log's arm began to brake, where the plugins between do not do so themselves: what a log does not say. */
enum class StopCause : unsigned char { None, Asked, PlantGone, LimitsRefused };

/** The same, and in which tick. */
struct Stop {
    StopCause cause = StopCause::None;
    std::int64_t tick = -1;
};

class Replay {
public:
    Replay(const fs::path& log, const CasePlan& plan) : log_(log), plan_(plan) {}

    /** @return the tick in which the log's arm begins to brake and this one's does not; -1: there is none */
    std::int64_t run(const Stop& stop, ReplayResult& result) {
        Rows rows(log_);
        if (rows.reader().layout().hasTouch)
            throw badInput(
                log_.string(),
                "a run with contact_force_N cannot be decided again: the log has not what the torque sensors told",
                "`viable report` and `viable export` show it as it is.");
        auto configured = configureCase(plan_);
        LoopPlugins& plugins = configured->plugins;
        hasClock_ = plugins.realPlant && plugins.realPlant->traits().hasClock;
        auto ownCommand =
            std::make_unique<RecordedCommand>(rows.reader().layout().commandSpace, configured->setup.limits, row_);
        RecordedCommand& command = *ownCommand;
        put(plugins.command, std::move(ownCommand));
        RecordedPlant* plant = nullptr;
        if (plugins.realPlant) {
            auto ownPlant = std::make_unique<RecordedPlant>(std::move(plugins.realPlant), row_, ticksPassed_);
            plant = ownPlant.get();
            put(plugins.realPlant, std::move(ownPlant));
        }
        std::deque<TickRecord> ahead;
        if (fetch(rows, ahead)) row_ = ahead.front();
        RunningCase running(std::move(configured), {}, false);
        ControlLoop& loop = running.loop();
        RecordedSurroundings surroundings(running.configured());
        TickRecord& now = running.record();
        result.ticks = 0;
        result.difference.clear();
        for (std::int64_t k = 0; fetch(rows, ahead); ++k) {
            const TickRecord row = ahead.front();
            if (row.time_s != loop.time()) refuseGap(row.time_s, loop.time());
            // The reading of a plant's clock is for the tick after those that were missed before it.
            row_ = hasClock_ ? ahead.back() : row;
            ticksPassed_ = static_cast<std::int64_t>(ahead.size());
            ahead.pop_front();
            row.paused ? loop.pause() : loop.resume();
            if (k == stop.tick) {
                if (stop.cause == StopCause::Asked) loop.requestStop(StopReason::Requested, "it was asked for");
                command.isRefused = stop.cause == StopCause::LimitsRefused;
                if (plant) plant->isGone = stop.cause == StopCause::PlantGone;
            }
            surroundings.put(rows, row);
            running.showPeople();
            if (row.missed && !hasClock_)
                loop.missTick(now);
            else
                loop.tick(now);
            surroundings.renumber(now);
            now.take = row.take;  // the operator's, and nothing follows from it
            if (row.braking && !now.braking && stop.tick < 0) return k;
            result.difference = findDifference(rows.reader().columns(), row, now);
            if (!result.difference.empty()) {
                result.difference = detail::format("at %.4f s (tick %lld) ", row.time_s, k) + result.difference;
                return -1;
            }
            ++result.ticks;
            result.end_s = row.time_s;
        }
        result.isComplete = rows.isComplete();
        return -1;
    }

private:
    /** `ahead`: the next row, and with a plant's clock all up to the first one that was not missed. */
    bool fetch(Rows& rows, std::deque<TickRecord>& ahead) const {
        while (ahead.empty() || (hasClock_ && ahead.back().missed)) {
            TickRecord row;
            if (!rows.read(row)) break;
            ahead.push_back(row);
        }
        // Of missed ticks at the end of a log that was cut off there the next reading is lost.
        if (hasClock_ && !ahead.empty() && ahead.back().missed) ahead.clear();
        return !ahead.empty();
    }

    [[noreturn]] void refuseGap(double found_s, double expected_s) const {
        throw badInput(log_.string(),
                       detail::format("the next row is of %.4f s, and %.4f s is expected", found_s, expected_s),
                       "A replay needs every tick from the first one on: a log that lost rows to a slow disk, whose "
                       "first file is gone, or that is a take of another one, cannot be replayed.");
    }

    const fs::path log_;
    const CasePlan& plan_;
    TickRecord row_;
    std::int64_t ticksPassed_ = 1;
    bool hasClock_ = false;
};

const std::string& findExperiment(const LogReader& reader, const fs::path& log) {
    for (const LogAttachment& attachment : reader.attachments())
        if (attachment.name == "experiment.yaml") return attachment.data;
    throw badInput(log.string(), "this log carries no experiment.yaml, which tells what to replay",
                   "Name a log that `viable run` or `viable live` has written.");
}

}  // namespace

ReplayResult replayLog(const fs::path& log, const PluginLoader& loader, const std::vector<fs::path>& robotPath) {
    const std::string place = log.string() + " (experiment.yaml)";
    const std::string text = findExperiment(LogReader(log), log);
    const Experiment experiment = readExperiment(parseConfig(text, place), place, {}, loader, robotPath);
    const CasePlan& plan = experiment.cases.front();
    ReplayResult result;
    result.caseName = plan.name;
    Replay replay(log, plan);
    // Each cause of a stop shows by what differs with it: none of them is right in more than one way.
    const std::int64_t tick = replay.run({}, result);
    if (tick >= 0) {
        result.ticks = -1;
        for (const StopCause cause : {StopCause::Asked, StopCause::PlantGone, StopCause::LimitsRefused}) {
            ReplayResult one = result;
            replay.run({cause, tick}, one);
            if (one.ticks > result.ticks) result = one;
            if (one.ticks > tick) break;
        }
    }
    if (result.ticks == 0 && result.difference.empty())
        throw badInput(log.string(), "there is no tick in this log", "Name the log of a run that has begun.");
    return result;
}

}  // namespace viable
