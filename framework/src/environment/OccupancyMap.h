#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "viable/environment/Environment.h"

namespace viable {

/** A map of occupied, free and unknown space (OctoMap), read from a file and never changed. */
class OccupancyMap {
public:
    /** A cube of the map; edges parallel to the map frame's axes. */
    struct Cell {
        Eigen::Vector3d centre;  ///< map frame [m]
        double edge;             ///< [m]
    };

    /** Reads a .bt or .ot file of the kind OcTree. What OctoMap's reader would take amiss is refused before it sees
    the file: more than kMaxBytes, kMaxNodes or kMaxMemoryBytes, a header with anything but what belongs there, a resolution outside
    1 mm to 10 m, a tree deeper than 16 levels, log odds that are no number, and unless the nodes are as many as the
    header says and take every byte. So no cut anywhere passes. Changed bytes are sure to be noticed only where
    `sha256` is stated: without it a flipped bit that keeps the tree's form (free for occupied in a .bt; any log odds
    in a .ot; another resolution) gives another map that is as good as any.
    Throws Error (BadInput), also where the file's SHA-256 is not the one stated. */
    explicit OccupancyMap(const MapChoice& choice);
    ~OccupancyMap();
    OccupancyMap(OccupancyMap&&) noexcept;
    OccupancyMap& operator=(OccupancyMap&&) noexcept;

    static constexpr std::uintmax_t kMaxBytes = 256u << 20;
    static constexpr std::uint64_t kMaxNodes = 50'000'000;
    static constexpr std::uint64_t kMaxMemoryBytes = 1u << 30;  ///< of the tree that the file becomes

    double resolution() const;          ///< edge of the smallest cells [m]
    const std::string& sha256() const;  ///< of the file, hexadecimal

    enum class Occupancy : unsigned char { Free, Occupied, Unknown };
    /** Of a point in the map frame; Unknown outside of the map and for what is no number. */
    Occupancy getOccupancy(const Eigen::Vector3d& point) const;

    /** Calls `visit` for every leaf that touches the box [lower, upper] (map frame, finite) and is occupied; with
    `withUnknown` also for what nothing is known of, in the tree's own cubes, as large as they come: the work is that
    of the tree's nodes in the box, not of the box's volume. Cubes reach beyond the box. */
    void forEachSolidCell(const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, bool withUnknown,
                          const std::function<void(const Cell&)>& visit) const;

private:
    struct Tree;
    std::unique_ptr<Tree> tree_;
};

}  // namespace viable
