#pragma once

#include "loop/ControlLoop.h"
#include "summary/LiveTiming.h"
#include "summary/Summary.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

/** What came of a run. */
struct CaseResult {
    explicit CaseResult(Summary begun) : summary(std::move(begun)) {}

    std::string name;
    std::vector<std::string> assumed;  ///< figures of the robot that nobody gave
    LimitSet assumedLimits;            ///< kinds that are such figures, motors' torques too
    std::string tool;                  ///< which directions a tool command gives up on this arm; empty: none
    std::string controller, filter;    ///< plugin names, for tables
    /** What the case is besides its filter, by key of the experiment file: cases are ranked where this is equal. */
    std::map<std::string, std::string> others;
    std::string robustLoop, realPlant;          ///< empty: no real plant
    LimitSet guarantees;                        ///< of the filter
    std::vector<std::string> links, obstacles;  ///< that a LimitReport names by index; may be empty
    /** Of that guarantee position and velocity are the real arm's, as long as the run does not trip. */
    bool holdsOnReal = false;
    std::optional<LoopMargins> margins;        ///< of a robust loop that tells its law
    std::map<std::string, std::string> seeds;  ///< by plugin name
    Summary summary;
    double simulated_s = 0.0, wall_s = 0.0;
    StopReason stopReason = StopReason::None;
    std::string stopMessage;            ///< one sentence that names plugin, time and cause; empty without a stop
    std::string stopRemedy;             ///< what to do about it; may be empty
    std::vector<std::string> warnings;  ///< what the plugins do that is no failure yet
    double stopTime_s = 0.0;
    std::filesystem::path log;
    std::optional<LiveTiming> live;  ///< of a run in real time
    std::string logError;            ///< empty: every row was written
    std::int64_t logRows = 0;

    /** The guarantee on the real arm was broken: it passed a limit before anything had tripped. */
    bool isRealGuaranteeBroken() const { return holdsOnReal && guarantees.hasJoints() && summary.anyRealLimitBroken(); }
    /** Limits of the whole arm that the filter guarantees and the nominal arm broke. */
    LimitSet brokenGuarantees() const;
    /** 0, or the ErrorKind's number: broken guarantee before lost tracking before failed plugin before lost log. */
    int exitCode() const;
};

/** True when exit code `a` tells of something graver than `b`: 3, 6, 4, 5, 2, then 0. */
bool isGraver(int a, int b);

/** A table of at most 100 columns, one line per case: did it follow, did it keep its limits, what did the real arm do? */
std::string formatComparison(const std::vector<CaseResult>& results);

/** The cases from best to worst: ticks outside each limit, ticks without a choice, tracking of the command, chatter, time.
Only cases that differ in nothing but the filter have a place, the largest set of such; the others stand below, with what
else differs. Empty where there are no two of them. */
std::string formatRanking(const std::vector<CaseResult>& results);

enum class Gravity : unsigned char { Good, Doubtful, Broken, Failed };
struct CaseSentence {
    Gravity gravity;  ///< of its worst
    std::string text;
};
/** How a case went, in one sentence, the worst first: did it follow, keep its limits, and what did the real arm do? */
CaseSentence tellCase(const CaseResult& result);

/** The cases in one line, best first, where they have one command and robot; else empty. */
std::string formatOrder(const std::vector<CaseResult>& results);

/** What is not as a user wants it though the limits may hold, in one line with its remedy. */
struct Problem {
    enum class Kind : unsigned char { Other, DoesNotFollow, MissesCommand };  ///< the real arm; the nominal one
    explicit Problem(std::string says, Kind of = Kind::Other) : text(std::move(says)), kind(of) {}
    std::string text;
    Kind kind;
};
/** A real arm that does not follow, motors at their limits, a tool or a joint that misses its command or swings about it,
joints that chatter at a limit. */
std::vector<Problem> findProblems(const CaseResult& result);
/** "whether joint0 follows cannot be told, as ...": what hardly moved, or was far from set-points that stood for less than 0.5 s
beyond what its limits need; the farthest. Empty: nothing. */
std::string tellUnjudged(const Summary& summary);

/** What became of the limits and of the job, in one line. */
std::string formatVerdict(const CaseResult& result);

/** "the real arm exceeded its limits: position by 0.1 rad (joint2)", "the nominal arm collided: ...": the broken guarantees
that show after a run only; empty: none. */
std::string formatBreach(const CaseResult& result);

/** The whole account of one case in about ten lines, and what the words in it mean. */
std::string formatDetails(const CaseResult& result);
extern const char* const kAccountLegend;

/** All cases as JSON, for summary.json. @param title, experiment  the file's, and where it is */
std::string writeSummaryJson(const std::string& title, const std::filesystem::path& experiment,
                             const std::vector<CaseResult>& results);

}  // namespace viable
