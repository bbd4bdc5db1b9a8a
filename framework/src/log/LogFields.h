#pragma once

#include <functional>
#include <string_view>

#include "log/LogWriter.h"

namespace viable {

enum class LogKind : unsigned char {
    JointNumber,  ///< float64[]: one per joint
    Number,       ///< float64
    Vector,       ///< float64[N]: N = elements.size()
    JointName,    ///< string[]: one word per joint
    Name,         ///< string: one word
    Integer,      ///< int64
};

/** One logged quantity: its names and how to reach it in a TickRecord. Only the functions of its
kind are set. */
struct LogField {
    std::string name;  ///< last part of its columns, with the unit
    LogKind kind;
    std::vector<std::string> elements;  ///< Vector: last part of the column of each element
    std::function<const JointVector&(const TickRecord&)> joints = {};  ///< JointNumber, or the next two
    std::function<JointVector&(TickRecord&)> updJoints = {};
    std::function<const double&(const TickRecord&, int)> number = {};  ///< JointNumber, Number, Vector
    std::function<double&(TickRecord&, int)> updNumber = {};
    std::function<const char*(const TickRecord&, int)> text = {};
    std::function<bool(TickRecord&, int, std::string_view)> setText = {};  ///< false: no such word
    std::function<std::int64_t(const TickRecord&)> integer = {};
    std::function<bool(TickRecord&, std::int64_t)> setInteger = {};  ///< false: out of range
    /** Logs of before it came lack it, and its value in a new TickRecord is what they mean. */
    bool mayLack = false;

    bool isPerJoint() const { return kind == LogKind::JointNumber || kind == LogKind::JointName; }
    bool isText() const { return kind == LogKind::JointName || kind == LogKind::Name; }
    /** A number of any kind but Integer. NaN where a joint vector is too short. */
    double getNumber(const TickRecord& record, int i) const;

    /** ROS 2 allows only lower case letters: "tau_Nm" is "tau_nm" in a schema. */
    std::string getSchemaName() const;
    std::string getSchemaType() const;
};

/** A source of quantities: an MCAP channel with a message type of its own. */
struct LogChannel {
    std::string name;     ///< "nominal": topic "/nominal", columns "nominal...."
    std::string message;  ///< "Nominal": schema "viable/msg/Nominal"
    std::function<bool(const LogLayout&)> isLogged;
    std::vector<LogField> fields;
    /** Written in the first row of each chunk and in rows where a value differs from the row before; a row without a
    message of this channel has the values of the last one in its chunk. */
    bool isOnChange = false;

    std::string getTopic() const { return "/" + name; }
    std::string getSchema() const { return "viable/msg/" + message; }
    std::string getSchemaText() const;
};

/** The declaration of everything that is logged, in the order of the CSV columns. Schemas,
encoding, decoding and columns all follow from it. What is told stays as long as the program. Kinds of limits that are added
later come behind; one whose row is another now has another channel. */
std::vector<const LogChannel*> listLogChannels();

}  // namespace viable
