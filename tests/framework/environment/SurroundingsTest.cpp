#include "viable/environment/Surroundings.h"

#include <cmath>
#include <thread>

#include "EnvironmentSupport.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

const Eigen::Vector3d kCorner(1.0, 1.0, 1.0);

Environment makeSolids() {
    const auto make = [](const char* name, Solid::Kind kind, const Eigen::Vector3d& shift) {
        Solid solid;
        solid.name = name;
        solid.kind = kind;
        solid.pose = makeOddPose();
        solid.pose.translation() += shift;
        return solid;
    };
    Environment environment;
    environment.solids = {
        make("table", Solid::Kind::Box, {0.4, 0, 0}), make("ball", Solid::Kind::Sphere, {-0.6, 0.3, 0}),
        make("post", Solid::Kind::Cylinder, {0, -0.5, 0.2}), make("floor", Solid::Kind::HalfSpace, {0, 0, -0.9})};
    environment.solids[0].size << 0.5, 0.3, 0.1;
    environment.solids[1].radius = 0.15;
    environment.solids[2].radius = 0.1;
    environment.solids[2].length = 0.4;
    return environment;
}

/** The nearest point of a solid by its own definition in its own frame, for a point outside. */
Eigen::Vector3d findNearestPoint(const Solid& solid, const Eigen::Vector3d& p) {
    Eigen::Vector3d local = solid.pose.inverse() * p;
    if (solid.kind == Solid::Kind::Box) local = local.cwiseMin(0.5 * solid.size).cwiseMax(-0.5 * solid.size);
    if (solid.kind == Solid::Kind::Sphere) local *= std::min(1.0, solid.radius / local.norm());
    if (solid.kind == Solid::Kind::Cylinder) {
        local.head<2>() *= std::min(1.0, solid.radius / local.head<2>().norm());
        local.z() = std::min(std::max(local.z(), -0.5 * solid.length), 0.5 * solid.length);
    }
    if (solid.kind == Solid::Kind::HalfSpace) local.z() = std::min(local.z(), 0.0);
    return solid.pose * local;
}

std::vector<Eigen::Vector3d> drawPlaces(int count, double reach, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place(-reach, reach);
    std::vector<Eigen::Vector3d> places;
    for (int i = 0; i < count; ++i) places.emplace_back(place(random), place(random), place(random));
    return places;
}

TEST(Surroundings, DistancesOfSolidsAreExactOutside) {
    const Environment environment = makeSolids();
    const Surroundings surroundings(environment, -kCorner, kCorner, 0.5);
    ASSERT_EQ(surroundings.size(), 4);
    EXPECT_EQ(surroundings.name(2), "post");
    std::array<int, 4> nearest{};
    int inside = 0;
    for (const Eigen::Vector3d& p : drawPlaces(20000, 1.2, 1)) {
        double least = kInfinity;
        int which = -1;
        for (int i = 0; i < 4; ++i) {
            const double distance = (p - findNearestPoint(environment.solids[static_cast<std::size_t>(i)], p)).norm();
            if (distance < least) {
                least = distance;
                which = i;
            }
        }
        const Surroundings::Nearest found = surroundings.findNearest(p, 0.0);
        ASSERT_EQ(found.distance, surroundings.calcDistance(p, 0.0));
        if (least < 1e-12) {
            EXPECT_LE(found.distance, 1e-12);
            ++inside;
            continue;
        }
        ASSERT_NEAR(found.distance, least, 1e-12);
        ASSERT_EQ(found.obstacle, which);
        ++nearest[static_cast<std::size_t>(which)];
        const Eigen::Vector3d point = findNearestPoint(environment.solids[static_cast<std::size_t>(which)], p);
        if (least > 1e-4) ASSERT_LE((found.gradient - (p - point) / least).norm(), 1e-8);
    }
    for (const int count : nearest) EXPECT_GT(count, 500);
    EXPECT_GT(inside, 100);
}

TEST(Surroundings, InsideTheDistanceIsTheWayToTheNearestFace) {
    const Environment environment = makeSolids();
    for (std::size_t i = 0; i < 4; ++i) {
        Environment one;
        one.solids = {environment.solids[i]};
        const Surroundings surroundings(one, -kCorner, kCorner, 0.5);
        int inside = 0;
        for (const Eigen::Vector3d& p : drawPlaces(40000, 1.2, 2)) {
            const Surroundings::Nearest found = surroundings.findNearest(p, 0.0);
            if (found.distance > -1e-6) continue;
            ++inside;
            ASSERT_NEAR(found.gradient.norm(), 1.0, 1e-12);
            // Along the gradient by the depth: the surface. A little less: still inside.
            ASSERT_NEAR(surroundings.calcDistance(p - found.distance * found.gradient, 0.0), 0.0, 1e-12);
            ASSERT_LT(surroundings.calcDistance(p - 0.99 * found.distance * found.gradient, 0.0), 0.0);
        }
        EXPECT_GT(inside, 20) << i;
    }
}

TEST(Surroundings, InTheMiddleThereIsAWayOut) {
    for (const Solid& solid : makeSolids().solids) {
        Environment one;
        one.solids = {solid};
        const Surroundings surroundings(one, -kCorner, kCorner, 0.5);
        const Surroundings::Nearest found = surroundings.findNearest(solid.pose.translation(), 0.0);
        EXPECT_LE(found.distance, 1e-15);
        EXPECT_NEAR(found.gradient.norm(), 1.0, 1e-12) << solid.name;
    }
}

MovingSphere makeVisitor(bool repeats) {
    MovingSphere sphere;
    sphere.name = "visitor";
    sphere.radius = 0.08;
    sphere.repeats = repeats;
    sphere.waypoints = {
        {0.5, {0.5, 0, 0}}, {1.0, {0, 0.5, 0.2}}, {1.7, {0, 0.5, 0.2}}, {2.5, {-0.4, -0.1, 0.3}}, {4.0, {0.5, 0, 0}}};
    if (!repeats) sphere.waypoints.pop_back();
    return sphere;
}

TEST(Surroundings, Fault60_MovingSpheresCountWithAllThatIsLeftOfTheirPath) {
    for (const bool repeats : {false, true}) {
        Environment environment;
        environment.spheres = {makeVisitor(repeats)};
        const Surroundings surroundings(environment, -kCorner, kCorner, 0.5);
        for (const double t : {-1.0, 0.0, 0.5, 0.7, 1.0, 1.3, 1.7, 2.2, 2.5, 9.0, 1e9}) {
            const double horizon = repeats ? 8.0 : 4.0;
            constexpr int kSteps = 4000;
            std::vector<Eigen::Vector3d> centres;
            for (int k = 0; k <= kSteps; ++k)
                centres.push_back(environment.spheres[0].calcCentre(t + horizon * k / kSteps));
            for (const Eigen::Vector3d& p : drawPlaces(60, 0.8, 3)) {
                double least = kInfinity;
                for (const Eigen::Vector3d& c : centres) least = std::min(least, (p - c).norm());
                const Surroundings::Nearest found = surroundings.findNearest(p, t);
                EXPECT_LE(found.distance, least - 0.08 + 1e-12) << t;
                EXPECT_GE(found.distance, least - 0.08 - 2e-3) << t;  // between the samples
                EXPECT_EQ(found.obstacle, 0);
                const Eigen::Vector3d step = 1e-6 * found.gradient;
                EXPECT_NEAR((surroundings.calcDistance(p + step, t) - surroundings.calcDistance(p - step, t)) / 2e-6,
                            1.0, 1e-3);
            }
        }
        for (const Eigen::Vector3d& p : drawPlaces(20, 0.8, 4))  // no time: all of the path
            EXPECT_EQ(surroundings.calcDistance(p, std::nan("")), surroundings.calcDistance(p, 0.0));
    }
}

TEST(Surroundings, AMapIsReadOnceAndAnewWhenAnythingIsOther) {
    TemporaryFolder folder;
    const auto write = [&](double side) {
        octomap::OcTree tree(0.05);
        tree.updateNode(side * 0.325, side * 0.025, side * 0.025, true);
        tree.updateNode(side * 0.325, side * 0.025, side * 0.325, true);
        store(folder / "map.bt", writeBinary(tree));
    };
    write(1.0);
    Environment environment;
    environment.map = chooseMap(folder / "map.bt");
    environment.map->unknown = UnknownSpace::Free;
    const auto make = [&] { return std::make_unique<Surroundings>(environment, -kCorner, kCorner, 0.5); };
    const auto first = make();
    const OccupancyMap* const map = first->map();
    environment.solids = makeSolids().solids;
    EXPECT_EQ(make()->map(), map) << "solids do not change the map";
    environment.map->pose.translation().x() = 0.1;
    EXPECT_NE(make()->map(), map);
    environment.map->pose.translation().x() = 0.0;
    std::filesystem::copy_file(folder / "map.bt", folder / "elsewhere.bt");
    environment.map->file = folder / "elsewhere.bt";
    EXPECT_EQ(make()->map(), map) << "one content is one map wherever it lies";
    std::filesystem::copy_file(folder / "map.bt", folder / "map.ot");
    environment.map->file = folder / "map.ot";
    EXPECT_THROW(make(), Error) << "a name of another kind";
    environment.map->file = folder / "map.bt";
    environment.map->sha256 = std::string(64, 'a');
    EXPECT_THROW(make(), Error) << "what is stated is compared";
    EXPECT_THROW(make(), Error);
    environment.map->sha256 = map->sha256();
    EXPECT_NEAR(make()->calcDistance({0.325, 0.025, 0.2}, 0.0), 0.1, 0.02);
    environment.map->sha256.clear();
    environment.solids.clear();
    const auto written = std::filesystem::last_write_time(folder / "map.bt");
    const auto size = std::filesystem::file_size(folder / "map.bt");
    write(-1.0);  // now it is another file, told by its content alone
    ASSERT_EQ(std::filesystem::file_size(folder / "map.bt"), size);
    std::filesystem::last_write_time(folder / "map.bt", written);
    EXPECT_GT(make()->calcDistance({0.325, 0.025, 0.2}, 0.0), 0.3);
}

TEST(Surroundings, MapAndSolidsTogether) {
    TemporaryFolder folder;
    octomap::OcTree tree(0.05);
    tree.updateNode(0.325, 0.025, 0.025, true);
    store(folder / "map.bt", writeBinary(tree));
    Environment environment = makeSolids();
    environment.map = chooseMap(folder / "map.bt");
    environment.map->unknown = UnknownSpace::Free;
    environment.spheres = {makeVisitor(false)};
    const Surroundings surroundings(environment, -kCorner, kCorner, 0.5);
    ASSERT_EQ(surroundings.size(), 6);
    EXPECT_EQ(surroundings.name(4), "visitor");
    EXPECT_EQ(surroundings.name(5), "map");
    ASSERT_NE(surroundings.map(), nullptr);
    const Surroundings::Nearest found = surroundings.findNearest({0.325, 0.025, 0.12}, 9.0);
    EXPECT_EQ(found.obstacle, 5);
    EXPECT_LE(found.distance, 0.07);
    EXPECT_GE(found.distance, 0.03);
    EXPECT_GT(found.gradient.z(), 0.9);
    const Surroundings::Nearest beyond = surroundings.findNearest({1.001, 0, 0}, 0.0);
    EXPECT_EQ(beyond.distance, -kInfinity);
    EXPECT_EQ(beyond.obstacle, 5);
    environment.map->unknown = UnknownSpace::Occupied;
    const Surroundings blind(environment, -kCorner, kCorner, 0.5);
    EXPECT_LE(blind.calcDistance({0.1, 0.1, 0.6}, 0.0), 0.0);
}

TEST(Surroundings, Fault59_NoNumberIsNeverFree) {
    const Surroundings surroundings(makeSolids(), -kCorner, kCorner, 0.5);
    const Surroundings nothing(Environment{}, -kCorner, kCorner, 0.5);
    const double infinity = kInfinity;
    for (const double bad : {std::nan(""), infinity, -infinity})
        for (int k = 0; k < 3; ++k) {
            Eigen::Vector3d p = Eigen::Vector3d::Zero();
            p[k] = bad;
            for (const Surroundings* one : {&surroundings, &nothing}) {
                EXPECT_EQ(one->calcDistance(p, 0.0), -infinity);
                EXPECT_EQ(one->findNearest(p, 0.0).obstacle, -1);
            }
        }
    EXPECT_EQ(nothing.calcDistance({0, 0, 0}, 0.0), infinity);
}

TEST(Surroundings, AQueryAllocatesNothing) {
    using testing::AllocationCounter;
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    Environment environment = makeSolids();
    environment.spheres = {makeVisitor(false), makeVisitor(true)};
    const Surroundings surroundings(environment, -kCorner, kCorner, 0.5);
    const auto places = drawPlaces(1000, 1.0, 5);
    double sum = 0.0;
    AllocationCounter counter;
    for (const Eigen::Vector3d& p : places)
        sum += surroundings.calcDistance(p, 1.2) + surroundings.findNearest(p, 0.3).distance;
    EXPECT_EQ(counter.count(), 0);
    EXPECT_TRUE(std::isfinite(sum));
}

/** Surroundings whose every part says their version. */
std::shared_ptr<const Surroundings> makeVersion(std::int64_t version) {
    Environment environment;
    environment.safetyDistance_m = static_cast<double>(version);
    environment.solids.resize(1);
    environment.solids[0].name = std::to_string(version);
    environment.solids[0].kind = Solid::Kind::Sphere;
    environment.solids[0].radius = static_cast<double>(version) + 1.0;
    return std::make_shared<const Surroundings>(environment, -kCorner, kCorner, 0.5);
}

TEST(SurroundingsFeed, TheNewestIsTakenAndStays) {
    SurroundingsFeed feed(makeVersion(0), 0.25);
    EXPECT_EQ(feed.take().version, 0);
    EXPECT_EQ(feed.take().stamp_s, 0.25);
    for (std::int64_t k = 1; k <= 5; ++k) feed.put(makeVersion(k), 0.1 * static_cast<double>(k));
    EXPECT_EQ(feed.view().version, 0);  // not taken yet
    const SurroundingsFeed::View view = feed.take();
    EXPECT_EQ(view.version, 5);
    EXPECT_EQ(view.stamp_s, 0.5);
    EXPECT_EQ(feed.view().surroundings, view.surroundings);
    EXPECT_EQ(view.surroundings->name(0), "5");
    EXPECT_EQ(feed.take().version, 5);
    EXPECT_EQ(feed.take().surroundings, view.surroundings);
}

TEST(SurroundingsFeed, OldOnesGoInPutAndNeverWhileTheyAreUsed) {
    std::array<std::weak_ptr<const Surroundings>, 5> seen;
    const auto make = [&](std::size_t k) {
        const auto made = makeVersion(static_cast<std::int64_t>(k));
        seen[k] = made;
        return made;
    };
    SurroundingsFeed feed(make(0));
    feed.take();
    feed.put(make(1), 0.0);
    EXPECT_FALSE(seen[0].expired());  // in use
    feed.put(make(2), 0.0);
    EXPECT_TRUE(seen[1].expired());  // never taken
    EXPECT_FALSE(seen[0].expired());
    EXPECT_EQ(feed.take().version, 2);
    EXPECT_FALSE(seen[0].expired());  // not in take()
    feed.put(make(3), 0.0);
    EXPECT_TRUE(seen[0].expired());
    EXPECT_FALSE(seen[2].expired());
    EXPECT_EQ(feed.take().version, 3);
}

TEST(SurroundingsFeed, TakeAllocatesAndFreesNothing) {
    using testing::AllocationCounter;
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    SurroundingsFeed feed(makeVersion(0));
    feed.put(makeVersion(1), 0.0);
    AllocationCounter counter;
    const SurroundingsFeed::View view = feed.take();
    EXPECT_EQ(counter.count(), 0);
    EXPECT_EQ(view.version, 1);
}

TEST(SurroundingsFeed, Fault61_AMillionTakesSeeRisingVersionsAndWholeObjects) {
    SurroundingsFeed feed(makeVersion(0), 0.0);
    std::atomic<bool> isOver{false};
    std::atomic<std::int64_t> lastPut{0};
    std::thread maker([&] {
        for (std::int64_t k = 1; !isOver.load(); ++k) {
            feed.put(makeVersion(k), static_cast<double>(k));
            lastPut.store(k);
        }
    });
    std::int64_t last = 0, changes = 0, wrong = 0;
    for (int i = 0; i < 1'000'000 || changes < 3; ++i) {
        const std::int64_t least = lastPut.load();
        const SurroundingsFeed::View view = feed.take();
        wrong += view.version < last || view.version < least;
        wrong += view.stamp_s != static_cast<double>(view.version);
        wrong += view.surroundings->environment().safetyDistance_m != view.stamp_s;
        wrong += view.surroundings->calcDistance({0, 0, 0}, 0.0) != -(view.stamp_s + 1.0);  // its radius
        changes += view.version != last;
        last = view.version;
    }
    isOver.store(true);
    maker.join();
    EXPECT_EQ(wrong, 0);
    EXPECT_GT(changes, 2);
    EXPECT_EQ(feed.take().version, lastPut.load());
}

}  // namespace
}  // namespace viable::test
