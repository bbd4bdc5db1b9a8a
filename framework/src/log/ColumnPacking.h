#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "log/Mcap.h"

namespace viable::mcap {

/** What a chunk says of its compression by ColumnPacker. */
inline constexpr std::string_view kColumnCompression = "x-viable-columns";

/** Compresses the records of a chunk without loss: rows of numbers that change little from one to the next, such as
states at 1 kHz, of which a compressor of texts (Zstandard) takes hardly a bit away.

Method: each number belongs to a column. A column's next number is predicted from those before it (a polynomial of
degree 0 to 3, whatever fits best in this chunk) or from other columns (a sum; motion under constant jerk), and what is
written is the difference of the two numbers' places in the order of all doubles, by an adaptive Rice code (R. F. Rice,
JPL 79-22, 1979; the prediction as in P. Lindstrom, M. Isenburg, Fast and efficient compression of floating-point data,
2006). The bytes between the numbers are written once for all records that have the same, in a Zstandard frame. Each
chunk stands for itself. Equal input gives equal bytes, and every bit comes back on any machine with IEEE 754 doubles.

Layout, little-endian; a text is its length (u32) and its bytes:
    u32 size of the description; the description in one Zstandard frame, as a text; the Rice codes as bits from the
    lowest of each byte on, column by column, those of rank 0 first.
    The description: u32 count of forms, each a text: u16 count of numbers, for each number u16 bytes before it and
    u16 columns passed over since the last one; u32 bytes behind; all these bytes. u32 count of records, each u16 form.
    u32 count of columns, then kind by kind, of each column: u8 type, u8 method, u8 bits of a typical residual (255: all
    residuals are 0, no code follows), u8 rank; u16 sources, of those whose method is a rule; u64 first number, of those
    with numbers, in the order of the codes.
    Methods: 0 to 4 the polynomial through so many numbers, 8 to 10 the same for integers in thousandths, 16 + Rule.
The layout is in people's files: methods may be added, none may change.

Thread: one caller at a time. Not for the tick. */
class ColumnPacker {
public:
    enum class Type : std::uint8_t { U32, U64, Double };

    /** How a column follows from others, which are given in this order. What does not follow exactly costs the bits in
    which it differs; a relation that does not hold is not used. */
    enum class Rule : std::uint8_t {
        None,
        Sum,            ///< a + b
        Difference,     ///< a - b
        DifferenceSum,  ///< a - b + c
        Position,       ///< velocity, acceleration, jerk one row before, log time [ns]
        Velocity,       ///< acceleration, jerk one row before, log time [ns]
        Acceleration,   ///< jerk one row before, log time [ns]
    };
    static constexpr std::size_t kMaxSources = 4;
    using Sources = std::array<std::uint16_t, kMaxSources>;

    /** Returns its number, from 0. */
    std::uint16_t addColumn(Type type);
    /** @param sources  columns of type Double, the log time U64; none follows from itself */
    void setRule(std::uint16_t column, Rule rule, const Sources& sources);

    /** In the record at hand a number of this column stands at `offset` of the chunk; offsets ascend. */
    void mark(std::size_t offset, std::uint16_t column) { marks_.push_back({offset, column}); }
    /** The record at hand is taken back. */
    void dropRecord();
    /** The record at hand, the bytes of the chunk from the end of the one before to `end`, is whole. */
    void endRecord(std::string_view chunk, std::size_t end);
    /** The packed chunk, which consists of the records ended since the last call. */
    std::string pack();

private:
    struct Column {
        Type type;
        Rule rule = Rule::None;
        Sources sources{};
        std::vector<std::uint64_t> values;  // bits; of this chunk
    };
    struct Mark {
        std::size_t offset;
        std::uint16_t column;
    };

    std::vector<Column> columns_;
    std::string ranks_;            // by column: 0, or above those of its sources
    std::vector<Mark> marks_;      // of the record at hand
    std::size_t recordStart_ = 0;  // in the chunk
    std::unordered_map<std::string, std::uint16_t> forms_;
    std::vector<const std::string*> formTexts_;
    std::vector<std::uint16_t> records_;  // their forms
    std::string form_;
};

/** Gives back the `size` bytes of a chunk. Trusts no length in `packed`. Throws BadBytes. */
std::string unpackColumns(std::string_view packed, std::size_t size);

}  // namespace viable::mcap
