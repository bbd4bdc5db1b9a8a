#include "environment/DistanceField.h"

#include <cmath>

#include "core/Text.h"
#include "environment/CellTree.h"

namespace viable {

/** Squared distances are stored as float and this much too small, which outweighs all rounding. */
constexpr double kRoundedDown = 1.0 - 1e-6;

DistanceField::DistanceField(const OccupancyMap& map, UnknownSpace unknown, const Eigen::Isometry3d& pose,
                             const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, double cell_m, double reach_m,
                             const std::string& place)
    : lower_(lower), upper_(upper), cell_(cell_m), perCell_(1.0 / cell_m), reach_(reach_m) {
    VIABLE_CHECK(cell_m > 0.0 && reach_m >= 0.0 && lower.allFinite() && upper.allFinite() &&
                     (lower.array() <= upper.array()).all(),
                 "a field has an extent");
    const Eigen::Array3d count = ((upper - lower).array() * perCell_).ceil().max(1.0) + 1.0;
    if (!(count.prod() <= static_cast<double>(kMaxNodes)))
        throw badInput(place,
                       "the distance field around the arm would have " + detail::formatNumber(count.prod()) +
                           " nodes, " + detail::formatNumber(cell_m) +
                           " m apart, allowed: " + std::to_string(kMaxNodes),
                       "Make its cells larger (field_cell_m).");
    nx_ = static_cast<int>(count[0]);
    ny_ = static_cast<int>(count[1]);
    nz_ = static_cast<int>(count[2]);

    // Two cells more than the reach, so that interpolation between far nodes still shows it.
    const double most = reach_m + 2.0 * cell_m;
    const Eigen::Isometry3d toMap = pose.inverse();
    const Eigen::Vector3d middle = toMap * Eigen::Vector3d(0.5 * (lower + upper));
    const Eigen::Vector3d extent = (toMap.linear().cwiseAbs() * (0.5 * (upper - lower))).array() + most + cell_m;
    std::vector<OccupancyMap::Cell> cubes;
    map.forEachSolidCell(middle - extent, middle + extent, unknown == UnknownSpace::Occupied,
                         [&](const OccupancyMap::Cell& cube) { cubes.push_back(cube); });
    const detail::CellTree tree(std::move(cubes));
    squared_.reserve(static_cast<std::size_t>(count.prod()));
    for (int k = 0; k < nz_; ++k)
        for (int j = 0; j < ny_; ++j) {
            std::size_t nearest = detail::CellTree::kNone;
            for (int i = 0; i < nx_; ++i) {
                const Eigen::Vector3d node = lower + cell_m * Eigen::Vector3d(i, j, k);
                const double squared = tree.findSquaredDistance(toMap * node, most * most, nearest);
                squared_.push_back(static_cast<float>(squared * perCell_ * perCell_ * kRoundedDown));
            }
        }
}

template <bool kWithGradient>
double DistanceField::calc(const Eigen::Vector3d& p, Eigen::Vector3d* gradient) const {
    if constexpr (kWithGradient) gradient->setZero();
    if (!((p.array() >= lower_.array()).all() && (p.array() <= upper_.array()).all()))
        return -std::numeric_limits<double>::infinity();  // what is NaN, too
    const Eigen::Vector3d place = (p - lower_) * perCell_;
    const int i = std::min(static_cast<int>(place.x()), nx_ - 2);
    const int j = std::min(static_cast<int>(place.y()), ny_ - 2);
    const int k = std::min(static_cast<int>(place.z()), nz_ - 2);
    const double x = place.x() - i, y = place.y() - j, z = place.z() - k;
    const std::ptrdiff_t dy = nx_, dz = std::ptrdiff_t{nx_} * ny_;
    const float* corner = squared_.data() + k * dz + j * dy + i;
    const double q000 = corner[0], q100 = corner[1], q010 = corner[dy], q110 = corner[dy + 1];
    const double q001 = corner[dz], q101 = corner[dz + 1];
    const double q011 = corner[dz + dy], q111 = corner[dz + dy + 1];
    const double q00 = q000 + x * (q100 - q000), q10 = q010 + x * (q110 - q010);
    const double q01 = q001 + x * (q101 - q001), q11 = q011 + x * (q111 - q011);
    const double q0 = q00 + y * (q10 - q00), q1 = q01 + y * (q11 - q01);
    const double squared = q0 + z * (q1 - q0) - (x * (1.0 - x) + y * (1.0 - y) + z * (1.0 - z));
    if (!(squared > 0.0)) return 0.0;
    const double distance = std::sqrt(squared) * cell_;
    if (distance >= reach_) return reach_;
    if constexpr (kWithGradient) {
        const double x0 = q100 - q000 + y * (q110 - q010 - q100 + q000);
        const double x1 = q101 - q001 + y * (q111 - q011 - q101 + q001);
        *gradient << x0 + z * (x1 - x0) - (1.0 - 2.0 * x), q10 - q00 + z * (q11 - q01 - q10 + q00) - (1.0 - 2.0 * y),
            q1 - q0 - (1.0 - 2.0 * z);
        const double length = gradient->norm();
        if (length > 1e-9)
            *gradient /= length;
        else
            gradient->setZero();
    }
    return distance;
}

double DistanceField::calcDistance(const Eigen::Vector3d& p) const {
    return calc<false>(p, nullptr);
}

double DistanceField::calcDistance(const Eigen::Vector3d& p, Eigen::Vector3d& gradient) const {
    return calc<true>(p, &gradient);
}

}  // namespace viable
