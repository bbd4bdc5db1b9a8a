#include "clearance/ElementDistance.h"

#include <cmath>

#include "robot/Segments.h"

namespace viable::detail {

namespace {

/** Distance of neighbouring balls over their capsule's radius: the balls are then 3 % larger than the capsule. Long thin
capsules have kMaxGaps and fatter balls. */
constexpr double kBallSpacing = 0.5;
constexpr int kMaxGaps = 15;

}  // namespace

ElementDistance::ElementDistance(std::vector<LinkCapsule> capsules)
    : capsules_(std::move(capsules)), covers_(makeCovers(capsules_)) {}

std::vector<ElementDistance::Cover> ElementDistance::makeCovers(const std::vector<LinkCapsule>& capsules) {
    std::vector<Cover> covers;
    for (const LinkCapsule& capsule : capsules) {
        Cover cover;
        const double length = (capsule.b - capsule.a).norm();
        const double wanted = std::ceil(length / (kBallSpacing * capsule.radius));
        cover.gaps = static_cast<int>(std::min<double>(wanted, kMaxGaps));
        cover.spacing = cover.gaps > 0 ? length / cover.gaps : 0.0;
        cover.radius = std::hypot(capsule.radius, cover.spacing / 2.0);
        cover.reach = length / 2.0 + cover.radius;
        covers.push_back(cover);
    }
    return covers;
}

std::vector<double> ElementDistance::getRadii() const {
    std::vector<double> radii;
    for (const Cover& cover : covers_) radii.push_back(cover.radius);
    return radii;
}

/** Of a point from the surroundings, less what is left out. */
double ElementDistance::calcToOthers(const Eigen::Vector3d& p) const {
    return leftOut_.count == 0 ? surroundings_->calcDistance(p, time_s_)
                               : surroundings_->findNearest(p, time_s_, leftOut_).distance;
}

ElementDistance::Rough ElementDistance::calcRough(const ArmElement& element, const CapsuleMotion::Pose& pose) const {
    const Cover& first = covers_[element.first];
    const CapsuleMotion::Segment& segment = pose.segments[element.first];
    const Eigen::Vector3d middle = (segment.a + segment.b) / 2.0;
    if (!element.isPair()) {
        const double ofMiddle = calcToOthers(middle);
        return {ofMiddle - first.reach, ofMiddle};
    }
    const Cover& second = covers_[element.second];
    const CapsuleMotion::Segment& other = pose.segments[element.second];
    return {(middle - (other.a + other.b) / 2.0).norm() - first.reach - second.reach, kInfinity};
}

double ElementDistance::calc(const ArmElement& element, const CapsuleMotion::Pose& pose, double ofMiddle, int sample,
                             Place& nearest, int& distances) const {
    if (!element.isPair())
        return calcToSurroundings(element.first, pose.segments[element.first], ofMiddle, sample, nearest, distances);
    --distances;
    return calcBetween(element, pose, sample, nearest);
}

double ElementDistance::calcToSurroundings(int capsule, const CapsuleMotion::Segment& segment, double ofMiddle,
                                           int sample, Place& nearest, int& distances) const {
    const Cover& cover = covers_[capsule];
    const int last = cover.gaps;
    const Eigen::Vector3d along = last > 0 ? Eigen::Vector3d((segment.b - segment.a) / last) : Eigen::Vector3d::Zero();
    double least = kInfinity;
    Eigen::Vector3d where = Eigen::Vector3d::Zero();
    const auto ask = [&](int k) {
        const Eigen::Vector3d p = segment.a + k * along;
        const double distance = calcToOthers(p);
        --distances;
        if (!(distance >= least)) {
            least = distance;
            where = p;
        }
        return distance;
    };
    // From the nearer end to the other: no point is nearer than another's distance less the way between them.
    const double ofFirst = ask(0), ofLast = last > 0 ? ask(last) : ofFirst;
    const int step = ofFirst <= ofLast ? 1 : -1;
    double known = std::min(ofFirst, ofLast);
    for (int k = step > 0 ? 1 : last - 1, at = k - step; k > 0 && k < last; k += step) {
        const double bound =
            std::max({known - std::abs(k - at) * cover.spacing, ofMiddle - std::abs(k - 0.5 * last) * cover.spacing,
                      std::max(ofFirst, ofLast) - (step > 0 ? last - k : k) * cover.spacing});
        if (bound >= least) continue;
        known = ask(k);
        at = k;
    }
    const double clearance = least - cover.radius;
    if (!(clearance < nearest.distance)) return clearance;
    nearest = makePlace(where, cover.radius, surroundings_->findNearest(where, time_s_, leftOut_), sample);
    return clearance;
}

ElementDistance::Place ElementDistance::makePlace(const Eigen::Vector3d& centre, double radius,
                                                  const Surroundings::Nearest& found, int sample) {
    Place place{found.distance - radius,          sample, found.obstacle, found.gradient,
                centre - radius * found.gradient, centre};
    if (std::isfinite(found.distance)) place.onSecond -= found.distance * found.gradient;
    return place;
}

double ElementDistance::calcBetween(const ArmElement& element, const CapsuleMotion::Pose& pose, int sample,
                                    Place& nearest) const {
    const auto first = static_cast<std::size_t>(element.first), second = static_cast<std::size_t>(element.second);
    Eigen::Vector3d onA, onB;
    findNearestPoints(pose.segments[first].a, pose.segments[first].b, pose.segments[second].a, pose.segments[second].b,
                      onA, onB);
    const double clearance = (onA - onB).norm() - getRadius(element);
    if (clearance < nearest.distance) nearest = makePlace(element, onA, onB, sample);
    return clearance;
}

ElementDistance::Place ElementDistance::makePlace(const ArmElement& pair, const Eigen::Vector3d& onA,
                                                  const Eigen::Vector3d& onB, int sample) const {
    const double a = capsules_[pair.first].radius;
    const double b = capsules_[pair.second].radius;
    const Eigen::Vector3d apart = onA - onB;
    const double distance = apart.norm();
    const Eigen::Vector3d direction = distance > 0.0 ? Eigen::Vector3d(apart / distance) : Eigen::Vector3d::Zero();
    return {distance - a - b, sample, -1, direction, onA - a * direction, onB + b * direction};
}

int ElementDistance::calcEnds(const ArmElement& element, const CapsuleMotion::Pose& pose, const Place& nearest,
                              std::array<Place, 4>& ends) const {
    int count = 0;
    const auto add = [&](const Place& end) {
        const bool isThere = end.onFirst.isApprox(nearest.onFirst) && end.onSecond.isApprox(nearest.onSecond);
        if (!isThere) ends[count++] = end;
    };
    const auto first = static_cast<std::size_t>(element.first);
    const CapsuleMotion::Segment& segment = pose.segments[first];
    if (!element.isPair()) {
        for (const Eigen::Vector3d* end : {&segment.a, &segment.b})
            add(makePlace(*end, covers_[first].radius, surroundings_->findNearest(*end, time_s_, nearest.obstacle),
                          nearest.sample));
        return count;
    }
    const CapsuleMotion::Segment& other = pose.segments[element.second];
    Eigen::Vector3d onA, onB;
    for (const Eigen::Vector3d* end : {&segment.a, &segment.b}) {
        findNearestPoints(*end, *end, other.a, other.b, onA, onB);
        add(makePlace(element, onA, onB, nearest.sample));
    }
    for (const Eigen::Vector3d* end : {&other.a, &other.b}) {
        findNearestPoints(segment.a, segment.b, *end, *end, onA, onB);
        add(makePlace(element, onA, onB, nearest.sample));
    }
    return count;
}

void calcDistanceGradient(const ElementDistance::Place& place, const ArmElement& element,
                          const std::vector<LinkCapsule>& capsules, const ArmRecursion& arm,
                          const ArmRecursion::Frames& frames, JointVector& row) {
    const auto getCarrier = [&](int capsule) { return capsule < 0 ? -1 : capsules[capsule].carrier; };
    const int first = getCarrier(element.first), second = getCarrier(element.second);
    row.resize(arm.size());
    for (int i = 0; i < arm.size(); ++i) {
        const auto calcMotion = [&](int carrier, const Eigen::Vector3d& p) -> double {
            if (carrier < 0 || !arm.moves(i, carrier)) return 0.0;
            const Eigen::Vector3d& axis = frames.axis[i];
            return place.gradient.dot(arm.isPrismatic(i) ? axis : axis.cross(p - frames.origin[i]));
        };
        row[i] = calcMotion(first, place.onFirst) - calcMotion(second, place.onSecond);
    }
}

}  // namespace viable::detail
