#include "records/ColumnMeaning.h"

#include <algorithm>
#include <string_view>

namespace viable::detail {

constexpr ColumnUnit kUnits[] = {{"rad", "rad", "m"},
                                 {"radps", "rad/s", "mps"},
                                 {"radps2", "rad/s^2", "mps2"},
                                 {"radps3", "rad/s^3", "mps3"},
                                 {"Nm", "Nm", "N"},
                                 {"m", "m", "m"},
                                 {"mps", "m/s", "mps"},
                                 {"mps2", "m/s^2", "mps2"},
                                 {"mps3", "m/s^3", "mps3"},
                                 {"N", "N", "N"},
                                 {"s", "s", "s"},
                                 {"us", "us", "us"}};

/** Of names without their unit; * stands for anything. The first that fits. */
constexpr struct {
    const char *name, *text;
} kMeanings[] = {
    {"time", "since the start of the run; a row is a tick"},
    {"*.tool.q?", "orientation of the tool, a quaternion in the base frame"},
    {"*.tool.?", "position of the tool in the base frame"},
    {"nominal.*.q", "position of the nominal arm: the ideal one, which the filter moves"},
    {"*.qd", "velocity, the rate of q beside it"},
    {"*.qdd", "acceleration, the rate of qd beside it"},
    {"nominal.*.jerk", "jerk, held from this row to the next"},
    {"real.*.q", "position of the real arm, as its encoder reads it"},
    {"actual.*.q", "true position of the simulated arm"},
    {"desired.*.tau", "torque that the controller asks for"},
    {"filter.*.tau", "torque that the filter lets pass; it moves the nominal arm"},
    {"filter.*.active",
     "limit that bound this joint's own choice: none, position_lower, ... jerk_upper, torque_lower, clearance_lower, "
     "speed_upper, ..."},
    {"filter.*.tau_removed", "desired (and external) minus filtered torque, whatever the cause"},
    {"filter.*.margin", "least distance to a position limit along this tick and the stop after it; negative: beyond"},
    {"filter.*.stop", "duration of that stop"},
    {"filter.*.rest", "place where that stop ends"},
    {"limits.*", "limit in force"},
    {"robust.*.tau", "torque that the robust loop adds, to keep the real arm next to the nominal one"},
    {"motor.*.tau", "torque that the motor gave"},
    {"external.*.tau", "measured external torque; nan: unusable, and the last good one acted"},
    {"contact.force.?", "force on the real arm where it touches something, base frame"},
    {"contact.pressing", "size of that force along the surface's normal"},
    {"contact.depth", "how deep the arm is in what it touches"},
    {"contact.point.?", "place of the contact, base frame"},
    {"contact.contacts", "number of places that touch"},
    {"contact.carrier", "moving link that touches, from 0; -1: none"},
    {"contact.obstacle", "what it touches: index into the metadata's `obstacles`; -1: none"},
    {"touch.on", "1: the nominal arm waits for a tool that is held"},
    {"touch.felt", "force along the surface's normal, as the torque sensors tell"},
    {"touch.asked", "contact force that is asked for there"},
    {"touch.normal.?", "out of the surface that holds the tool, base frame"},
    {"command.tool.v?", "commanded velocity of the tool"},
    {"command.tool.w?", "commanded angular velocity of the tool"},
    {"command.*.q", "commanded position of the joint"},
    {"live.paused", "1: somebody asked for a pause; command, controller and filter did not run"},
    {"live.take", "number of the operator's take, from 1; 0: none"},
    {"pace.interval", "from the beginning of the last tick to that of this one; 0: one was missed"},
    {"tick.status",
     "the filter's answer: passed, modified, infeasible (no admissible choice), recovering (returning to a limit), "
     "stopped_by_plan (the backup stop)"},
    {"tick.stop", "the stop after the tick: safe, recovering (beyond a limit), no_stop (none was found: not viable)"},
    {"tick.missed", "1: command, controller and filter did not run"},
    {"tick.braking", "1: the arm brakes to the end of the run"},
    {"tick.substituted", "torques of the controller so far that the last good one replaced"},
    {"tick.compute", "time of the whole tick"},
    {"tick.*", "time of this stage of the tick"},
    {"*.known", "1: the filter told the other columns of this limit"},
    {"clearance.distance", "lower bound of the arm's distance from obstacles and itself along this tick and its stop"},
    {"clearance.on_arm.?", "nearest place: the point of the arm"},
    {"clearance.on_obstacle.?", "nearest place: the point of the obstacle or other link"},
    {"clearance.map_age", "age of the surroundings"},
    {"speed.largest", "speed of the point that uses most of its limit along this tick and its stop"},
    {"speed.limit", "limit of that point"},
    {"separation.kept", "1: no link that is too fast can touch anybody along this tick and its stop"},
    {"separation.margin", "least distance of moving links from where people can be by then; inf: nothing moves"},
    {"separation.person", "the person: index into the metadata's `people`; -1: none"},
    {"separation.age", "age of the oldest observation"},
    {"separation.appeared", "count so far: people who were not known before"},
    {"separation.faster", "count so far: observations farther from the last than the person can have moved"},
    {"separation.lost", "count so far: people who are not seen any more"},
    {"separation.refused", "count so far: unusable observations"},
    {"separation.last_fault", "the person of the last of these faults"},
    {"*.obstacle", "the obstacle: index into the metadata's `obstacles`; -1: none"},
    {"*link", "the link: index into the metadata's `links`; -1: none, in speed.link the tool"},
};

static bool fits(std::string_view text, std::string_view pattern) {
    const auto isSame = [](std::string_view a, std::string_view b) {
        return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) { return x == y || y == '?'; });
    };
    const std::size_t star = pattern.find('*');
    if (star == std::string_view::npos) return isSame(text, pattern);
    const std::size_t end = pattern.size() - star - 1;
    return text.size() >= star + end && isSame(text.substr(0, star), pattern.substr(0, star)) &&
           isSame(text.substr(text.size() - end), pattern.substr(star + 1));
}

const ColumnUnit* findColumnUnit(const std::string& column) {
    const std::size_t line = column.rfind('_'), dot = column.rfind('.');
    if (line == std::string::npos || (dot != std::string::npos && line < dot)) return nullptr;
    for (const ColumnUnit& unit : kUnits)
        if (column.compare(line + 1, std::string::npos, unit.suffix) == 0) return &unit;
    return nullptr;
}

std::string explainColumn(const std::string& column) {
    const std::string name = findColumnUnit(column) ? column.substr(0, column.rfind('_')) : column;
    for (const auto& meaning : kMeanings)
        if (fits(name, meaning.name)) return meaning.text;
    return name.find('.') == std::string::npos ? "" : "figure of a kind of limit that a library adds";
}

}  // namespace viable::detail
