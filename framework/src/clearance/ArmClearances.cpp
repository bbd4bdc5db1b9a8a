#include "viable/environment/ArmClearances.h"

#include "clearance/ElementDistance.h"

namespace viable {

struct ArmClearances::Impl {
    Impl(const RobotDescription& robot, const ArmGeometry& geometry)
        : capsules(geometry.capsules),
          elements(detail::makeElements(geometry)),
          arm(robot),
          distance(capsules),
          motion(robot, capsules, distance.getRadii()),
          pose(motion.makePose()) {
        items.reserve(elements.size());
    }

    std::vector<LinkCapsule> capsules;
    std::vector<detail::ArmElement> elements;
    ArmRecursion arm;
    detail::ElementDistance distance;
    detail::CapsuleMotion motion;
    detail::CapsuleMotion::Pose pose;
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
        const detail::ElementDistance::Rough rough = in.distance.calcRough(element, in.pose);
        if (!(rough.clearance < within_m)) continue;
        detail::ElementDistance::Place place;
        int unlimited = std::numeric_limits<int>::max();
        in.distance.calc(element, in.pose, rough.ofMiddle, 0, place, unlimited);
        if (!(place.distance < within_m) || !std::isfinite(place.distance)) continue;
        in.items.push_back({element.first, element.second, place.distance, {}});
        detail::calcDistanceGradient(place, element, in.capsules, in.arm, in.pose.frames, in.items.back().gradient);
    }
    return in.items;
}

}  // namespace viable
