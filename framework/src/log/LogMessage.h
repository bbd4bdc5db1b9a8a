#pragma once

#include <cmath>

#include "log/LogFields.h"
#include "log/Mcap.h"

namespace viable {

/** Numbers of a field in a message of so many joints. */
inline int countNumbers(const LogField& field, int joints) {
    return field.isPerJoint() ? joints : field.kind == LogKind::Vector ? static_cast<int>(field.elements.size()) : 1;
}

/** Appends a channel's message of a row: ROS 2's CDR, little-endian, with its head. */
inline void putMessage(const LogChannel& channel, const TickRecord& record, int joints, mcap::ByteWriter& out) {
    out.bytes += mcap::kCdrLittleEndian;
    const std::size_t origin = out.bytes.size();
    for (const LogField& field : channel.fields) {
        const int count = countNumbers(field, joints);
        if (field.isPerJoint()) {
            out.align(origin, 4);
            out.putU32(static_cast<std::uint32_t>(count));
        }
        if (field.kind == LogKind::Integer) {
            out.align(origin, 8);
            out.putU64(static_cast<std::uint64_t>(field.integer(record)));
        } else if (field.isText()) {
            for (int i = 0; i < count; ++i) {
                const std::string_view word = field.text(record, i);
                out.align(origin, 4);
                out.putU32(static_cast<std::uint32_t>(word.size() + 1));
                out.bytes += word;
                out.bytes.push_back('\0');
            }
        } else {
            out.align(origin, 8);
            for (int i = 0; i < count; ++i) out.putDouble(field.getNumber(record, i));
        }
    }
}

/** A row's place on the log's clock [ns], which only sorts messages: NaN and negative times become 0. */
inline std::uint64_t toLogTime(double time_s) {
    const double ns = time_s * 1e9;
    return ns > 0.0 && ns < 9e18 ? static_cast<std::uint64_t>(std::llround(ns)) : 0;
}

}  // namespace viable
