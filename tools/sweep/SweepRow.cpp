#include "sweep/SweepRow.h"

#include <charconv>
#include <cstring>

#include "core/Text.h"
#include "summary/SummaryFigures.h"

namespace viable {

namespace {

/** Calls `visit` with each figure that is a column, its name and the joint: the whole case's first, then each joint's. */
template <class Visit>
void forEachColumn(const std::vector<std::string>& joints, const Visit& visit) {
    for (const SummaryFigure& figure : listSummaryFigures())
        if (!figure.column.empty() && !figure.hasColumnPerJoint()) visit(figure, figure.column, 0);
    for (std::size_t i = 0; i < joints.size(); ++i)
        for (const SummaryFigure& figure : listSummaryFigures()) {
            if (!figure.hasColumnPerJoint()) continue;
            std::string name = figure.column;
            name.replace(name.find(SummaryFigure::kJoint), std::strlen(SummaryFigure::kJoint), joints[i]);
            visit(figure, name, i);
        }
}

/** SQL and CSV know no NaN: it is a figure that is not there. */
SweepValue makeValue(const nlohmann::json& figure) {
    if (figure.is_number_integer()) return figure.get<std::int64_t>();
    if (figure.is_number() && !std::isnan(figure.get<double>())) return figure.get<double>();
    return {};
}

constexpr char kDrawPrefix[] = "draw.";

/** SQL knows no upper and lower case in the names of columns: A to Z are a to z. */
void checkNames(const std::vector<SweepColumn>& columns) {
    std::map<std::string, std::string> names;
    for (const SweepColumn& column : columns) {
        std::string small = column.name;
        for (char& c : small)
            if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
        const auto [known, isNew] = names.try_emplace(small, column.name);
        if (!isNew)
            throw badInput("viable sweep",
                           "the columns `" + known->second + "` and `" + column.name +
                               "` would have one name, as a table knows no upper and lower case",
                           "Rename a joint, a case or whatever makes them alike.");
    }
}

/** The unit that a key carries behind its last `_`; see the ends of the keys of experiment files. */
std::string findUnit(std::string key) {
    static const std::pair<const char*, const char*> units[] = {
        {"s", "s"},       {"rad", "rad"}, {"radps", "rad/s"}, {"radps2", "rad/s^2"}, {"radps3", "rad/s^3"},
        {"m", "m"},       {"mps", "m/s"}, {"kg", "kg"},       {"Nm", "Nm"},          {"N", "N"},
        {"Nmps", "Nm/s"}, {"Hz", "Hz"},   {"kgm2", "kg m^2"},
    };
    key.resize(std::min(key.size(), key.find('[', key.rfind('.') + 1)));
    const std::size_t last = key.rfind('_');
    if (last == std::string::npos) return {};
    const std::string end = key.substr(last + 1);
    for (const auto& [suffix, unit] : units)
        if (end == suffix) return unit;
    return {};
}

/** A number where the text is one: draws of words stay text. */
SweepValue makeValue(const std::string& text) {
    const char* const end = text.data() + text.size();
    std::int64_t whole = 0;
    auto result = std::from_chars(text.data(), end, whole);
    if (result.ec == std::errc() && result.ptr == end) return whole;
    double number = 0.0;
    result = std::from_chars(text.data(), end, number);
    if (result.ec == std::errc() && result.ptr == end && std::isfinite(number)) return number;
    return text;
}

// --- bytes: each number as it lies in memory; sender and receiver are the same program

template <class Number>
void put(std::string& bytes, Number number) {
    bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

void putText(std::string& bytes, const std::string& text) {
    put(bytes, static_cast<std::uint64_t>(text.size()));
    bytes += text;
}

class Unpacker {
public:
    explicit Unpacker(const std::string& bytes) : bytes_(bytes) {}

    template <class Number>
    Number take() {
        need(sizeof(Number));
        Number number;
        std::memcpy(&number, bytes_.data() + at_, sizeof number);
        at_ += sizeof number;
        return number;
    }
    std::string readText() {
        const auto size = take<std::uint64_t>();
        need(size);
        at_ += size;
        return bytes_.substr(at_ - size, size);
    }
    bool isAtEnd() const { return at_ == bytes_.size(); }

private:
    void need(std::uint64_t size) const {
        if (size > bytes_.size() - at_) throw std::runtime_error("a row of the sweep is cut off");
    }
    const std::string& bytes_;
    std::size_t at_ = 0;
};

}  // namespace

const char* getName(SweepStatus status) {
    return detail::enumName<SweepStatus::Failed>(
        status, {"ok", "tripped", "stopped", "guarantee_broken", "crashed", "timed_out", "failed"}, "");
}

SweepStatus getSweepStatus(const CaseResult& result) {
    const int code = result.exitCode();
    if (code == static_cast<int>(ErrorKind::GuaranteeBroken)) return SweepStatus::GuaranteeBroken;
    if (code == static_cast<int>(ErrorKind::TrackingLost)) return SweepStatus::Tripped;
    if (result.stopReason == StopReason::None) return SweepStatus::Ok;
    if (result.stopReason == StopReason::FilterEnded || result.stopReason == StopReason::TicksMissed ||
        result.stopReason == StopReason::Requested)
        return SweepStatus::Stopped;
    return SweepStatus::Failed;
}

std::vector<SweepColumn> makeSweepColumns(const std::vector<std::pair<std::string, std::string>>& drawKeys,
                                          const std::vector<std::string>& joints) {
    using Kind = SweepColumn::Kind;
    std::vector<SweepColumn> columns = {
        {Kind::Status, "status", "", "How it ended", ""},
        {Kind::Status, "exit_code", "", "What viable run ends with", ""},
        {Kind::Status, "message", "", "What stopped it", ""},
        {Kind::Status, "replay", "", "The command that does it again", ""},
        {Kind::Status, "wall_s", "s", "Time it took", ""},
    };
    for (const auto& [keyPath, distribution] : drawKeys)
        columns.push_back({Kind::Draw, kDrawPrefix + keyPath, findUnit(keyPath), keyPath, distribution});
    forEachColumn(joints, [&](const SummaryFigure& figure, const std::string& name, std::size_t i) {
        const std::string prefix = figure.hasColumnPerJoint() ? joints[i] + ": " : "";
        columns.push_back({Kind::Result, name, figure.unit, prefix + figure.label, ""});
    });
    checkNames(columns);
    return columns;
}

SweepRow makeSweepRow(const std::vector<SweepColumn>& columns, std::int64_t run, const std::string& caseName,
                      const SweepEnd& end, const std::map<std::string, std::string>& draws, const CaseResult* result) {
    std::map<std::string, SweepValue> values = {
        {"status", std::string(getName(end.status))},
        {"exit_code", std::int64_t{end.exitCode}},
        {"message", end.message},
        {"replay", end.replay},
        {"wall_s", end.wall_s},
    };
    for (const auto& [keyPath, text] : draws) values[kDrawPrefix + keyPath] = makeValue(text);
    if (result)
        forEachColumn(result->summary.jointNames(),
                      [&](const SummaryFigure& figure, const std::string& name, std::size_t i) {
                          values[name] = makeValue(figure.getColumn(*result, static_cast<int>(i)));
                      });
    SweepRow row{run, caseName, {}};
    for (const SweepColumn& column : columns) row.values.push_back(std::move(values[column.name]));
    return row;
}

std::string packRow(const SweepRow& row) {
    std::string bytes;
    put(bytes, row.run);
    putText(bytes, row.caseName);
    put(bytes, static_cast<std::uint64_t>(row.values.size()));
    for (const SweepValue& value : row.values) {
        put(bytes, static_cast<std::uint8_t>(value.index()));
        if (const auto* number = std::get_if<double>(&value)) put(bytes, *number);
        if (const auto* whole = std::get_if<std::int64_t>(&value)) put(bytes, *whole);
        if (const auto* text = std::get_if<std::string>(&value)) putText(bytes, *text);
    }
    return bytes;
}

SweepRow unpackRow(const std::string& bytes) {
    Unpacker from(bytes);
    SweepRow row;
    row.run = from.take<std::int64_t>();
    row.caseName = from.readText();
    const auto count = from.take<std::uint64_t>();
    for (std::uint64_t i = 0; i < count; ++i) {
        SweepValue& value = row.values.emplace_back();
        const auto type = from.take<std::uint8_t>();
        if (type == 1) value = from.take<double>();
        if (type == 2) value = from.take<std::int64_t>();
        if (type == 3) value = from.readText();
        if (type > 3) throw std::runtime_error("a row of the sweep has a value of no known type");
    }
    if (!from.isAtEnd()) throw std::runtime_error("a row of the sweep has more than it says");
    return row;
}

}  // namespace viable
