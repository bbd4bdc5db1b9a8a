#include "RobotFolder.h"

namespace viable {
namespace {

namespace fs = std::filesystem;

struct FindRobotTest : ::testing::Test {
    fs::path make(const std::string& folder, const std::string& name) {
        const fs::path path = temporary_.path() / folder / name;
        fs::create_directories(path);
        std::ofstream(path / (name + ".urdf")) << "<robot/>";
        return path;
    }
    std::string findFault(const std::string& name) {
        return test::catchError([&] { findRobot(name, path_, "file.yaml:3:8: robot"); });
    }
    TemporaryFolder temporary_;
    fs::path first_ = temporary_.path() / "first";
    fs::path second_ = temporary_.path() / "second";
    std::vector<fs::path> path_{first_, second_, temporary_.path() / "absent"};
};

TEST_F(FindRobotTest, FirstFolderOfAName) {
    const fs::path hidden = make("second", "indy7");
    const fs::path indy = make("first", "indy7");
    const fs::path panda = make("second", "panda");
    const fs::path ur = make("first", "ur5e");
    fs::create_directories(first_ / "meshes");
    EXPECT_EQ(findRobot("indy7", path_, ""), indy);
    EXPECT_EQ(findRobot("panda", path_, ""), panda);
    EXPECT_EQ(findRobot(hidden.string(), path_, ""), hidden) << "a path is taken as it stands";
    EXPECT_EQ(listRobots(path_), (std::vector<fs::path>{indy, ur, panda}));
    EXPECT_TRUE(listRobots({}).empty());
}

TEST_F(FindRobotTest, AMissTellsWhatThereIs) {
    make("first", "indy7");
    make("second", "panda");
    const std::string fault = findFault("indi7");
    for (const std::string& part : {std::string("file.yaml:3:8: robot: there is no robot called `indi7`"),
                                    std::string("Did you mean `indy7`?"), std::string("There are `indy7`, `panda`"),
                                    first_.string(), second_.string(), std::string("absent (no such folder)")})
        EXPECT_CONTAINS(fault, part);
}

TEST_F(FindRobotTest, Fault11_NamesDoNotLeaveTheSearchPath) {
    make("first", "indy7");
    make("elsewhere", "secret");
    for (const std::string name : {"", ".", "..", "../elsewhere/secret", "indy7/../../elsewhere"})
        EXPECT_CONTAINS(findFault(name), "there is no robot") << name;
    EXPECT_CONTAINS(findFault((first_ / "indy7" / "indy7.urdf").string()), "is a file, not a robot folder");
}

}  // namespace
}  // namespace viable
