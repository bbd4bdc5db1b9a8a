#pragma once

#include <map>
#include <optional>

#include "viable/core/JointLimits.h"

namespace viable {

/** What a log's metadata say of its run. In the file they are texts by name: only the functions below know the names
and what stands in the texts. */
struct LogMetadata {
    std::string caseName, version;
    std::string robot;                         ///< its folder
    std::vector<std::string> prismaticJoints;  ///< those that slide
    std::optional<JointLimits> realLimits;     ///< held on the real arm: position and velocity alone
    /** How far the real arm may be from the nominal one, by joint. */
    struct Bound {
        JointVector position, velocity, measured;  // [rad], [rad/s], [rad]
    };
    std::optional<Bound> bound;
    /** What the indices of the log's channels stand for; none without an environment. */
    std::optional<std::vector<std::string>> obstacles, links;
    /** Likewise; none without people. */
    std::optional<std::vector<std::string>> people;
    std::string mapSha256;  ///< of the occupancy map; empty: none
    /** The plugins' libraries by the name of their kind ("filter"): one, or those of a chain in its order. */
    std::map<std::string, std::vector<std::string>> libraries;

    /** Of a log that was read: what is wrong with a text, by its name; its field is left as if there were none. */
    std::map<std::string, std::string> damaged;
    static constexpr char kPrismaticJoints[] = "prismatic_joints", kRealLimits[] = "real_limits";
    /** Throws Error (BadInput) where the text of that name is damaged. @param log  for the message */
    void refuseDamaged(const std::string& name, const std::string& log) const;
};

std::map<std::string, std::string> writeLogMetadata(LogMetadata metadata);

/** @param texts   the metadata of a log
@param joints  of that log */
LogMetadata readLogMetadata(const std::map<std::string, std::string>& texts, const std::vector<std::string>& joints);

}  // namespace viable
