#pragma once

#include "environment/OccupancyMap.h"

namespace viable {

/** Distances from the solid cells of a map, on a grid over a box, for queries in a tick.

Each node of the grid knows its exact distance from the nearest solid cube of the octree, at any pose of the map. With
f(p) the distance of a point, Q the trilinear interpolation of f^2 from the eight nodes around it, t in [0, 1]^3 the
place between them, h their spacing and v = h^2 sum over the axes of t (1 - t): the nodes' squared distances from the
solid point nearest to p have the mean f(p)^2 + v, and no node's own f^2 is larger, so

    f(p) >= sqrt(max(0, Q - v))

everywhere (Jensen's inequality), continuously, and with equality where the nodes share their nearest point. A node's
distance is at least f(p) minus the node's distance from p, so the bound is too small by at most sqrt(3) h; measured
among random cubes: 1.0 h at worst (in gaps), 0.05 to 0.15 h on average. A brush fire algorithm such as dynamicEDT3D gives
distances between cells, not from their content, and some are too large (18 of 2.6 million cells, by up to 0.02 cells),
which a lower bound must not be. */
class DistanceField {
public:
    /** @param pose          map frame in the base frame
        @param lower, upper  box that is covered, base frame, finite [m]. Solids outside of it count too
        @param cell_m        spacing of the nodes [m], > 0
        @param reach_m       larger distances are clamped to this [m], >= 0
    Throws Error (BadInput) at `place` when the box would have more than kMaxNodes nodes. About half a second for a
    million nodes; 4 bytes each. */
    DistanceField(const OccupancyMap& map, UnknownSpace unknown, const Eigen::Isometry3d& pose,
                  const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, double cell_m, double reach_m,
                  const std::string& place);

    static constexpr std::int64_t kMaxNodes = 16'000'000;

    /** A lower bound of the distance of point p (base frame) from the nearest solid [m];
    0 inside and just in front of it, -infinity outside of the box and for NaN (nothing is known there). Real time. */
    double calcDistance(const Eigen::Vector3d& p) const;
    /** The same with the direction in which it grows (a unit vector away from the solid, or zero where there is
    none: inside, or beyond reach_m). */
    double calcDistance(const Eigen::Vector3d& p, Eigen::Vector3d& gradient) const;

    std::int64_t nodes() const { return static_cast<std::int64_t>(squared_.size()); }

private:
    template <bool kWithGradient>
    double calc(const Eigen::Vector3d& p, Eigen::Vector3d* gradient) const;

    Eigen::Vector3d lower_, upper_;
    double cell_ = 0.0;
    double perCell_ = 0.0;  ///< 1 / cell_
    double reach_ = 0.0;
    int nx_ = 0, ny_ = 0, nz_ = 0;
    std::vector<float> squared_;  ///< distances of the nodes [cell_^2], x fastest
};

}  // namespace viable
