#include "log/ColumnPacking.h"

#include <gtest/gtest.h>

#include <cfenv>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <set>

#include "Effort.h"
#include "viable/core/TripleIntegrator.h"

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace viable::mcap {
namespace {

using Type = ColumnPacker::Type;
using Rule = ColumnPacker::Rule;

double toDouble(std::uint64_t bits) {
    double v;
    std::memcpy(&v, &bits, sizeof(v));
    return v;
}

/** A chunk as the log's writer makes it: texts, and numbers that belong to columns. */
class Chunk {
public:
    explicit Chunk(ColumnPacker& packer) : packer_(packer) {}
    void text(const std::string& s) { bytes_.bytes += s; }
    void number(std::uint16_t column, std::uint64_t v) {
        packer_.mark(bytes_.bytes.size(), column);
        bytes_.putU64(v);
    }
    void number(std::uint16_t column, double v) {
        packer_.mark(bytes_.bytes.size(), column);
        bytes_.putDouble(v);
    }
    void shortNumber(std::uint16_t column, std::uint32_t v) {
        packer_.mark(bytes_.bytes.size(), column);
        bytes_.putU32(v);
    }
    void end() { packer_.endRecord(bytes_.bytes, bytes_.bytes.size()); }
    void drop(std::size_t size) {
        bytes_.bytes.resize(size);
        packer_.dropRecord();
    }
    const std::string& bytes() const { return bytes_.bytes; }

private:
    ColumnPacker& packer_;
    ByteWriter bytes_;
};

/** Any bits, among them the numbers at which doubles change their ways. */
std::uint64_t drawBits(std::mt19937_64& random) {
    using Limits = std::numeric_limits<double>;
    const double special[] = {0.0,
                              -0.0,
                              Limits::infinity(),
                              -Limits::infinity(),
                              Limits::max(),
                              Limits::denorm_min(),
                              -Limits::min(),
                              Limits::quiet_NaN(),
                              1.0,
                              1.0 - Limits::epsilon() / 2.0};
    if (random() % 3 != 0) return random();
    std::uint64_t bits;
    std::memcpy(&bits, &special[random() % std::size(special)], sizeof(bits));
    return random() % 4 == 0 ? bits ^ 1 : bits;
}

/** A packer with columns of all types and rules, and chunks of any content for it. */
class AnyChunk {
public:
    explicit AnyChunk(unsigned seed) : random_(seed) {
        for (const Type type : {Type::U32, Type::U64}) packer.addColumn(type);
        for (int i = 0; i < 12; ++i) packer.addColumn(Type::Double);
        packer.setRule(2, Rule::Position, {3, 4, 5, 1});
        packer.setRule(3, Rule::Velocity, {4, 5, 1, 0});
        packer.setRule(4, Rule::Acceleration, {5, 1, 0, 0});
        packer.setRule(6, Rule::Sum, {2, 7, 0, 0});
        packer.setRule(8, Rule::Difference, {6, 5, 0, 0});
        packer.setRule(9, Rule::DifferenceSum, {6, 5, 10, 0});
    }

    std::string make() {
        Chunk chunk(packer);
        const int rows = static_cast<int>(random_() % 90);
        const bool isSmooth = random_() % 2 == 0;
        AxisState state{1.0, -0.3, 0.2};
        for (int row = 0; row < rows; ++row) {
            const auto ns = static_cast<std::uint64_t>(row) * 1'000'000;
            chunk.text("row");
            chunk.shortNumber(0, static_cast<std::uint32_t>(isSmooth ? row - 3 : static_cast<int>(random_())));
            chunk.number(1, isSmooth ? ns : random_());
            const double jerk = row % 20 < 10 ? 30.0 : -28.5;
            const double torque = std::sin(0.01 * row);
            const double smooth[] = {state.p,
                                     state.v,
                                     state.a,
                                     jerk,
                                     state.p + torque,
                                     torque,
                                     state.p + torque - jerk,
                                     state.p + torque - jerk + 2.0 * torque,
                                     2.0 * torque,
                                     std::floor(1e4 * torque) / 1000.0};
            for (std::uint16_t c = 0; c < std::size(smooth); ++c)
                chunk.number(static_cast<std::uint16_t>(c + 2), isSmooth ? smooth[c] : toDouble(drawBits(random_)));
            state = advance(state, jerk, 1e-3);
            chunk.text(random_() % 9 == 0 ? std::string(random_() % 40, 'x') : "none");
            if (random_() % 5 == 0) {
                const std::size_t size = chunk.bytes().size();
                chunk.end();
                chunk.number(12, 3.5);
                chunk.drop(size);
            }
            if (random_() % 7 == 0) chunk.number(13, 1.0 / row);  // not in every row
            chunk.end();
        }
        return chunk.bytes();
    }

    ColumnPacker packer;

private:
    std::mt19937_64 random_;
};

TEST(ColumnPacking, AnyChunkComesBack) {
    AnyChunk any(static_cast<unsigned>(test::getSeed(5)));
    AnyChunk again(static_cast<unsigned>(test::getSeed(5)));
    for (int i = 0; i < test::countOf(2000); ++i) {
        const std::string chunk = any.make();
        const std::string packed = any.packer.pack();
        ASSERT_EQ(unpackColumns(packed, chunk.size()), chunk) << "chunk " << i;
        again.make();
        ASSERT_EQ(again.packer.pack(), packed) << "equal chunks, other bytes";
    }
}

TEST(ColumnPacking, WhatFollowsFromOthersCostsNothing) {
    const auto pack = [](bool hasRules) {
        ColumnPacker packer;
        const std::uint16_t time = packer.addColumn(Type::U64);
        for (int i = 0; i < 7; ++i) packer.addColumn(Type::Double);
        if (hasRules) {
            packer.setRule(1, Rule::Position, {2, 3, 4, time});
            packer.setRule(2, Rule::Velocity, {3, 4, time, 0});
            packer.setRule(3, Rule::Acceleration, {4, time, 0, 0});
            packer.setRule(7, Rule::Difference, {5, 6, 0, 0});
        }
        Chunk chunk(packer);
        std::mt19937_64 random(3);
        std::uniform_real_distribution<double> draw(1.0, 2.0);  // 52 bits
        AxisState state{0.2, 0.0, 0.0};
        for (std::uint64_t row = 0; row < 100; ++row) {
            const double jerk = 40.0 * draw(random), one = draw(random), other = draw(random);
            chunk.number(time, row * 1'000'000);
            std::uint16_t c = 1;
            for (const double v : {state.p, state.v, state.a, jerk, one, other, one - other}) chunk.number(c++, v);
            chunk.end();
            state = advance(state, jerk, 0.001);
        }
        const std::string packed = packer.pack();
        EXPECT_EQ(unpackColumns(packed, chunk.bytes().size()), chunk.bytes());
        return packed.size();
    };
    // Three random columns remain, and what is said of the columns.
    EXPECT_LT(pack(true), 100u * 3 * 7 + 200);
    EXPECT_GT(pack(false), pack(true) + 1500);
}

TEST(ColumnPacking, TimesInWholeNanosecondsAreShort) {
    ColumnPacker packer;
    const std::uint16_t column = packer.addColumn(Type::Double);
    Chunk chunk(packer);
    std::mt19937_64 random(4);
    for (int row = 0; row < 1000; ++row) {
        chunk.number(column, static_cast<double>(20000 + random() % 1000) / 1000.0);
        chunk.end();
    }
    const std::string packed = packer.pack();
    EXPECT_EQ(unpackColumns(packed, chunk.bytes().size()), chunk.bytes());
    EXPECT_LT(packed.size(), 1600u);  // 10 bits are drawn
}

TEST(ColumnPacking, HoweverTheThreadRounds) {
    AnyChunk plain(8), odd(8);
    for (int i = 0; i < 60; ++i) {
        const std::string chunk = plain.make();
        const std::string expected = plain.packer.pack();
        odd.make();
        std::fesetround(i % 2 == 0 ? FE_UPWARD : FE_TOWARDZERO);
#if defined(__SSE__)
        _mm_setcsr(_mm_getcsr() | 0x8040);  // flush-to-zero, denormals-are-zero
#endif
        const std::string packed = odd.packer.pack();
        const std::string back = unpackColumns(packed, chunk.size());
        const int rounding = std::fegetround();
        std::fesetenv(FE_DFL_ENV);
        EXPECT_EQ(rounding, i % 2 == 0 ? FE_UPWARD : FE_TOWARDZERO);
        ASSERT_EQ(packed, expected);
        ASSERT_EQ(back, chunk);
    }
}

TEST(ColumnPacking, NoBytesAtAllMakeItFallOver) {
    AnyChunk any(9);
    std::mt19937_64 random(10);
    std::set<std::string> reasons;
    for (int i = 0; i < test::countOf(300); ++i) {
        const std::string chunk = any.make();
        const std::string packed = any.packer.pack();
        // The frame of the description has no checksum, so that its bytes become anything, too.
        for (int k = 0; k < 20; ++k) {
            std::string bytes = packed.substr(0, random() % 4 == 0 ? random() % packed.size() : packed.size());
            for (std::uint64_t n = random() % 4; n > 0 && !bytes.empty(); --n)
                bytes[random() % bytes.size()] = static_cast<char>(random() % 3 == 0 ? 0xff : random());
            try {
                const std::size_t size = random() % 5 == 0 ? random() % 10000 : chunk.size();
                EXPECT_EQ(unpackColumns(bytes, size).size(), size);
            } catch (const BadBytes& e) {
                reasons.insert(std::string(e.what()).substr(0, 20));
            }
        }
    }
    EXPECT_GE(reasons.size(), 5u);
}

}  // namespace
}  // namespace viable::mcap
