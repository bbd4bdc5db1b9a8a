#include "log/ColumnPacking.h"

#include <zstd.h>

#include <algorithm>
#include <cfenv>
#include <cmath>
#include <numeric>

#include "viable/core/TripleIntegrator.h"

namespace viable::mcap {

namespace {

using Type = ColumnPacker::Type;
using Rule = ColumnPacker::Rule;
using Values = std::vector<std::uint64_t>;

/** Of a log; the largest of this program have less than a thousand. */
constexpr std::size_t kMostColumns = 4096;

constexpr int kHighestOrder = 4;  // of a polynomial prediction: from so many numbers
constexpr int kHighestIntegerOrder = 2;
constexpr std::uint8_t kFirstRule = 16;  // methods from here on: a Rule
constexpr std::uint8_t kThousandths = 8, kHighestThousandths = kThousandths + kHighestIntegerOrder;
constexpr std::uint8_t kLastRule = kFirstRule + static_cast<std::uint8_t>(Rule::Acceleration);
constexpr std::uint8_t kAllZero = 255;  // for typicalBits: no bits follow
constexpr std::size_t kTried = 32;      // rows on which the methods compete
constexpr unsigned kLongestUnary = 24;  // ones, after which 64 bits follow as they are
constexpr int kHeaderLevel = 1;         // of Zstandard
/** Largest header accepted, decompressed: forms and descriptions, far below the chunk's own size. [bytes] */
constexpr std::uint64_t kLargestHeader = std::uint64_t{64} << 20;

/** Predictions are the same in every thread, however it rounds. */
class DefaultArithmetic {
public:
    DefaultArithmetic() {
        std::fegetenv(&before_);
        std::fesetenv(FE_DFL_ENV);
    }
    ~DefaultArithmetic() { std::fesetenv(&before_); }
    DefaultArithmetic(const DefaultArithmetic&) = delete;
    DefaultArithmetic& operator=(const DefaultArithmetic&) = delete;

private:
    std::fenv_t before_;
};

double toDouble(std::uint64_t bits) {
    double v;
    std::memcpy(&v, &bits, sizeof(v));
    return v;
}
std::uint64_t toBits(double v) {
    std::uint64_t bits;
    std::memcpy(&bits, &v, sizeof(bits));
    return bits;
}

constexpr std::uint64_t kSign = std::uint64_t{1} << 63;
/** The place of a double in the order of all doubles, and back. */
std::uint64_t toPlace(std::uint64_t bits) {
    return (bits & kSign) != 0 ? ~bits : bits | kSign;
}
std::uint64_t fromPlace(std::uint64_t place) {
    return (place & kSign) != 0 ? place & ~kSign : ~place;
}

/** Small differences of either sign as small numbers. */
std::uint64_t fold(std::uint64_t difference) {
    return (difference << 1) ^ (std::uint64_t{0} - (difference >> 63));
}
std::uint64_t unfold(std::uint64_t folded) {
    return (folded >> 1) ^ (std::uint64_t{0} - (folded & 1));
}

int countBits(std::uint64_t v) {
    return v == 0 ? 0 : 64 - __builtin_clzll(v);
}

/** n / 1000 of an integer n: times that were counted in ns, in us. */
std::uint64_t fromThousandths(std::uint64_t n) {
    return toBits(static_cast<double>(static_cast<std::int64_t>(n)) / 1000.0);
}
bool areThousandths(const Values& values, Values& integers) {
    constexpr double kLargest = 9e15;  // every integer below is a double
    integers.clear();
    for (const std::uint64_t bits : values) {
        const double n = std::nearbyint(toDouble(bits) * 1000.0);
        if (!(std::abs(n) < kLargest)) return false;
        integers.push_back(static_cast<std::uint64_t>(static_cast<std::int64_t>(n)));
        if (fromThousandths(integers.back()) != bits) return false;
    }
    return true;
}

std::uint64_t extrapolateIntegers(const Values& v, std::size_t i, int order) {
    switch (std::min<std::size_t>(i, static_cast<std::size_t>(order))) {
        case 0:
            return 0;
        case 1:
            return v[i - 1];
        default:
            return 2 * v[i - 1] - v[i - 2];
    }
}

double extrapolate(const Values& v, std::size_t i, int order) {
    const auto at = [&](std::size_t back) { return toDouble(v[i - back]); };
    switch (std::min<std::size_t>(i, static_cast<std::size_t>(order))) {
        case 0:
            return 0.0;
        case 1:
            return at(1);
        case 2:
            return 2.0 * at(1) - at(2);
        case 3:
            return 3.0 * (at(1) - at(2)) + at(3);
        default:
            return 4.0 * (at(1) + at(3)) - 6.0 * at(2) - at(4);
    }
}

int countSources(Rule rule) {
    switch (rule) {
        case Rule::None:
            return 0;
        case Rule::Sum:
        case Rule::Difference:
        case Rule::Acceleration:
            return 2;
        case Rule::DifferenceSum:
        case Rule::Velocity:
            return 3;
        case Rule::Position:
            return 4;
    }
    return 0;
}
using SourceValues = std::array<const Values*, ColumnPacker::kMaxSources>;

double followRule(const Values& own, std::size_t i, Rule rule, const SourceValues& from) {
    const auto at = [&](int source, std::size_t row) {
        return toDouble((*from[static_cast<std::size_t>(source)])[row]);
    };
    switch (rule) {
        case Rule::Sum:
            return at(0, i) + at(1, i);
        case Rule::Difference:
            return at(0, i) - at(1, i);
        case Rule::DifferenceSum:
            return at(0, i) - at(1, i) + at(2, i);
        default:
            break;
    }
    const int count = countSources(rule);
    const Values& time = *from[static_cast<std::size_t>(count - 1)];
    const double h = static_cast<double>(static_cast<std::int64_t>(time[i] - time[i - 1])) / 1e9;
    const double jerk = at(count - 2, i - 1), self = toDouble(own[i - 1]);
    if (rule == Rule::Position) return advance({self, at(0, i - 1), at(1, i - 1)}, jerk, h).p;
    if (rule == Rule::Velocity) return advance({0.0, self, at(0, i - 1)}, jerk, h).v;
    return advance({0.0, 0.0, self}, jerk, h).a;
}

/** The predicted number `i` >= 1 of a column, as a place (Double) or as it is. */
std::uint64_t predict(Type type, std::uint8_t method, const Values& own, std::size_t i, const SourceValues& from) {
    if (type != Type::Double || (method >= kThousandths && method <= kHighestThousandths))
        return extrapolateIntegers(own, i, type == Type::Double ? method - kThousandths : method);
    const double guess = method >= kFirstRule ? followRule(own, i, static_cast<Rule>(method - kFirstRule), from)
                                              : extrapolate(own, i, method);
    // A NaN has other bits on other machines.
    if (std::isnan(guess)) return toPlace(own[i - 1]);
    return toPlace(toBits(guess));
}

bool arePlaces(Type type, std::uint8_t method) {
    return type == Type::Double && (method < kThousandths || method >= kFirstRule);
}

std::uint64_t findResidual(Type type, std::uint8_t method, const Values& own, std::size_t i, const SourceValues& from) {
    return fold((arePlaces(type, method) ? toPlace(own[i]) : own[i]) - predict(type, method, own, i, from));
}

/** The Rice code's parameter follows the lengths of the numbers that were coded. */
class RiceState {
public:
    explicit RiceState(std::uint8_t typicalBits) : mean_(typicalBits * kScale) {}
    unsigned parameter() const { return static_cast<unsigned>(std::max(0, (mean_ + kScale / 2) / kScale - 1)); }
    void add(std::uint64_t v) { mean_ += countBits(v) - mean_ / kScale; }

private:
    static constexpr int kScale = 16;
    int mean_;  // of the lengths [bit / kScale]
};

class BitWriter {
public:
    void put(std::uint64_t v, unsigned count) {
        if (count > 32) {
            put(v & 0xFFFFFFFFu, 32);
            v >>= 32;
            count -= 32;
        }
        held_ |= (v & ((std::uint64_t{1} << count) - 1)) << size_;
        size_ += count;
        for (; size_ >= 8; size_ -= 8, held_ >>= 8) bytes.push_back(static_cast<char>(held_ & 0xFF));
    }
    void finish() {
        if (size_ > 0) bytes.push_back(static_cast<char>(held_ & 0xFF));
        held_ = size_ = 0;
    }
    std::string bytes;

private:
    std::uint64_t held_ = 0;
    unsigned size_ = 0;  // [bits] below 8 between calls
};

class BitReader {
public:
    explicit BitReader(std::string_view bytes) : bytes_(bytes) {}
    std::uint64_t take(unsigned count) {
        if (count > 32) {
            const std::uint64_t low = take(32);
            return low | take(count - 32) << 32;
        }
        while (size_ < count) {
            if (at_ == bytes_.size()) throw BadBytes(at_, "the numbers of the chunk are cut off");
            held_ |= std::uint64_t{static_cast<unsigned char>(bytes_[at_++])} << size_;
            size_ += 8;
        }
        const std::uint64_t v = held_ & ((std::uint64_t{1} << count) - 1);
        held_ >>= count;
        size_ -= count;
        return v;
    }
    void expectEnd() const {
        if (at_ != bytes_.size()) throw BadBytes(at_, "bytes follow the numbers of the chunk");
    }

private:
    std::string_view bytes_;
    std::size_t at_ = 0;
    std::uint64_t held_ = 0;
    unsigned size_ = 0;  // [bits] at most 39
};

void putRice(BitWriter& out, RiceState& state, std::uint64_t v) {
    const unsigned k = state.parameter();
    const std::uint64_t high = k < 64 ? v >> k : 0;
    if (high >= kLongestUnary) {
        out.put((std::uint64_t{1} << kLongestUnary) - 1, kLongestUnary);
        out.put(v, 64);
    } else {
        out.put((std::uint64_t{1} << high) - 1, static_cast<unsigned>(high) + 1);  // ones, then a zero
        out.put(v, k);
    }
    state.add(v);
}

std::uint64_t takeRice(BitReader& in, RiceState& state) {
    const unsigned k = state.parameter();
    std::uint64_t high = 0;
    while (high < kLongestUnary && in.take(1) != 0) ++high;
    const std::uint64_t v = high == kLongestUnary ? in.take(64) : high << k | in.take(k);
    state.add(v);
    return v;
}

/** Columns in an order in which the sources of each come before it. */
std::vector<std::uint16_t> sortByRank(std::string_view ranks) {
    std::vector<std::uint16_t> order(ranks.size());
    std::iota(order.begin(), order.end(), std::uint16_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::uint16_t a, std::uint16_t b) {
        return static_cast<unsigned char>(ranks[a]) < static_cast<unsigned char>(ranks[b]);
    });
    return order;
}

std::size_t getSize(Type type) {
    return type == Type::U32 ? 4 : 8;
}

}  // namespace

std::uint16_t ColumnPacker::addColumn(Type type) {
    columns_.push_back({type, Rule::None, {}, {}});
    return static_cast<std::uint16_t>(columns_.size() - 1);
}

void ColumnPacker::setRule(std::uint16_t column, Rule rule, const Sources& sources) {
    columns_[column].rule = rule;
    columns_[column].sources = sources;
}

void ColumnPacker::dropRecord() {
    marks_.clear();
}

void ColumnPacker::endRecord(std::string_view chunk, std::size_t end) {
    ByteWriter form;
    form.bytes.swap(form_);
    form.bytes.clear();
    form.putU16(static_cast<std::uint16_t>(marks_.size()));
    std::size_t at = recordStart_;
    int last = -1;
    for (const Mark& mark : marks_) {
        form.putU16(static_cast<std::uint16_t>(mark.offset - at));
        form.putU16(static_cast<std::uint16_t>(mark.column - (last + 1)));
        last = mark.column;
        at = mark.offset + getSize(columns_[mark.column].type);
    }
    form.putU32(static_cast<std::uint32_t>(end - at));
    at = recordStart_;
    for (const Mark& mark : marks_) {
        Column& column = columns_[mark.column];
        form.bytes += chunk.substr(at, mark.offset - at);
        ByteReader number(chunk.substr(mark.offset, getSize(column.type)));
        column.values.push_back(column.type == Type::U32 ? number.takeU32() : number.takeU64());
        at = mark.offset + getSize(column.type);
    }
    form.bytes += chunk.substr(at, end - at);
    const auto [entry, isNew] = forms_.emplace(form.bytes, static_cast<std::uint16_t>(formTexts_.size()));
    if (isNew) formTexts_.push_back(&entry->first);
    records_.push_back(entry->second);
    recordStart_ = end;
    marks_.clear();
    form_.swap(form.bytes);
}

namespace {

/** How a column of this chunk is written. */
struct Choice {
    std::uint8_t method = 1;
    std::uint8_t typicalBits = 0;  // of a residual
};

/** @param own  of a Double: changed to integers where they are the choice */
Choice choose(Type type, Rule rule, const SourceValues& from, Values& own, Values& scratch) {
    const std::size_t tried = std::min(own.size(), kTried);
    Choice best;
    std::uint64_t least = ~std::uint64_t{0};
    const auto attempt = [&](std::uint8_t method, const Values& values) {
        std::uint64_t cost = 0;
        for (std::size_t i = 1; i < tried; ++i)
            cost += static_cast<std::uint64_t>(countBits(findResidual(type, method, values, i, from)));
        if (cost >= least) return;
        least = cost;
        const std::uint64_t count = std::max<std::size_t>(tried, 2) - 1;
        best = {method, static_cast<std::uint8_t>((cost + count / 2) / count)};
    };
    if (rule != Rule::None) attempt(static_cast<std::uint8_t>(kFirstRule + static_cast<int>(rule)), own);
    const int highest = type == Type::Double ? kHighestOrder : kHighestIntegerOrder;
    for (int order = 1; order <= highest && least > 0; ++order) attempt(static_cast<std::uint8_t>(order), own);
    if (least > 0 && type == Type::Double && areThousandths(own, scratch)) {
        for (std::uint8_t method = kThousandths + 1; method <= kHighestThousandths; ++method) attempt(method, scratch);
        if (best.method > kThousandths && best.method <= kHighestThousandths) own.swap(scratch);
    }
    return best;
}

void rankColumn(const std::vector<ColumnPacker::Sources>& sources, const std::vector<Rule>& rules, std::size_t column,
                std::string& ranks) {
    int rank = 0;
    for (int i = 0; i < countSources(rules[column]); ++i) {
        const std::uint16_t source = sources[column][static_cast<std::size_t>(i)];
        rankColumn(sources, rules, source, ranks);
        rank = std::max(rank, ranks[source] + 1);
    }
    ranks[column] = static_cast<char>(rank);
}

}  // namespace

std::string ColumnPacker::pack() {
    const DefaultArithmetic arithmetic;
    if (ranks_.size() != columns_.size()) {
        std::vector<Sources> sources;
        std::vector<Rule> rules;
        for (const Column& column : columns_) {
            sources.push_back(column.sources);
            rules.push_back(column.rule);
        }
        ranks_.resize(columns_.size());
        for (std::size_t c = 0; c < columns_.size(); ++c) rankColumn(sources, rules, c, ranks_);
    }

    // Sources keep their bits until the columns that follow from them are written.
    std::vector<Choice> choices(columns_.size());
    BitWriter numbers;
    ByteWriter firsts;
    Values own, scratch, residuals;
    for (const std::uint16_t c : sortByRank(ranks_)) {
        const Column& column = columns_[c];
        if (column.values.empty()) continue;
        Rule rule = column.rule;
        SourceValues from{};
        for (int i = 0; i < countSources(rule); ++i) {
            const Values& source = columns_[column.sources[static_cast<std::size_t>(i)]].values;
            from[static_cast<std::size_t>(i)] = &source;
            if (source.size() != column.values.size()) rule = Rule::None;
        }
        own = column.values;
        Choice& choice = choices[c] = choose(column.type, rule, from, own, scratch);
        residuals.clear();
        for (std::size_t i = 1; i < own.size(); ++i)
            residuals.push_back(findResidual(column.type, choice.method, own, i, from));
        firsts.putU64(own[0]);
        if (std::all_of(residuals.begin(), residuals.end(), [](std::uint64_t v) { return v == 0; })) {
            choice.typicalBits = kAllZero;
            continue;
        }
        RiceState state(choice.typicalBits);
        for (const std::uint64_t v : residuals) putRice(numbers, state, v);
    }
    numbers.finish();

    ByteWriter header;
    header.putU32(static_cast<std::uint32_t>(formTexts_.size()));
    for (const std::string* form : formTexts_) header.putString(*form);
    header.putU32(static_cast<std::uint32_t>(records_.size()));
    for (const std::uint16_t form : records_) header.putU16(form);
    header.putU32(static_cast<std::uint32_t>(columns_.size()));
    for (const Column& column : columns_) header.putU8(static_cast<std::uint8_t>(column.type));
    for (const Choice& choice : choices) header.putU8(choice.method);
    for (const Choice& choice : choices) header.putU8(choice.typicalBits);
    header.bytes += ranks_;
    for (std::size_t c = 0; c < columns_.size(); ++c) {
        if (choices[c].method < kFirstRule) continue;
        for (int i = 0; i < countSources(columns_[c].rule); ++i)
            header.putU16(columns_[c].sources[static_cast<std::size_t>(i)]);
    }
    header.bytes += firsts.bytes;

    std::string packedHeader(ZSTD_compressBound(header.bytes.size()), '\0');
    const std::size_t size =
        ZSTD_compress(packedHeader.data(), packedHeader.size(), header.bytes.data(), header.bytes.size(), kHeaderLevel);
    if (ZSTD_isError(size)) throw std::runtime_error(ZSTD_getErrorName(size));
    packedHeader.resize(size);
    ByteWriter out;
    out.putU32(static_cast<std::uint32_t>(header.bytes.size()));
    out.putString(packedHeader);
    out.bytes += numbers.bytes;

    for (Column& column : columns_) column.values.clear();
    forms_.clear();
    formTexts_.clear();
    records_.clear();
    marks_.clear();
    recordStart_ = 0;
    return std::move(out.bytes);
}

namespace {

/** What records of one form have in common. */
struct Form {
    struct Hole {
        std::size_t textBefore;
        std::uint16_t column;
    };
    std::vector<Hole> holes;
    std::string_view text;
};

struct PackedColumn {
    Type type = Type::U32;
    Choice choice;
    ColumnPacker::Sources sources{};
    std::size_t count = 0, given = 0;
    Values values;
};

class Unpacker {
public:
    Unpacker(std::string_view packed, std::size_t size) : size_(size) {
        ByteReader in(packed);
        const std::uint32_t plain = in.takeU32();
        const std::string_view frame = in.takeString();
        if (plain > kLargestHeader) throw BadBytes(0, "the chunk's description is too long");
        header_.resize(plain);
        const std::size_t got = ZSTD_decompress(header_.data(), header_.size(), frame.data(), frame.size());
        if (ZSTD_isError(got) || got != plain) throw BadBytes(0, "the chunk's description cannot be decompressed");
        readHeader();
        BitReader numbers(in.take(in.left()));
        for (const std::uint16_t c : sortByRank(ranks_)) readColumn(columns_[c], numbers);
        numbers.expectEnd();
    }

    std::string write() {
        ByteWriter out;
        out.bytes.reserve(size_);
        for (const std::uint16_t record : records_) {
            const Form& form = forms_[record];
            std::size_t at = 0;
            for (const Form::Hole& hole : form.holes) {
                out.bytes += form.text.substr(at, hole.textBefore);
                at += hole.textBefore;
                PackedColumn& column = columns_[hole.column];
                const std::uint64_t value = column.values[column.given++];
                if (column.type == Type::U32)
                    out.putU32(static_cast<std::uint32_t>(value));
                else
                    out.putU64(value);
            }
            out.bytes += form.text.substr(at);
        }
        return std::move(out.bytes);
    }

private:
    void readHeader() {
        ByteReader in(header_);
        std::vector<std::string_view> texts(takeCount(in, 4));
        for (std::string_view& text : texts) text = in.takeString();
        records_.resize(takeCount(in, 2));
        for (std::uint16_t& record : records_) {
            record = in.takeU16();
            if (record >= texts.size()) throw BadBytes(in.position(), "a record of an unknown form");
        }
        const std::size_t columns = takeCount(in, 4);
        if (columns > kMostColumns) throw BadBytes(in.position(), "too many columns");
        columns_.resize(columns);
        for (PackedColumn& column : columns_) {
            const std::uint8_t type = in.takeU8();
            if (type > static_cast<std::uint8_t>(Type::Double)) throw BadBytes(in.position(), "an unknown type");
            column.type = static_cast<Type>(type);
        }
        for (PackedColumn& column : columns_) column.choice.method = in.takeU8();
        for (PackedColumn& column : columns_) {
            column.choice.typicalBits = in.takeU8();
            if (column.choice.typicalBits > 64 && column.choice.typicalBits != kAllZero)
                throw BadBytes(in.position(), "a number of more than 64 bits");
        }
        ranks_ = in.take(columns_.size());
        for (PackedColumn& column : columns_) {
            const std::uint8_t method = column.choice.method;
            checkMethod(column.type, method, in.position());
            if (method < kFirstRule) continue;
            for (int i = 0; i < countSources(static_cast<Rule>(method - kFirstRule)); ++i)
                column.sources[static_cast<std::size_t>(i)] = in.takeU16();
        }
        for (const std::string_view text : texts) forms_.push_back(readForm(text));
        countNumbers();
        for (const std::uint16_t c : sortByRank(ranks_))
            if (columns_[c].count > 0) columns_[c].values.push_back(in.takeU64());
    }

    /** A number of things of which each takes at least so many bytes. */
    static std::size_t takeCount(ByteReader& in, std::size_t least) {
        const std::uint32_t count = in.takeU32();
        if (count > in.left() / least) throw BadBytes(in.position(), "more entries than bytes");
        return count;
    }

    static void checkMethod(Type type, std::uint8_t method, std::size_t at) {
        const bool isKnown = type != Type::Double ? method <= kHighestIntegerOrder
                                                  : method <= kHighestOrder ||
                                                        (method >= kThousandths && method <= kHighestThousandths) ||
                                                        (method > kFirstRule && method <= kLastRule);
        if (!isKnown) throw BadBytes(at, "numbers are written by the unknown method " + std::to_string(method));
    }

    Form readForm(std::string_view bytes) const {
        ByteReader in(bytes);
        Form form;
        form.holes.resize(in.takeU16());
        std::size_t textSize = 0;
        int last = -1;
        for (Form::Hole& hole : form.holes) {
            hole.textBefore = in.takeU16();
            textSize += hole.textBefore;
            last = (last + 1 + in.takeU16()) & 0xFFFF;
            hole.column = static_cast<std::uint16_t>(last);
            if (hole.column >= columns_.size()) throw BadBytes(in.position(), "a number of an unknown column");
        }
        textSize += in.takeU32();
        form.text = in.take(textSize);
        return form;
    }

    /** Counts the numbers of each column, and that the records give the chunk's size. */
    void countNumbers() {
        std::vector<std::size_t> sizes;
        for (const Form& form : forms_) {
            std::size_t size = form.text.size();
            for (const Form::Hole& hole : form.holes) size += getSize(columns_[hole.column].type);
            sizes.push_back(size);
        }
        std::size_t total = 0;
        for (const std::uint16_t record : records_) {
            total += sizes[record];
            if (total > size_) break;
            for (const Form::Hole& hole : forms_[record].holes) ++columns_[hole.column].count;
        }
        if (total != size_)
            throw BadBytes(0, "the chunk's records do not give its " + std::to_string(size_) + " bytes");
    }

    void readColumn(PackedColumn& column, BitReader& numbers) const {
        if (column.count == 0) return;
        const std::uint8_t method = column.choice.method;
        SourceValues from{};
        if (method >= kFirstRule) {
            for (int i = 0; i < countSources(static_cast<Rule>(method - kFirstRule)); ++i) {
                const std::size_t source = column.sources[static_cast<std::size_t>(i)];
                // One that comes later has its first number alone.
                if (source >= columns_.size() || columns_[source].values.size() != column.count ||
                    &columns_[source] == &column)
                    throw BadBytes(0, "a column follows from one that is not known");
                from[static_cast<std::size_t>(i)] = &columns_[source].values;
            }
        }
        Values& own = column.values;
        own.reserve(column.count);
        const bool isZero = column.choice.typicalBits == kAllZero;
        RiceState state(isZero ? std::uint8_t{0} : column.choice.typicalBits);
        for (std::size_t i = 1; i < column.count; ++i) {
            const std::uint64_t residual = isZero ? 0 : unfold(takeRice(numbers, state));
            const std::uint64_t value = predict(column.type, method, own, i, from) + residual;
            own.push_back(arePlaces(column.type, method) ? fromPlace(value) : value);
        }
        if (column.type == Type::Double && method >= kThousandths && method <= kHighestThousandths)
            for (std::uint64_t& value : own) value = fromThousandths(value);
    }

    std::size_t size_;
    std::string header_;
    std::vector<Form> forms_;
    std::vector<std::uint16_t> records_;
    std::vector<PackedColumn> columns_;
    std::string_view ranks_;
};

}  // namespace

std::string unpackColumns(std::string_view packed, std::size_t size) {
    const DefaultArithmetic arithmetic;
    return Unpacker(packed, size).write();
}

}  // namespace viable::mcap
