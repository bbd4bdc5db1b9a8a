// Plugins in Python inside a process that has an interpreter of its own already, as a Python module that runs cases would: that
// one is used, and its lock is taken and given back.
#include <pybind11/embed.h>

#include "CaseSupport.h"

namespace viable {
namespace {

namespace py = pybind11;

constexpr char kLaw[] = R"(
import os
class Law:
    def compute(self, command, nominal, dynamics):
        assert os.getpid() == PID and "mark_of_the_host" in __import__("sys").modules
        return dynamics.b
)";

struct InProcess : ::testing::Test {
    InProcess() {
        py::module_::import("sys").attr("modules")["mark_of_the_host"] = py::none();
        std::string law = kLaw;
        law.replace(law.find("PID"), 3, std::to_string(::getpid()));
        folder_.write("law.py", law);
        std::string yaml = test::kOneJoint;
        yaml.replace(yaml.find("joint_pd"), 8, "law.py:Law");
        file_ = folder_.write("test.yaml", yaml);
    }

    /** Reads, configures and runs the case; "" where all went well. */
    std::string run() const {
        const Experiment experiment =
            readExperiment(file_, {"duration_s=0.2"}, test::makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
        return runCase(configureCase(experiment.cases.front()), {}).stopMessage;
    }

    test::TemporaryFolder folder_;
    std::string file_;
};

// The first: nothing has been started in this process yet, and those who come together, with and without the lock, do not wait for each other.
TEST_F(InProcess, WhoComesFirstAtOnceDoesNotLockTheOthersOut) {
    std::vector<std::string> found(3, "not run");
    {
        const py::gil_scoped_release release;
        std::vector<std::thread> threads;
        for (std::size_t i = 0; i < found.size(); ++i)
            threads.emplace_back([&, i] {
                if (i > 0) {
                    found[i] = run();
                    return;
                }
                const py::gil_scoped_acquire lock;  // a caller that keeps the lock
                found[i] = run();
            });
        for (std::thread& thread : threads) thread.join();
    }
    for (const std::string& message : found) EXPECT_EQ(message, "");
}

TEST_F(InProcess, ItRunsWithTheLockAndWithoutIt) {
    EXPECT_EQ(run(), "");
    const py::gil_scoped_release release;
    EXPECT_EQ(run(), "");
}

TEST_F(InProcess, ABusyThreadOfTheHostSlowsItAndNoMore) {
    py::exec(
        "import threading, time\n"
        "stop, rounds = False, 0\n"
        "def work():\n"
        "    global rounds\n"
        "    while not stop:\n"
        "        rounds += sum(range(1000)) > 0\n"
        "thread = threading.Thread(target=work)\n"
        "thread.start()\n"
        "while rounds == 0: time.sleep(0.001)\n"
        "before = rounds\n");
    const auto count = [] { return py::eval("rounds - before").cast<int>(); };
    for (int k = 0; k < 100 && count() == 0; ++k) {  // on a busy machine a short run may pass without the other thread
        const py::gil_scoped_release release;
        EXPECT_EQ(run(), "");
    }
    EXPECT_GT(count(), 0);
    py::exec("stop = True\nthread.join()");
}

}  // namespace
}  // namespace viable

int main(int argc, char** argv) {
    ::testing::InitGoogleTest(&argc, argv);
    const pybind11::scoped_interpreter python;
    return RUN_ALL_TESTS();
}
