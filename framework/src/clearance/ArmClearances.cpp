#include "environment/ArmClearances.h"

#include <cmath>
#include <tuple>

#include "clearance/ElementDistance.h"

namespace viable {

namespace {

/** Of one capsule: from as many obstacles as a query leaves out and one more, nearest and at both ends; of a pair: nearest and at
four ends. */
constexpr std::size_t kMostPlaces = 3 * (std::tuple_size_v<decltype(Surroundings::LeftOut::obstacles)> + 1);
constexpr std::size_t kMostPairPlaces = 5;

}  // namespace

struct ArmClearances::Impl {
    Impl(const RobotDescription& robot, const ArmGeometry& geometry)
        : capsules(geometry.capsules),
          elements(detail::makeElements(geometry)),
          arm(robot),
          distance(capsules),
          motion(robot, capsules, distance.getRadii()),
          pose(motion.makePose()) {
        items.reserve(kMostPlaces * capsules.size() + kMostPairPlaces * geometry.pairs.size());
    }

    /** False where it is no nearer than `within_m`. */
    bool add(const detail::ArmElement& element, const detail::ElementDistance::Place& place, double within_m,
             bool isNearest) {
        if (!(place.distance < within_m) || !std::isfinite(place.distance) || items.size() == items.capacity())
            return false;
        items.push_back({element.first, element.second, place.obstacle, isNearest, place.distance, {}});
        detail::calcDistanceGradient(place, element, capsules, arm, pose.frames, items.back().gradient);
        return true;
    }

    std::vector<LinkCapsule> capsules;
    std::vector<detail::ArmElement> elements;
    ArmRecursion arm;
    detail::ElementDistance distance;
    detail::CapsuleMotion motion;
    detail::CapsuleMotion::Pose pose;
    std::array<detail::ElementDistance::Place, 4> ends;
    std::vector<Item> items;
};

ArmClearances::ArmClearances(const RobotDescription& robot, const ArmGeometry& geometry)
    : impl_(std::make_unique<Impl>(robot, geometry)) {}
ArmClearances::~ArmClearances() = default;
ArmClearances::ArmClearances(ArmClearances&&) noexcept = default;
ArmClearances& ArmClearances::operator=(ArmClearances&&) noexcept = default;

const std::vector<ArmClearances::Item>& ArmClearances::find(const JointVector& q, const Surroundings* surroundings,
                                                            double time_s, double within_m) {
    Impl& in = *impl_;
    in.items.clear();
    if (!q.allFinite()) return in.items;
    in.motion.calcPose(q, in.pose);
    in.distance.setSurroundings(surroundings);
    in.distance.setTime(time_s);
    for (const detail::ArmElement& element : in.elements) {
        if (!element.isPair() && !surroundings) continue;
        in.distance.leftOut().count = 0;
        for (;;) {
            const detail::ElementDistance::Rough rough = in.distance.calcRough(element, in.pose);
            if (!(rough.clearance < within_m)) break;
            detail::ElementDistance::Place place;
            int unlimited = std::numeric_limits<int>::max();
            in.distance.calc(element, in.pose, rough.ofMiddle, 0, place, unlimited);
            if (!in.add(element, place, within_m, true)) break;
            const int count = in.distance.calcEnds(element, in.pose, place, in.ends);
            for (int k = 0; k < count; ++k) in.add(element, in.ends[k], within_m, false);
            if (element.isPair() || !in.distance.leftOut().add(place.obstacle)) break;
        }
    }
    return in.items;
}

}  // namespace viable
