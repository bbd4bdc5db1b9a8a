#pragma once

#include "viable/config/ConfigNode.h"

namespace viable {

/** Smallest speed limit accepted [m/s]: below it a number is a mistake in the unit. */
inline constexpr double kSmallestSpeedLimit = 1e-3;

/** Largest speeds of an arm's points in the base frame [m/s]; infinite: no limit. Such as 0.25 m/s, the reduced speed of
ISO 10218-1. In a file:

    arm_mps: 0.25
    tool_mps: 0.5
    regions:
      table: {lower_m: [0.2, -0.4, 0], upper_m: [0.8, 0.4, 0.5], speed_mps: 0.1} */
struct SpeedLimits {
    /** A box in which a lower speed counts. It counts for all points of a capsule as soon as its segment is in the
    box enlarged by the capsule's radius. */
    struct Region {
        std::string name;
        Eigen::Vector3d lower = Eigen::Vector3d::Zero(), upper = Eigen::Vector3d::Zero();  ///< corners, base frame [m]
        double speed = std::numeric_limits<double>::infinity();

        template <class V>
        void describe(V& v) {
            v(lower, "lower_m", "m", "Its corner with the smallest x, y and z, base frame.")
                .atLeast(-1000)
                .upTo(1000)
                .required();
            v(upper, "upper_m", "m", "Its corner with the largest.").atLeast(-1000).upTo(1000).required();
            v(speed, "speed_mps", "m/s", "Largest speed there.").atLeast(kSmallestSpeedLimit).orInfinite().required();
        }
        void check(const ConfigNode& block) const;
    };

    double arm = std::numeric_limits<double>::infinity();  ///< limit for every point of the capsules that a joint moves
    double tool = std::numeric_limits<double>::infinity();  ///< limit for the tool frame's origin
    std::vector<Region> regions;

    template <class V>
    void describe(V& v) {
        v(arm, "arm_mps", "m/s", "Of every point of the capsules that a joint moves.")
            .atLeast(kSmallestSpeedLimit)
            .orInfinite();
        v(tool, "tool_mps", "m/s", "Of the origin of the tool frame.").atLeast(kSmallestSpeedLimit).orInfinite();
        v(regions, "regions",
          "By name: a box in which a lower speed counts, for all points of a capsule as soon as it reaches into it.");
    }

    bool needsCapsules() const { return arm < std::numeric_limits<double>::infinity() || !regions.empty(); }
    bool isAny() const { return needsCapsules() || tool < std::numeric_limits<double>::infinity(); }
};

/** Checks what was filled in code; throws Error (BadInput). @param where  for the message */
void checkSpeedLimits(const SpeedLimits& limits, const std::string& where);

}  // namespace viable
