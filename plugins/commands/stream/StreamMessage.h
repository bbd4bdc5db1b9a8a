#pragma once

#include <array>
#include <cstdint>

#include "viable/core/JointTypes.h"

namespace viable {

/** What a program sends over the socket, and what it is answered: little-endian, as all machines that this builds on. Answers go
to a socket of an abstract address (bind() with the family alone) and to no other: a path would be looked up in the tick. The same
numbers stand in tools/python/viable/_stream.py. */
struct TargetMessage {
    static constexpr std::uint32_t kMagic = 0x52545356;  // "VSTR"
    static constexpr std::uint16_t kVersion = 1;
    enum class Space : std::uint16_t { Joint, Tool };
    enum class Kind : std::uint32_t {
        Target,
        Goodbye,  ///< the last one of its sender: another program is heard at once; without numbers, not answered
    };
    static constexpr int kToolNumbers = 7;  // position [m], quaternion w x y z

    std::uint32_t magic = kMagic;
    std::uint16_t version = kVersion;
    Space space = Space::Joint;
    std::array<std::uint8_t, 16> token{};
    std::uint64_t sender = 0;    ///< a number for each connection, drawn, not 0
    std::uint64_t sequence = 0;  ///< rising
    std::int64_t sent_ns = 0;    ///< CLOCK_MONOTONIC, which all programs of a computer share
    std::uint32_t count = 0;     ///< of the numbers that follow: only these are sent
    Kind kind = Kind::Target;
    std::array<double, kMaxJoints> numbers{};
};
inline constexpr std::size_t kTargetHeader = 56;
static_assert(sizeof(TargetMessage) == kTargetHeader + 8 * kMaxJoints, "no gaps");

/** What became of a target. */
enum class TargetVerdict : std::uint16_t {
    Taken,
    Malformed,  ///< size, magic, version, sender or kind
    Token,
    Busy,       ///< another program sends
    Space,      ///< joints for the tool or the other way, or another number of them
    NotFinite,  ///< or a quaternion that is none
    Old,        ///< sent before one that has been taken
    Stale,      ///< too old when it came
};

struct TargetAnswer {
    std::uint32_t magic = TargetMessage::kMagic;
    std::uint16_t version = TargetMessage::kVersion;
    TargetVerdict verdict = TargetVerdict::Taken;
    std::uint64_t sequence = 0;
    double age_s = 0.0;  ///< when it was looked at
};
static_assert(sizeof(TargetAnswer) == 24, "no gaps");

}  // namespace viable
