#include "analysis/records/CsvColumns.h"

#include <algorithm>
#include <string_view>

#include "analysis/records/RecordReaders.h"
#include "config/ConfigText.h"

namespace viable::detail {

namespace {

enum class Quantity { Time, Angle, Length, Torque, Other };

struct Unit {
    std::string_view text;
    Quantity quantity;
    double factor;  // as CsvColumn::factor
};

constexpr Unit kUnits[] = {
    {"s", Quantity::Time, 1.0},         {"ms", Quantity::Time, 1e3},        {"us", Quantity::Time, 1e6},
    {"\xC2\xB5s", Quantity::Time, 1e6}, {"\xCE\xBCs", Quantity::Time, 1e6}, {"ns", Quantity::Time, 1e9},
    {"rad", Quantity::Angle, 1.0},      {"deg", Quantity::Angle, kDegree},  {"\xC2\xB0", Quantity::Angle, kDegree},
    {"m", Quantity::Length, 1.0},       {"cm", Quantity::Length, 1e-2},     {"mm", Quantity::Length, 1e-3},
    {"Nm", Quantity::Torque, 1.0},      {"N", Quantity::Torque, 1.0},
};
/** Only in brackets: `joint_A` is a name without a unit. */
constexpr std::string_view kOthers[] = {"A", "mA", "V", "W", "K", "degC", "Hz", "kg", "%"};
constexpr char kUnitList[] = "s, ms, us, ns; rad, deg; m, cm, mm; Nm, N";

std::optional<Unit> findUnit(std::string_view text) {
    for (const Unit& unit : kUnits)
        if (text == unit.text) return unit;
    for (const Unit& unit : kUnits) {  // a rate: rad/s, radps2, "rad s^-1"
        if (text.substr(0, unit.text.size()) != unit.text) continue;
        const std::string_view rest = text.substr(unit.text.size());
        for (const std::string_view per : {"/s", "ps", " s^-"})
            if (rest.substr(0, per.size()) == per) return Unit{text, Quantity::Other, 1.0};
    }
    return std::nullopt;
}

std::string_view trim(std::string_view text) {
    const std::size_t begin = text.find_first_not_of(" \t");
    if (begin == std::string_view::npos) return {};
    return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

/** "joint1 [rad]", "joint1 (rad)" or "joint1_rad": the name and its unit's text, empty where there is none. */
struct NameAndUnit {
    std::string_view name, unit;
    bool isBracketed = false;
};

NameAndUnit splitUnit(std::string_view text) {
    const char last = text.empty() ? '\0' : text.back();
    if (last == ']' || last == ')') {
        const std::size_t open = text.rfind(last == ']' ? '[' : '(');
        if (open == std::string_view::npos) return {text, {}};
        return {trim(text.substr(0, open)), trim(text.substr(open + 1, text.size() - open - 2)), true};
    }
    const std::size_t line = text.rfind('_');
    if (line == std::string_view::npos) return {text, {}};
    return {text.substr(0, line), text.substr(line + 1)};
}

bool isOther(const NameAndUnit& split) {
    return split.isBracketed && std::find(std::begin(kOthers), std::end(kOthers), split.unit) != std::end(kOthers);
}

/** Gives columns their uses and looks after what must be there once. */
class Planner {
public:
    Planner(const std::vector<std::string>& header, const std::string& where) : header_(header), where_(where) {
        plan_.columns.resize(header.size());
    }

    void use(std::size_t column, std::string_view name, const Unit& unit) {
        CsvColumn& use = plan_.columns[column];
        use.factor = unit.factor;
        if (unit.quantity == Quantity::Time) {
            if (time_)
                throw badInput(
                    where_,
                    "two columns are times: " + quoteText(header_[*time_]) + " and " + quoteText(header_[column]),
                    suggestColumns());
            time_ = column;
            use.use = CsvColumn::Use::Time;
        } else if (unit.quantity == Quantity::Torque) {
            torques_.emplace_back(column, name);
        } else if (unit.quantity != Quantity::Other) {
            if (name.empty())
                throw badInput(where_, "column " + std::to_string(column + 1) + " has a unit and no name",
                               "Write the joint's name before the unit");
            if (findJoint(name))
                throw badInput(where_, "two columns are positions of joint " + quoteText(std::string(name)),
                               suggestColumns());
            if (plan_.joints.size() == kMostJoints)
                throw badInput(where_, "more than " + std::to_string(kMostJoints) + " joints", suggestColumns());
            use.use = CsvColumn::Use::Position;
            use.joint = plan_.joints.size();
            MotionRecord::Joint joint;
            joint.name = name;
            joint.isPrismatic = unit.quantity == Quantity::Length;
            plan_.joints.push_back(std::move(joint));
        }
    }

    CsvPlan finish() {
        if (!time_)
            throw badInput(where_, "no column is the time",
                           "Write the time's unit at the end of its name, such as `time_s`. Or " + suggestColumns());
        if (plan_.joints.empty())
            throw badInput(where_, "no column is the position of a joint",
                           "Write its unit at the end of its name, such as `joint1_rad`. Or " + suggestColumns());
        std::vector<bool> hasTorque(plan_.joints.size());
        for (const auto& [column, name] : torques_) {
            const std::optional<std::size_t> joint = findJoint(name);
            if (!joint) continue;
            if (hasTorque[*joint])
                throw badInput(where_, "two columns are torques of joint " + quoteText(name), suggestColumns());
            hasTorque[*joint] = true;
            plan_.columns[column].use = CsvColumn::Use::Torque;
            plan_.columns[column].joint = *joint;
        }
        return std::move(plan_);
    }

    /** How to name the columns, with names of this file. */
    std::string suggestColumns() const {
        const std::string first = header_[0].empty() ? "time" : header_[0];
        const std::string second = header_.size() < 2 || header_[1].empty() ? "joint1" : header_[1];
        return "--columns \"" + first + ":s," + second + ":rad\" names the columns to use and their units";
    }

private:
    std::optional<std::size_t> findJoint(std::string_view name) const {
        for (std::size_t i = 0; i < plan_.joints.size(); ++i)
            if (plan_.joints[i].name == name) return i;
        return std::nullopt;
    }

    const std::vector<std::string>& header_;
    std::string where_;
    CsvPlan plan_;
    std::optional<std::size_t> time_;
    std::vector<std::pair<std::size_t, std::string>> torques_;  // column and joint
};

/** The columns by the units in their names. */
CsvPlan planByHeader(const std::vector<std::string>& header, const std::string& where) {
    Planner planner(header, where);
    for (std::size_t i = 0; i < header.size(); ++i) {
        const NameAndUnit split = splitUnit(header[i]);
        if (isOther(split)) continue;
        const std::optional<Unit> unit = findUnit(split.unit);
        if (!unit)
            throw badInput(where,
                           "column " + std::to_string(i + 1) + ", " + quoteText(header[i]) +
                               ", does not end in a unit that is known here",
                           std::string("Write units such as `time_s`, `joint1_rad` or `joint1 [deg]`, of ") +
                               kUnitList + ". Or " + planner.suggestColumns());
        planner.use(i, split.name, *unit);
    }
    return planner.finish();
}

/** The columns that the user names, as NAME:UNIT,... */
CsvPlan planByList(const std::vector<std::string>& header, std::string_view text, const std::string& where) {
    Planner planner(header, where);
    for (bool isLast = false; !isLast;) {
        const std::size_t comma = text.find(',');
        isLast = comma == std::string_view::npos;
        const std::string_view item = trim(text.substr(0, comma));
        if (!isLast) text.remove_prefix(comma + 1);
        const std::size_t colon = item.rfind(':');
        const std::string name(trim(item.substr(0, colon)));
        const std::string_view unitText = colon == std::string_view::npos ? "" : trim(item.substr(colon + 1));
        const std::optional<Unit> unit = findUnit(unitText);
        if (name.empty() || !unit || unit->quantity == Quantity::Other)
            throw badInput("--columns", quoteText(std::string(item)) + " is not a column's name and its unit",
                           std::string("Write NAME:UNIT,NAME:UNIT,... with the units ") + kUnitList);
        const auto found = std::find(header.begin(), header.end(), name);
        if (found == header.end()) {
            const std::string close = findClosestName(name, header);
            throw badInput(
                where, "--columns names " + quoteText(name) + ", which is not a column of the header",
                close.empty() ? "Names must be those of the header" : "Did you mean " + quoteText(close) + "?");
        }
        if (std::find(found + 1, header.end(), name) != header.end())
            throw badInput(where, "two columns have the name " + quoteText(name), "Rename one of them");
        // A unit in the name that says the same is no part of the joint's name.
        const NameAndUnit split = splitUnit(name);
        const bool isSame = split.unit == unitText && !split.name.empty();
        planner.use(static_cast<std::size_t>(found - header.begin()), isSame ? split.name : name, *unit);
    }
    return planner.finish();
}

/** "real.joint0.q_rad" -> "joint0" for the given beginning and quantity "q" of an export's column; empty: another. */
std::string_view findExportJoint(std::string_view column, std::string_view beginning, std::string_view quantity) {
    const std::size_t dot = column.rfind('.');
    if (column.substr(0, beginning.size()) != beginning || dot == std::string_view::npos || dot < beginning.size())
        return {};
    if (splitUnit(column.substr(dot + 1)).name != quantity) return {};
    return column.substr(beginning.size(), dot - beginning.size());
}

}  // namespace

bool isExportedCsv(const std::vector<std::string>& header) {
    return header[0] == "time_s" && std::any_of(header.begin(), header.end(), [](const std::string& name) {
               return !findExportJoint(name, "nominal.", "q").empty();
           });
}

/** The columns of what `viable export` writes. */
static CsvPlan planExport(const std::vector<std::string>& header, LoggedArm arm, const std::string& where) {
    const bool isReal = arm == LoggedArm::Real;
    Planner planner(header, where);
    planner.use(0, "", *findUnit("s"));
    bool hasArm = false;
    for (std::size_t i = 1; i < header.size(); ++i) {
        const std::string_view position = findExportJoint(header[i], isReal ? "real." : "nominal.", "q");
        const std::string_view torque = isReal ? findExportJoint(header[i], "motor.", "tau") : "";
        const std::optional<Unit> unit = findUnit(splitUnit(header[i]).unit);
        if (!unit || (position.empty() && torque.empty())) continue;
        planner.use(i, position.empty() ? torque : position, *unit);
        hasArm = hasArm || !position.empty();
    }
    if (!hasArm && isReal) throw badInput(where, "the exported log has no real arm", kNoRealArmRemedy);
    return planner.finish();
}

CsvPlan planCsvColumns(const std::vector<std::string>& header, const MotionRecordOptions& options,
                       const std::string& where) {
    if (!options.columns.empty()) return planByList(header, options.columns, where);
    return isExportedCsv(header) ? planExport(header, options.arm, where) : planByHeader(header, where);
}

}  // namespace viable::detail
