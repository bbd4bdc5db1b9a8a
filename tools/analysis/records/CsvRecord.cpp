#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <fstream>
#include <string_view>
#include <system_error>

#include "analysis/records/CsvColumns.h"
#include "analysis/records/RecordReaders.h"
#include "config/ConfigText.h"

namespace viable::detail {

namespace {

constexpr std::size_t kBlock = 1 << 20;        // [bytes] read at once
constexpr std::size_t kLongestLine = 1 << 20;  // [bytes]; a file without line ends must not take all memory
constexpr char kBlanks = ' ';                  // the separator that stands for any number of blanks

struct Line {
    const std::string& file;
    std::string_view text;
    std::size_t number;  // from 1

    std::string place() const { return file + ":" + std::to_string(number); }
    std::string place(std::size_t column) const { return place() + ":" + std::to_string(column); }
};

/** Lines of a text file, one after the other; LF or CRLF. */
class LineReader {
public:
    explicit LineReader(const std::filesystem::path& file) : file_(file.string()), in_(file, std::ios::binary) {
        if (!in_)
            throw badInput(file_, "cannot be opened: " + std::generic_category().message(errno), "Check the path");
    }

    bool next() {
        std::size_t end = buffer_.find('\n', begin_);
        while (end == std::string::npos && !atEnd_) {
            buffer_.erase(0, begin_);
            begin_ = 0;
            if (buffer_.size() > kLongestLine)
                throw badInput(Line{file_, {}, number_ + 1}.place(),
                               "the line is longer than " + std::to_string(kLongestLine) + " bytes",
                               "Give a CSV file with one sample per line");
            const std::size_t searched = buffer_.size();
            fill();
            end = buffer_.find('\n', searched);
        }
        if (end == std::string::npos) {
            if (begin_ == buffer_.size()) return false;
            end = buffer_.size();
        }
        text_ = std::string_view(buffer_).substr(begin_, end - begin_);
        begin_ = std::min(end + 1, buffer_.size());
        ++number_;
        if (!text_.empty() && text_.back() == '\r') text_.remove_suffix(1);
        constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
        if (number_ == 1 && text_.substr(0, kByteOrderMark.size()) == kByteOrderMark)
            text_.remove_prefix(kByteOrderMark.size());
        if (text_.find('\0') != std::string_view::npos)
            throw badInput(line().place(), "the line has a zero byte: this is not text", "Remove what is not text");
        return true;
    }

    Line line() const { return {file_, text_, number_}; }  ///< valid up to next()

private:
    void fill() {
        const std::size_t size = buffer_.size();
        buffer_.resize(size + kBlock);
        in_.read(&buffer_[size], kBlock);
        if (in_.bad()) throw badInput(file_, "cannot be read: " + std::generic_category().message(errno), "");
        buffer_.resize(size + static_cast<std::size_t>(in_.gcount()));
        atEnd_ = in_.eof();
    }

    std::string file_;
    std::ifstream in_;
    std::string buffer_;
    std::size_t begin_ = 0;  // of the next line in it
    bool atEnd_ = false;
    std::string_view text_;
    std::size_t number_ = 0;
};

struct Field {
    std::string_view text;  // without blanks and quotes around it
    std::size_t column;     // where it begins in the line, from 1
};

/** The fields of a line but its first `skipped` bytes. */
void split(const Line& place, std::size_t skipped, char separator, std::vector<Field>& fields) {
    const std::string_view line = place.text;
    const std::string_view blank = separator == '\t' ? " " : " \t";
    fields.clear();
    const auto skipBlank = [&](std::size_t at) { return std::min(line.find_first_not_of(blank, at), line.size()); };
    std::size_t at = skipped;
    for (bool isMore = true; isMore;) {
        const std::size_t begin = at = skipBlank(at);
        if (separator == kBlanks && begin == line.size()) break;
        std::string_view text;
        if (begin < line.size() && line[begin] == '"') {
            std::size_t end = line.find('"', begin + 1);
            while (end != std::string_view::npos && line.substr(end + 1, 1) == "\"") end = line.find('"', end + 2);
            if (end == std::string_view::npos)
                throw badInput(place.place(begin + 1), "a quote is not closed on its line", "Close it");
            text = line.substr(begin + 1, end - begin - 1);
            at = skipBlank(end + 1);
            const bool isEnd = at == line.size() || line[at] == separator || (separator == kBlanks && at > end + 1);
            if (!isEnd) throw badInput(place.place(at + 1), "text behind a closed quote", "Remove it");
        } else {
            at = separator == kBlanks ? line.find_first_of(blank, begin) : line.find(separator, begin);
            at = std::min(at, line.size());
            text = line.substr(begin, at - begin);
            text = text.substr(0, text.find_last_not_of(blank) + 1);
        }
        fields.push_back({text, begin + 1});
        isMore = at < line.size();
        if (isMore && separator != kBlanks) ++at;
    }
}

/** The separator of a header: tab, semicolon or comma, whichever it has first in this order; else blanks. */
char findSeparator(std::string_view line) {
    std::string bare;  // without what stands in quotes
    bool isQuoted = false;
    for (const char c : line) {
        if (c == '"') isQuoted = !isQuoted;
        if (!isQuoted) bare += c;
    }
    for (const char separator : {'\t', ';', ','})
        if (bare.find(separator) != std::string::npos) return separator;
    return kBlanks;
}

/** A whole text as a number, whatever the locale; nullopt: it is none. nan and infinity are numbers here. */
template <class Number>
std::optional<Number> toNumber(std::string_view text) {
    if (text.size() > 1 && text[0] == '+' && text[1] != '-' && text[1] != '+') text.remove_prefix(1);
    Number value{};
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
    return value;
}

/** Does a line hold numbers only, so that it cannot be the header? */
bool isData(const std::vector<Field>& fields) {
    return std::all_of(fields.begin(), fields.end(),
                       [](const Field& f) { return f.text.empty() || toNumber<double>(f.text); }) &&
           std::any_of(fields.begin(), fields.end(), [](const Field& f) { return !f.text.empty(); });
}

struct Header {
    std::vector<std::string> names;
    char separator = ',';
    std::string place;
    std::size_t line = 0;
};

Header readHeader(const Line& line) {
    const std::size_t marks = std::min(line.text.find_first_not_of("# \t"), line.text.size());
    const std::size_t skipped = line.text.find('#') < marks ? marks : 0;
    Header header;
    header.separator = findSeparator(line.text.substr(skipped));
    header.place = line.place();
    header.line = line.number;
    std::vector<Field> fields;
    split(line, skipped, header.separator, fields);
    for (const Field& field : fields) {
        std::string name(field.text);
        for (std::size_t at = 0; (at = name.find("\"\"", at)) != std::string::npos; ++at) name.erase(at, 1);
        // Between blanks, "t [s]" is one name.
        const bool isUnit = header.separator == kBlanks && !name.empty() && (name[0] == '[' || name[0] == '(');
        if (isUnit && !header.names.empty())
            header.names.back() += " " + name;
        else
            header.names.push_back(std::move(name));
    }
    if (header.names.size() > 1 && header.names.back().empty()) header.names.pop_back();  // a separator at the end
    return header;
}

class CsvRecord {
public:
    CsvRecord(const std::filesystem::path& path, const MotionRecordOptions& options)
        : file_(path.string()), reader_(path), options_(options) {}

    std::vector<std::string> readNames(std::size_t& rows) {
        rows = findHeader() ? 1 : 0;
        while (nextLine()) ++rows;
        return header_.names;
    }

    MotionRecord read() {
        bool isRow = findHeader();
        CsvPlan plan = planCsvColumns(header_.names, options_, header_.place);
        columns_ = std::move(plan.columns);
        record_.joints = std::move(plan.joints);
        torques_.resize(record_.joints.size());
        while (isRow || nextLine()) {
            isRow = false;
            readRow();
        }
        if (record_.times_s.empty())
            throw badInput(file_, "no sample follows the header in line " + std::to_string(header_.line),
                           "Give a file with samples");
        for (std::size_t i = 0; i < torques_.size(); ++i) {
            const bool hasAny =
                std::any_of(torques_[i].begin(), torques_[i].end(), [](double t) { return !std::isnan(t); });
            if (hasAny) record_.joints[i].torques = std::move(torques_[i]);
        }
        return std::move(record_);
    }

private:
    /** Goes to the next line that is neither blank nor a comment. */
    bool nextLine() {
        while (reader_.next()) {
            const std::string_view text = reader_.line().text;
            const std::size_t begin = text.find_first_not_of(" \t;,");
            if (begin != std::string_view::npos && text[begin] != '#') return true;
        }
        return false;
    }

    /** True: the reader is at a row already, as the header was the last comment before it. */
    bool findHeader() {
        std::string comment;
        std::size_t commentNumber = 0;
        while (reader_.next()) {
            const Line line = reader_.line();
            const std::size_t begin = line.text.find_first_not_of(" \t");
            if (begin == std::string_view::npos) continue;
            if (line.text[begin] == '#') {
                comment = line.text;
                commentNumber = line.number;
                continue;
            }
            header_ = readHeader(line);
            split(line, 0, header_.separator, fields_);
            if (!isData(fields_)) return false;
            if (commentNumber > 0) {
                header_ = readHeader({line.file, comment, commentNumber});
                split(line, 0, header_.separator, fields_);
            }
            if (commentNumber == 0 || !hasFieldCount(header_.names.size()))
                throw badInput(line.place(), "numbers, and no line before them names their columns",
                               "Write a header line with names and units, such as time_s,joint1_rad,joint2_rad");
            return true;
        }
        throw badInput(file_, "the file has no header and no samples",
                       "Give a CSV file whose first line names the columns, such as time_s,joint1_rad");
    }

    /** A separator at the line's end opens no further field. */
    bool hasFieldCount(std::size_t n) const {
        return fields_.size() == n || (fields_.size() == n + 1 && fields_.back().text.empty());
    }

    void readRow() {
        split(reader_.line(), 0, header_.separator, fields_);
        if (!hasFieldCount(columns_.size()))
            throw badInput(
                reader_.line().place(),
                "the line has " + std::to_string(fields_.size()) + " fields, the header in line " +
                    std::to_string(header_.line) + " " + std::to_string(columns_.size()),
                "Give each line a field for each column, which may be empty; remove a line that was cut off");
        for (std::size_t i = 0; i < columns_.size(); ++i) {
            const CsvColumn& column = columns_[i];
            const Field& field = fields_[i];
            if (column.use == CsvColumn::Use::None) continue;
            if (column.use == CsvColumn::Use::Time) {
                readTime(field, column.factor);
                continue;
            }
            const MotionRecord::Joint& joint = record_.joints[column.joint];
            double value = std::numeric_limits<double>::quiet_NaN();
            if (!field.text.empty()) value = readNumber<double>(field) * column.factor;
            if (std::isinf(value)) throw infiniteReading(reader_.line().place(field.column), joint.name);
            const bool isTorque = column.use == CsvColumn::Use::Torque;
            (isTorque ? torques_[column.joint] : record_.joints[column.joint].positions).push_back(value);
        }
    }

    template <class Number>
    Number readNumber(const Field& field) const {
        const std::optional<Number> value = toNumber<Number>(field.text);
        if (value) return *value;
        const bool hasComma = field.text.find(',') != std::string_view::npos;
        throw badInput(reader_.line().place(field.column), quoteText(std::string(field.text)) + " is not a number",
                       hasComma ? "Write numbers with a decimal point" : "Correct it, or leave the field empty");
    }

    /** Times are taken relative to the first before they become doubles: seconds since 1970 would lose digits. */
    void readTime(const Field& field, double unitsPerSecond) {
        static_assert(std::numeric_limits<long double>::digits >= 64, "times since 1970 in ns need 61 bits");
        if (field.text.empty())
            throw badInput(reader_.line().place(field.column), "the line has no time", "Write it, or remove the line");
        const auto stamp = readNumber<long double>(field);
        if (!std::isfinite(stamp))
            throw badInput(reader_.line().place(field.column), "the time " + std::string(field.text) + " is not finite",
                           "Correct it, or remove the line");
        if (record_.times_s.empty()) {
            first_ = stamp;
            record_.begin = field.text;
        }
        const auto time_s = static_cast<double>((stamp - first_) / static_cast<long double>(unitsPerSecond));
        if (!record_.times_s.empty() && !(time_s > record_.times_s.back()))
            throw notAscending(reader_.line().place(field.column), before_, std::string(field.text));
        record_.times_s.push_back(time_s);
        before_ = field.text;
    }

    std::string file_;
    LineReader reader_;
    MotionRecordOptions options_;
    Header header_;
    std::vector<CsvColumn> columns_;
    std::vector<Field> fields_;  // of the line at hand
    MotionRecord record_;
    std::vector<std::vector<double>> torques_;
    long double first_ = 0.0L;
    std::string before_;  // the last stamp as it stands in the file
};

}  // namespace

std::vector<std::string> readCsvHeader(const std::filesystem::path& file, std::size_t& rows) {
    return CsvRecord(file, {}).readNames(rows);
}

MotionRecord readCsvRecord(const std::filesystem::path& file, const MotionRecordOptions& options) {
    return CsvRecord(file, options).read();
}

}  // namespace viable::detail
