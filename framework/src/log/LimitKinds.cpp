#include "log/LimitKinds.h"

#include <nlohmann/json.hpp>

#include "limits/LimitRows.h"

namespace viable {

namespace {

using nlohmann::json;
using R = LimitReport;
using P = PeopleFaults;
using A = ArmLimitRecord;

template <class Member>
struct Named {
    const char* name;
    Member member;
};

constexpr Named<std::string LimitRow::*> kRowTexts[] = {{"label", &LimitRow::label},
                                                        {"limit_word", &LimitRow::limitWord},
                                                        {"heading", &LimitRow::heading},
                                                        {"block", &LimitRow::block},
                                                        {"limit_key", &LimitRow::limitKey}};
constexpr Named<bool LimitRow::*> kRowFlags[] = {{"less_is_worse", &LimitRow::lessIsWorse},
                                                 {"watches_people", &LimitRow::watchesPeople}};
const Named<LimitColumn::Member> kMembers[] = {
    {"known", &R::isKnown}, {"kept", &R::isKept},      {"value", &R::value},     {"limit", &R::limit},
    {"margin", &R::margin}, {"link", &R::link},        {"other", &R::other},     {"other_link", &R::otherLink},
    {"on_arm", &R::onArm},  {"on_other", &R::onOther}, {"age", &R::age_s},       {"appeared", &P::appeared},
    {"faster", &P::faster}, {"lost", &P::lost},        {"refused", &P::refused}, {"last_fault", &P::last}};
const Named<LimitFigure::Member> kRecordMembers[] = {
    {"ticks", &A::ticks},          {"broken", &A::brokenTicks},  {"violated", &A::violatedTicks},
    {"near", &A::nearTicks},       {"first", &A::firstBroken_s}, {"worst", &A::worst},
    {"worst_time", &A::worst_s},   {"part", &A::part},           {"other", &A::other},
    {"other_link", &A::otherLink}, {"largest", &A::largest},     {"depth", &A::depth}};

template <class Row, std::size_t n>
json writeMembers(const std::vector<Row>& rows, std::string Row::*key, const Named<typename Row::Member> (&all)[n]) {
    json list = json::array();
    for (const Row& row : rows)
        for (const auto& [name, member] : all)
            if (member == row.member) list.push_back({row.*key, name});
    return list;
}

/** @param list  pairs of a key and a member's name; members that are not known here are left out */
template <class Row, std::size_t n>
std::vector<Row> readMembers(const json& list, const Named<typename Row::Member> (&all)[n]) {
    std::vector<Row> rows;
    for (const json& pair : list)
        for (const auto& [name, member] : all)
            if (pair.at(1) == name) rows.push_back({pair.at(0).get<std::string>(), member});
    return rows;
}

json describeKind(LimitKind kind, const LimitRow& row) {
    json one = {{"unit", getUnit(kind, false)},
                {"side", getName(row.side)},
                {"columns", writeMembers(row.columns, &LimitColumn::name, kMembers)},
                {"figures", writeMembers(row.figures, &LimitFigure::key, kRecordMembers)}};
    for (const auto& [key, member] : kRowTexts) one[key] = row.*member;
    for (const auto& [key, member] : kRowFlags) one[key] = row.*member;
    return one;
}

LimitRow readRow(const json& one) {
    LimitRow row;
    for (const auto& [key, member] : kRowTexts) row.*member = one.at(key).get<std::string>();
    for (const auto& [key, member] : kRowFlags) row.*member = one.at(key).get<bool>();
    if (one.at("side") == getName(LimitSide::Lower)) row.side = LimitSide::Lower;
    row.columns = readMembers<LimitColumn>(one.at("columns"), kMembers);
    row.figures = readMembers<LimitFigure>(one.at("figures"), kRecordMembers);
    return row;
}

/** Of what stands in a log all that is known here: a later version may tell more. */
bool isToldBy(const json& one, LimitKind kind) {
    return describeKind(kind, detail::complete(readRow(one), kind)) == describeKind(kind, getLimitRow(kind));
}

/** None: it is not known here. */
LimitKind findKind(const std::string& name) {
    for (const LimitKind kind : listArmLimits())
        if (name == getName(kind, LimitSide::Neither)) return kind;
    return LimitKind::None;
}

void readKind(const std::string& name, const json& one) {
    const bool isOld = one.is_string();  // its unit alone
    const json told = isOld ? one : one.is_object() ? one.value("unit", json()) : json();
    if (!told.is_string()) return;
    const auto unit = told.get<std::string>();
    const LimitKind kind = findKind(name);
    if (kind != LimitKind::None && unit != getUnit(kind, false))  // its numbers would be shown in another unit
        throw badInput("kind of limit '" + name + "'",
                       "the log has it in '" + unit + "', here it is in '" + getUnit(kind, false) + "'",
                       "Read the log in a program that has not loaded a library or log with the other unit.");
    try {
        if (kind != LimitKind::None && (isOld || isToldBy(one, kind))) return;  // that adds nothing
        addLimit(name, unit, isOld ? LimitRow() : readRow(one));
    } catch (const std::exception&) {  // what it does not tell follows from name and unit
    }
}

}  // namespace

std::string writeLimitKinds() {
    json kinds;
    for (const LimitKind kind : listArmLimits())
        if (kind > kLastOwnLimit) kinds[getName(kind, LimitSide::Neither)] = describeKind(kind, getLimitRow(kind));
    return kinds.is_null() ? "" : kinds.dump(-1, ' ', false, json::error_handler_t::replace);
}

void readLimitKinds(const std::string& text) {
    const json kinds = json::parse(text, nullptr, false);
    if (!kinds.is_object()) return;
    for (const auto& [name, one] : kinds.items()) readKind(name, one);
}

}  // namespace viable
