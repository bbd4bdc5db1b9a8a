#include "summary/CollisionCounter.h"

#include <algorithm>

#include "summary/ArmMotion.h"

namespace viable::detail {

CollisionCounter::CollisionCounter(const RobotDescription& robot, const ArmGeometry& geometry,
                                   const Environment& environment, bool hasRealArm)
    : geometry_(geometry), obstacles_(environment.obstacleNames()), judge_(robot, geometry, environment) {
    collisions_.safetyDistance_m = environment.safetyDistance_m;
    if (hasRealArm) collisions_.real.emplace();
}

void CollisionCounter::judge(Way& way, CollisionRecord& record, const JointVector& q, double time_s) {
    // What is farther than the nearest so far and than the safety distance changes no figure.
    static_assert(kClearanceHorizon_m <= CollisionJudge::kMostHorizon_m);
    const double horizon = std::min(std::max(collisions_.safetyDistance_m, record.leastClearance), kClearanceHorizon_m);
    const CollisionJudge::Contact contact = judge_.findContact(q, time_s, horizon);
    if (contact.distance >= horizon) return;
    way.touches |= contact.distance < -kClearanceRounding_m;
    way.isNear |= contact.distance < collisions_.safetyDistance_m - kClearanceRounding_m;
    if (way.touches && !record.firstCollision_s) record.firstCollision_s = time_s;
    if (!(contact.distance < record.leastClearance)) return;
    const auto linkName = [&](int link) {
        return link < 0 ? std::string() : geometry_.links[static_cast<std::size_t>(link)];
    };
    record.leastClearance = contact.distance;
    record.leastClearance_s = time_s;
    record.link = linkName(contact.link);
    record.otherLink = contact.obstacle < 0 ? linkName(contact.otherLink) : "";
    record.obstacle = contact.obstacle < 0 ? "" : obstacles_[static_cast<std::size_t>(contact.obstacle)];
}

void CollisionCounter::follow(Way& way, CollisionRecord& record, const JointState& state, double time_s) {
    if (way.hasBegun) {
        const double seconds = time_s - way.time_s;
        judge(way, record, calcHalfWay(way.last, state, seconds).q, way.time_s + seconds / 2.0);
    }
    judge(way, record, state.q, time_s);
    if (way.hasBegun) {
        record.ticksInCollision += way.touches;
        record.ticksTooNear += way.isNear;
        way.touches = way.isNear = false;
    }
    way.last = state;
    way.time_s = time_s;
    way.hasBegun = true;
}

void CollisionCounter::add(const TickRecord& record) {
    follow(nominal_, collisions_.nominal, {record.nominal.q, record.nominal.qd}, record.time_s);
    if (collisions_.real && record.hasReading) follow(real_, *collisions_.real, record.actual, record.time_s);
}

void CollisionCounter::addEnd(const MotionState& nominal, double time_s) {
    follow(nominal_, collisions_.nominal, {nominal.q, nominal.qd}, time_s);
    if (!collisions_.real) return;
    // Of the real arm's last tick only its beginning is known.
    collisions_.real->ticksInCollision += real_.touches;
    collisions_.real->ticksTooNear += real_.isNear;
    real_.touches = real_.isNear = false;
}

}  // namespace viable::detail
