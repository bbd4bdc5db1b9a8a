#pragma once

#include <nlohmann/json.hpp>

#include "summary/CaseResult.h"

namespace viable {

/** The limits that are counted: of the nominal arm, and of the real one. */
inline constexpr LimitKind kNominalKinds[] = {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration,
                                              LimitKind::Jerk};
inline constexpr LimitKind kRealKinds[] = {LimitKind::Position, LimitKind::Velocity};

/** A figure of a case: summary.json and the table of a sweep have it from here. */
struct SummaryFigure {
    /** In `key` and `column`: the name of each joint in turn. */
    static constexpr char kJoint[] = "<joint>";

    /** Its place below the case in summary.json: "tracking.joints.<joint>.max_rad"; empty: not there. */
    std::string key;
    /** Whether the case has what the figure tells of: a real arm, an environment, ... */
    std::function<bool(const CaseResult&)> exists;
    /** A number (maybe infinite or NaN), a word, a truth; null: it has no value. */
    std::function<nlohmann::json(const CaseResult&, int joint)> get;

    std::string column = {};  ///< of a sweep's table: "tracking.<joint>.max_rad"; empty: not there
    std::string unit = {};    ///< "rad", "s", ...; empty: none
    std::string label = {};   ///< for people
    /** What a column of the whole case holds of a figure of each joint. */
    enum class Over { None, Largest, Sum } over = Over::None;
    double horizon = std::numeric_limits<double>::infinity();  ///< the column's largest value, of either sign

    bool isPerJoint() const { return key.find(kJoint) != std::string::npos; }
    bool hasColumnPerJoint() const { return column.find(kJoint) != std::string::npos; }
    /** What the column holds; null: nothing to tell. @param joint  of a column per joint */
    nlohmann::json getColumn(const CaseResult& result, int joint) const;
};

/** All of them; the sweep's columns are in this order. One entry more is a figure more in both places. Kinds of limits
that are added later bring theirs along. */
const std::vector<SummaryFigure>& listSummaryFigures();

}  // namespace viable
