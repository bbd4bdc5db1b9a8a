#pragma once

#include <functional>

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

    /** Reads a .bt or .ot file of the kind OcTree. Files that OctoMap's reader would misread are refused before it sees
    them: more than kMaxBytes, kMaxNodes or kMaxMemoryBytes, an unexpected header, a resolution outside
    1 mm to 10 m, a tree deeper than 16 levels, log odds that are NaN, and files whose number of nodes differs from the
    header's or that have bytes left. So no truncated file passes. Changed bytes are found with certainty only where
    `sha256` is given: without it a flipped bit that keeps the tree's form (free for occupied in a .bt; any log odds
    in a .ot; another resolution) gives another valid map.
    Throws Error (BadInput), also where the file's SHA-256 is not the one stated. */
    explicit OccupancyMap(const MapChoice& choice);
    ~OccupancyMap();
    OccupancyMap(OccupancyMap&&) noexcept;
    OccupancyMap& operator=(OccupancyMap&&) noexcept;

    static constexpr std::uintmax_t kMaxBytes = 256u << 20;
    static constexpr std::uint64_t kMaxNodes = 50'000'000;
    static constexpr std::uint64_t kMaxMemoryBytes = 1u << 30;  ///< of the tree in memory

    double resolution() const;          ///< edge of the smallest cells [m]
    const std::string& sha256() const;  ///< of the file, hexadecimal

    enum class Occupancy : unsigned char { Free, Occupied, Unknown };
    /** Of a point in the map frame; Unknown outside of the map and for NaN. */
    Occupancy getOccupancy(const Eigen::Vector3d& point) const;

    /** Calls `visit` for every leaf that touches the box [lower, upper] (map frame, finite) and is occupied; with
    `withUnknown` also for unknown space, in the tree's own cubes: the work grows with
    the tree's nodes in the box, not with the box's volume. Cubes may extend beyond the box. */
    void forEachSolidCell(const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, bool withUnknown,
                          const std::function<void(const Cell&)>& visit) const;

private:
    struct Tree;
    std::unique_ptr<Tree> tree_;
};

}  // namespace viable
