#include "core/WholeFile.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "TemporaryFolder.h"

namespace viable {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> listNames(const fs::path& folder) {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    return names;
}

/** Runs `work` in a process that is then killed with kill -9. */
void killAfter(const std::function<void()>& work) {
    const pid_t child = fork();
    if (child == 0) {
        work();
        raise(SIGKILL);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
}

TEST(WholeFile, Fault73_AKilledWriterLeavesNothingBehind) {
    const test::TemporaryFolder folder;
    const int probe = ::open(folder.path().c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
    if (probe < 0) GTEST_SKIP() << "the file system of " << folder.path() << " has no files without names";
    ::close(probe);
    folder.write("old", "old");
    for (const char* name : {"new", "old"})
        killAfter([&] {
            detail::WholeFile file(folder / name, true);
            file.write("half");
        });
    EXPECT_EQ(listNames(folder.path()), std::vector<std::string>{"old"});
    EXPECT_EQ(readWhole(folder / "old"), "old");
}

TEST(WholeFile, TakesItsNameAtTheEndWithTheRightsOfNewFiles) {
    const test::TemporaryFolder folder;
    const mode_t before = umask(027);
    for (const bool isReplacing : {false, true}) {
        const fs::path target = folder / (isReplacing ? "replacing" : "new");
        for (const char* text : {"first", "second"}) {
            detail::WholeFile file(target, isReplacing);
            file.write(text);
            if (std::string(text) == "first") {
                EXPECT_FALSE(fs::exists(target));
            }
            file.finish();
            EXPECT_EQ(readWhole(target), text);
            if (!isReplacing) break;
        }
        EXPECT_EQ(fs::status(target).permissions(), fs::perms(0640));
    }
    umask(before);
    EXPECT_EQ(listNames(folder.path()), (std::vector<std::string>{"new", "replacing"}));
}

TEST(WholeFile, WhatAppearsMeanwhileIsNotOverwritten) {
    const test::TemporaryFolder folder;
    {
        detail::WholeFile file(folder / "name");
        file.write("mine");
        folder.write("name", "theirs");
        EXPECT_THROW(file.finish(), Error);
    }
    EXPECT_EQ(readWhole(folder / "name"), "theirs");
    EXPECT_EQ(listNames(folder.path()), std::vector<std::string>{"name"});
}

}  // namespace
}  // namespace viable
