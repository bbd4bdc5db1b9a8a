#include "viable/robot/ArmGeometry.h"

#include "RobotFolder.h"

namespace viable {
namespace {

/** base, a joint, `upper` with a fixed `plate` on it, a joint, `fore`. */
struct ArmGeometryTest : ::testing::Test {
    ArmGeometryTest() {
        makeSimpleArm(folder_);
        RobotFolder::replace(
            folder_.urdf, "</robot>",
            makeJoint("mount", "fixed", "upper", "plate", "xyz='0.1 0 0' rpy='0 0 1.5707963267948966'", "0 0 1") +
                "<link name='plate'/></robot>");
        folder_.limits += "tool_link: fore\n";
        robot_ = folder_.load();
    }
    void put(const std::string& text) const { folder_.put("collision.yaml", text); }
    ArmGeometry load(const std::string& text) const {
        put(text);
        return loadArmGeometry(robot_);
    }
    void expectFault(const std::string& text, const std::vector<std::string>& parts) const {
        put(text);
        const std::string told = test::catchError([&] { loadArmGeometry(robot_); });
        test::expectContains(told, {"collision.yaml:"});
        test::expectContains(told, parts);
    }
    /** A file with `links` and `may_touch`. */
    static std::string with(const std::string& links, const std::string& mayTouch = "[]") {
        return "schema: 1\nlinks: " + links + "\nmay_touch: " + mayTouch + "\n";
    }

    const std::string all_ =
        "{base: [{from: [0, 0, 0], to: [0, 0, 0.2], radius: 0.1}], "
        "upper: [{from: [0, 0, 0], to: [0.4, 0, 0], radius: 0.05}, {from: [0, 0, 0], to: [0, 0, 0], radius: 0.06}], "
        "plate: [{from: [0.1, 0, 0], to: [0, 0.2, 0.3], radius: 0.02}], "
        "fore: [{from: [0, 0, 0], to: [0.3, 0, 0], radius: pi/100}]}";
    RobotFolder folder_;
    RobotDescription robot_;
};

TEST_F(ArmGeometryTest, CapsulesStandInTheFramesOfTheirCarriers) {
    const ArmGeometry arm = load(with(all_));
    EXPECT_EQ(arm.links, (std::vector<std::string>{"base", "upper", "plate", "fore"}));
    ASSERT_EQ(arm.capsules.size(), 5u);
    const int links[] = {0, 1, 1, 2, 3}, carriers[] = {-1, 0, 0, 0, 1};
    for (std::size_t i = 0; i < 5; ++i) {
        EXPECT_EQ(arm.capsules[i].link, links[i]);
        EXPECT_EQ(arm.capsules[i].carrier, carriers[i]);
    }
    // The plate is turned by a quarter about z and set off by 0.1.
    EXPECT_TRUE(arm.capsules[3].a.isApprox(Eigen::Vector3d(0.1, 0.1, 0.0), 1e-12));
    EXPECT_TRUE(arm.capsules[3].b.isApprox(Eigen::Vector3d(-0.1, 0.0, 0.3), 1e-12));
    EXPECT_EQ(arm.capsules[3].radius, 0.02);
    EXPECT_DOUBLE_EQ(arm.capsules[4].radius, EIGEN_PI / 100);
}

TEST_F(ArmGeometryTest, PairsAreThoseThatAJointMovesAndThatMayNotTouch) {
    using Pairs = std::vector<std::pair<int, int>>;
    // Neither of one link, nor upper with the plate that is fixed to it.
    EXPECT_EQ(load(with(all_)).pairs, (Pairs{{0, 1}, {0, 2}, {0, 3}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}));
    EXPECT_EQ(load(with(all_, "[[upper, base], [fore, plate]]")).pairs, (Pairs{{0, 3}, {0, 4}, {1, 4}, {2, 4}}));
    EXPECT_TRUE(load("schema: 1\nlinks: {fore: [{from: [0, 0, 0], to: [1, 0, 0], radius: 1}]}\n").pairs.empty());
}

TEST_F(ArmGeometryTest, AMissingFileIsToldWithHowToGetOne) {
    test::expectError(
        {"the robot has no collision.yaml", "viable new robot NAME --urdf ", "arm.urdf", "robots/README.md"},
        [&] { loadArmGeometry(robot_); });
}

TEST_F(ArmGeometryTest, WhatIsWrongIsRefusedByPlace) {
    const auto capsule = [](const std::string& body) { return with("{upper: [{" + body + "}]}"); };
    const std::string good = "from: [0, 0, 0], to: [1, 0, 0], radius: 1";
    expectFault("links: {upper: [{" + good + "}]}\n", {"schema"});
    expectFault("schema: 2\nlinks: {upper: [{" + good + "}]}\n", {"schema"});
    expectFault("schema: 1\n", {"links"});
    expectFault(with("[]"), {":2:8: links: ", "there is no link with a capsule"});
    expectFault(with("{}"), {"there is no link with a capsule"});
    expectFault(with("TODO"), {"links: not filled in yet"});
    expectFault(with("{upper: TODO}"), {"links.upper: not filled in yet"});
    expectFault(with("{uper: [{" + good + "}]}"),
                {"links.uper", "the robot has no link `uper`", "Did you mean `upper`?"});
    expectFault(with("{elsewhere: [{" + good + "}]}"), {"Name a link of the URDF."});
    expectFault(with("{upper: 3}"), {"the capsules of a link are a list"});
    expectFault(with("{upper: []}"), {"the capsules of a link are a list"});
    expectFault(capsule("from: [0, 0], to: [1, 0, 0], radius: 1"), {"links.upper[0].from"});
    expectFault(capsule("from: [0, 0, .nan], to: [1, 0, 0], radius: 1"), {"links.upper[0].from"});
    expectFault(capsule("from: [0, 0, 0], to: [1, 0, .inf], radius: 1"), {"links.upper[0].to"});
    expectFault(capsule("from: [0, 0, 0], to: [1, 0, 0], radius: 0"), {"links.upper[0].radius"});
    expectFault(capsule("from: [0, 0, 0], to: [1, 0, 0], radius: -1"), {"links.upper[0].radius"});
    expectFault(capsule("from: [1e200, 0, 0], to: [1, 0, 0], radius: 1"), {"links.upper[0].from"});
    expectFault(capsule("from: [0, 0, 0], to: [1, 0, 0], radius: 1e9"), {"links.upper[0].radius"});
    expectFault(capsule("from: [0, 0, 0], to: [1, 0, 0]"), {"radius"});
    expectFault(capsule(good + ", lenght: 2"), {"lenght"});
    expectFault(with(all_, "3"), {"the pairs of links are a list"});
    expectFault(with(all_, "[upper, fore]"), {"may_touch[0]", "this is not a pair of links"});
    expectFault(with(all_, "[[upper, fore, base]]"), {"this is not a pair of links"});
    expectFault(with(all_, "[[upper, four]]"), {"may_touch[0]", "Did you mean `fore`?"});
    expectFault(with(all_, "[[upper, upper]]"), {"pairs the link `upper` with itself"});
    expectFault(with(all_, "[[upper, fore], [fore, upper]]"), {"may_touch[1]", "paired twice"});
    std::string many;
    for (int i = 0; i < 257; ++i) many += (i ? ", {" : "{") + good + "}";
    expectFault(with("{upper: [" + many + "]}"), {"more than 256 capsules"});
}

}  // namespace
}  // namespace viable
