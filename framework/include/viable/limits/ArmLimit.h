#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <variant>

#include "viable/core/JointLimits.h"

namespace viable {

struct ArmGeometry;
struct Environment;
struct RobotDescription;

/** A set of kinds of limits. */
class LimitSet {
public:
    constexpr LimitSet() = default;
    constexpr LimitSet(std::initializer_list<LimitKind> kinds) {
        for (const LimitKind kind : kinds) bits_ |= bit(kind);
    }
    /** Position, velocity, acceleration and jerk of every joint. */
    static constexpr LimitSet joints() {
        return {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk};
    }

    constexpr bool has(LimitKind kind) const { return (bits_ & bit(kind)) != 0; }
    /** All four limits of the joints are in it. */
    constexpr bool hasJoints() const { return (*this & joints()) == joints(); }
    constexpr bool isEmpty() const { return bits_ == 0; }
    constexpr void set(LimitKind kind, bool isIn = true) { bits_ = isIn ? bits_ | bit(kind) : bits_ & ~bit(kind); }
    constexpr LimitSet operator&(LimitSet other) const { return LimitSet(bits_ & other.bits_); }
    constexpr LimitSet operator|(LimitSet other) const { return LimitSet(bits_ | other.bits_); }
    constexpr bool operator==(LimitSet other) const { return bits_ == other.bits_; }
    constexpr bool operator!=(LimitSet other) const { return bits_ != other.bits_; }

private:
    explicit constexpr LimitSet(std::uint32_t bits) : bits_(bits) {}
    static constexpr std::uint32_t bit(LimitKind kind) {
        return static_cast<int>(kind) < kMostLimitKinds ? std::uint32_t{1} << static_cast<int>(kind) : 0;
    }

    std::uint32_t bits_ = 0;
};

/** A filter's report on one limit of the whole arm. It tells of the place nearest to that limit, on the way through a tick
and the stop after it. Each kind uses the members that it needs. */
struct LimitReport {
    bool isKnown = false;  ///< false: nobody has looked
    bool isKept = true;    ///< false: it may be broken, and the arm brakes
    double value = 0.0;    ///< limited from above, in the unit of the kind; such as a speed
    double limit = std::numeric_limits<double>::infinity();   ///< the limit of `value` there
    double margin = std::numeric_limits<double>::infinity();  ///< limited from below, such as a distance [m]
    int link = -1;                                    ///< index into ArmGeometry::links; -1: none, or the tool frame
    int other = -1;                                   ///< index into Surroundings or PeopleFeed::people(); -1: nothing
    int otherLink = -1;                               ///< second link of the arm; -1: none
    Eigen::Vector3d onArm = Eigen::Vector3d::Zero();  ///< nearest points, base frame [m]
    Eigen::Vector3d onOther = Eigen::Vector3d::Zero();
    double age_s = 0.0;  ///< age of the oldest observation that counts
};

/** One report of each kind of limit that is of the whole arm. */
class LimitReports {
public:
    LimitReport& operator[](LimitKind kind) { return reports_[index(kind)]; }
    const LimitReport& operator[](LimitKind kind) const { return reports_[index(kind)]; }
    /** Takes from `before` the reports that are not known here. */
    void complete(const LimitReports& before) {
        for (std::size_t k = 0; k < reports_.size(); ++k)
            if (!reports_[k].isKnown) reports_[k] = before.reports_[k];
    }

private:
    static constexpr int kFirst = static_cast<int>(kFirstArmLimit);
    static constexpr int kCount = kMostLimitKinds - kFirst;
    /** A kind that has no report, such as one of the joints, has a place of its own behind the others. */
    static constexpr std::size_t index(LimitKind kind) {
        const int k = static_cast<int>(kind) - kFirst;
        return static_cast<std::size_t>(k >= 0 && k < kCount ? k : kCount);
    }

    std::array<LimitReport, kCount + 1> reports_{};
};

/** Faults in the observations of people so far. The arm brakes for each, as far as it matters. */
struct PeopleFaults {
    std::int64_t appeared = 0;  ///< people who were not known of before
    std::int64_t faster = 0;    ///< observations farther away from the one before than the person can have come
    std::int64_t lost = 0;      ///< times that someone who was seen was not any more
    std::int64_t refused = 0;   ///< observations that could not be used
    int last = -1;              ///< the person whose fault was the last one: index into PeopleFeed::people()
};

/** An arm of a run in one state. */
struct ArmSample {
    const JointVector &q, &qd;  ///< [rad], [rad/s]
    double time_s;
    bool isReal;   ///< the real arm as it truly is; false: the nominal one
    double worst;  ///< the worst value of this arm so far: less bad ones change no figure
    /** The torque that moves it from here on [Nm]; null: not known, as half-way between rows. */
    const JointVector* torque = nullptr;
    const JointVector* nominalTorque = nullptr;  ///< the torque that moves the nominal arm [Nm]; null likewise
};

/** A limit's finding in one state of one arm. */
struct LimitSample {
    double value = 0.0;  ///< in the unit of the kind, or a share of its limit
    bool isBroken = false;
    bool isExcused = false;      ///< broken, but no fault of the arm: it breaks no guarantee
    bool isNear = false;         ///< near the limit, in the kind's own sense
    double largest = 0.0;        ///< a second figure, such as a speed; the run keeps the largest
    const char* part = "";       ///< the place on the arm; lives as long as the limit
    const char* other = "";      ///< the thing or person there, likewise
    const char* otherLink = "";  ///< the other part of the arm there, likewise
};

/** How one arm of a run fared. The arm is sampled in the rows and half-way between them. A tick counts with the samples
after its beginning, the first tick with that one, too. Ticks of a real arm without a reading do not count. */
struct ArmLimitRecord {
    std::int64_t ticks = 0;
    std::int64_t brokenTicks = 0;
    std::int64_t violatedTicks = 0;  ///< broken ticks without an excuse: they break a guarantee
    std::int64_t nearTicks = 0;
    std::optional<double> firstBroken_s;
    double worst = 0.0;    ///< the worst value; see LimitRow::lessIsWorse
    double worst_s = 0.0;  ///< when
    std::string part, other, otherLink;
    double largest = 0.0;

    double depth() const { return worst < 0.0 ? -worst : 0.0; }  ///< how far a distance was below 0
};

/** How the arms of a run fared at one kind of limit. */
struct LimitAccount {
    LimitKind kind = LimitKind::None;
    ArmLimitRecord nominal;
    std::optional<ArmLimitRecord> real;  ///< the true state, where the plant knows it
    std::optional<double> limit;         ///< the case's number, in the unit of the kind; none: it has no single one
    std::vector<std::pair<std::string, double>> allowances;  ///< numbers of single people or things
    double resting_s = 0.0;                                  ///< the nominal arm stood still because of this limit
    PeopleFaults faults;    ///< as the filter found them, of a kind that watches people
    std::string lastFault;  ///< name of the person whose fault was the last one
};

/** One kind of limit in one case: it judges the arms of a run while it goes on, outside of the ticks. It shares no
arithmetic with the filters that keep the limit. */
class ArmLimit {
public:
    virtual ~ArmLimit() = default;
    /** One state of one arm. Allocates nothing where it may be asked in real time (see LimitRow::isSlow). */
    virtual LimitSample sample(const ArmSample& arm) = 0;
    /** LimitAccount::limit and allowances. */
    virtual std::optional<double> limit() const { return std::nullopt; }
    virtual std::vector<std::pair<std::string, double>> allowances() const { return {}; }
    /** The name for an index in LimitReport::other or PeopleFaults::last. */
    virtual const char* otherName(int /*index*/) const { return ""; }
};

/** The parts of a case that its limits may hang on. */
struct LimitScene {
    const RobotDescription& robot;
    const ArmGeometry* geometry;     ///< null: not known, or not needed
    const Environment* environment;  ///< with its people; null: none
};

/** A column of a kind's channel in the log: its name, with the unit, and the member that it holds. Names of points stand
without the unit: "on_arm" becomes "on_arm.x_m" and so on. */
struct LimitColumn {
    using Member = std::variant<bool LimitReport::*, int LimitReport::*, double LimitReport::*,
                                Eigen::Vector3d LimitReport::*, std::int64_t PeopleFaults::*, int PeopleFaults::*>;
    std::string name;
    Member member;
};

/** A figure of each arm in summary.json, and with a column also in a sweep's table. */
struct LimitFigure {
    using Member =
        std::variant<std::int64_t ArmLimitRecord::*, double ArmLimitRecord::*, std::optional<double> ArmLimitRecord::*,
                     std::string ArmLimitRecord::*, double (ArmLimitRecord::*)() const>;
    std::string key;
    Member member;
    std::string column = {}, unit = {}, label = {};
};

/** All that the program says of a kind of limit. Members that are left empty follow from name and unit. */
struct LimitRow {
    /** Null: every case has it; of a plugin's library, every case of an experiment with a case that uses that. */
    bool (*exists)(const LimitScene& scene) = nullptr;
    /** Null: nobody counts it. */
    std::unique_ptr<ArmLimit> (*make)(const LimitScene& scene) = nullptr;

    LimitSide side = LimitSide::Upper;  ///< as which it acts on joints, by the words of the log
    bool lessIsWorse = false;           ///< as with a distance; the worst value begins at infinity, else at 0
    bool bridgesGaps = false;    ///< positions alone count: half-way is judged over readings that did not come, too
    bool isSlow = false;         ///< takes longer than a tick of a live run may: it is not counted there
    bool watchesPeople = false;  ///< LimitAccount::faults and resting_s are told
    double horizon = std::numeric_limits<double>::infinity();  ///< values beyond it are not told apart

    std::string label;      ///< heads its lines: "clearance"
    std::string limitWord;  ///< "point speed": "held by point speed limits"
    std::string kept;       ///< "no collision"
    std::string guarantee;  ///< "clearances": "the filter guarantees all, and clearances"
    std::string broken;     ///< "the arm collided": "guarantee broken, the arm collided"
    std::string verdict;    ///< "the %s arm collided": of the nominal or the real arm, before what tellWorst says
    std::string breach;     ///< the same where a guarantee was broken
    std::string remedy;     ///< for an arm that stands still because of it
    std::string ranked;     ///< "in collision": cases are ranked by it, the last kind first; empty: they are not
    std::string rankedBy;   ///< "in collision": "ticks of the nominal arm in collision"
    std::string heading;    ///< heads its column in the comparison: "least clearance[mm]"; "-": it has none
    double headingScale = 1.0;
    std::string headingLegend;

    /** "link6 used 99.6 % of its limit at 1.234 s": the worst of one arm. */
    std::string (*tellWorst)(const ArmLimitRecord& record) = nullptr;
    /** One arm's line of the account, after "nominal: ". */
    std::string (*tellArm)(const LimitAccount& account, const ArmLimitRecord& record) = nullptr;
    /** More lines of the account, and more in the verdict; may be null. */
    std::string (*tellMore)(const LimitAccount& account) = nullptr;
    std::string (*tellInVerdict)(const LimitAccount& account) = nullptr;

    std::vector<LimitColumn> columns;  ///< fields of its log channel
    std::string block;                 ///< key in summary.json: "collisions"
    std::string columnBlock;           ///< first part of names in a sweep's table: "collision"
    std::string limitKey;              ///< key of LimitAccount::limit in the block; empty: not told
    std::vector<LimitFigure> figures;
};

/** Adds a kind of limit, and with it its log channel, figures, words, verdict and exit code. A plugin's library adds its
kinds in a function that VIABLE_PLUGIN names, `void addLimits() { kUpright = viable::addLimit("upright", "deg", makeRow()); }`.
An embedding program adds its own in main() or later. The row takes the place of one that nobody counts. Throws as
addLimitKind(), and where other code counts that kind already. Any thread. */
LimitKind addLimit(const std::string& name, const std::string& unit, LimitRow row);

/** The row of a kind from kFirstArmLimit on. Any thread; lives for ever. */
const LimitRow& getLimitRow(LimitKind kind);

/** All kinds that are of the whole arm, in their order, to be looped over. Real time. */
class ArmLimitRange {
public:
    struct Iterator {
        int kind;
        LimitKind operator*() const { return static_cast<LimitKind>(kind); }
        void operator++() { ++kind; }
        bool operator!=(Iterator other) const { return kind != other.kind; }
    };
    Iterator begin() const { return {static_cast<int>(kFirstArmLimit)}; }
    Iterator end() const { return {end_}; }

private:
    int end_ = countLimitKinds();
};
inline ArmLimitRange listArmLimits() {
    return {};
}

/** The kinds that watch people. */
LimitSet findPeopleLimits();

/** Clearances are looked for up to here [m], and two ways to compute one agree to this [m]. */
inline constexpr double kClearanceHorizon_m = 1.0, kClearanceRounding_m = 1e-9;
/** A speed above this share of its limit is at the limit; beyond it by less than the other it is not above it: rounding. */
inline constexpr double kAtSpeedLimit = 0.95, kSpeedRounding = 1e-9;
/** Slower points of the nominal arm, of the real one, are at rest [m/s]. */
inline constexpr double kNominalRest = 1e-6, kRealArmRest = 0.01;

}  // namespace viable
