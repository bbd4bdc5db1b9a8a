#include "core/WholeFile.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <stdio.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include <cerrno>
#include <csignal>
#include <functional>

#include "TemporaryFolder.h"

// The library's system calls come by here, which may refuse them.
namespace {
int linkCode = 0;  // 0: links are made
bool hasNoReplace = true;
int refusals = 0;
}  // namespace

extern "C" int linkat(int fromFolder, const char* from, int toFolder, const char* to, int flags) noexcept {
    if (linkCode == 0) return static_cast<int>(syscall(SYS_linkat, fromFolder, from, toFolder, to, flags));
    ++refusals;
    errno = linkCode;
    return -1;
}
extern "C" int link(const char* from, const char* to) noexcept {
    return linkat(AT_FDCWD, from, AT_FDCWD, to, 0);
}
extern "C" int renameat2(int fromFolder, const char* from, int toFolder, const char* to, unsigned flags) noexcept {
    if (hasNoReplace || flags == 0)
        return static_cast<int>(syscall(SYS_renameat2, fromFolder, from, toFolder, to, flags));
    errno = EINVAL;
    return -1;
}

namespace viable::test {
namespace {

namespace fs = std::filesystem;

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
    const TemporaryFolder folder;
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
    const TemporaryFolder folder;
    const mode_t before = umask(027);
    for (const bool isReplacing : {false, true}) {
        const fs::path target = folder / (isReplacing ? "replacing" : "new");
        for (const char* text : {"first", "second"}) {
            detail::WholeFile file(target, isReplacing);
            file.write(text);
            if (std::string(text) == "first") EXPECT_FALSE(fs::exists(target));
            file.finish();
            EXPECT_EQ(readWhole(target), text);
            if (!isReplacing) break;
        }
        EXPECT_EQ(fs::status(target).permissions(), fs::perms(0640));
    }
    umask(before);
    EXPECT_EQ(listNames(folder.path()), (std::vector<std::string>{"new", "replacing"}));
}

void expectTheirsIsNotOverwritten() {
    const TemporaryFolder folder;
    {
        detail::WholeFile file(folder / "name");
        file.write("mine");
        folder.write("name", "theirs");
        EXPECT_THROW(file.finish(), Error);
    }
    EXPECT_EQ(readWhole(folder / "name"), "theirs");
    EXPECT_EQ(listNames(folder.path()), std::vector<std::string>{"name"});
}

TEST(WholeFile, WhatAppearsMeanwhileIsNotOverwritten) {
    expectTheirsIsNotOverwritten();
}

/** The file system has no hard links, and if told so no RENAME_NOREPLACE. */
struct PoorFileSystem {
    PoorFileSystem(int code, bool knowsNoReplace) {
        linkCode = code;
        hasNoReplace = knowsNoReplace;
        refusals = 0;
    }
    ~PoorFileSystem() {
        linkCode = 0;
        hasNoReplace = true;
    }
};

TEST(WholeFile, WithoutHardLinksItIsWholeAllTheSame) {
    for (const int code : {EPERM, EOPNOTSUPP, ENOENT})
        for (const bool knowsNoReplace : {true, false})
            for (const bool isReplacing : {false, true}) {
                SCOPED_TRACE(testing::Message() << code << knowsNoReplace << isReplacing);
                const TemporaryFolder folder;
                const PoorFileSystem poor(code, knowsNoReplace);
                if (isReplacing) folder.write("name", "old");
                const std::string text(200000, 'x');
                detail::WholeFile file(folder / "name", isReplacing);
                file.write(text);
                EXPECT_EQ(readWhole(folder / "name"), isReplacing ? std::optional<std::string>("old") : std::nullopt);
                file.finish();
                EXPECT_GT(refusals, 0) << "nothing was tried";
                EXPECT_EQ(readWhole(folder / "name"), text);
                EXPECT_EQ(listNames(folder.path()), std::vector<std::string>{"name"});
            }
}

TEST(WholeFile, WithoutHardLinksNothingIsOverwrittenOrLeftHalf) {
    for (const bool knowsNoReplace : {true, false}) {
        const PoorFileSystem poor(EPERM, knowsNoReplace);
        expectTheirsIsNotOverwritten();
    }
    const TemporaryFolder folder;
    const PoorFileSystem poor(EPERM, true);
    const auto before = std::signal(SIGXFSZ, SIG_IGN);
    rlimit usual{};
    getrlimit(RLIMIT_FSIZE, &usual);
    {
        detail::WholeFile file(folder / "name");
        file.write(std::string(200000, 'x'));
        const rlimit tight{100000, usual.rlim_max};  // the disk is full while it is copied
        setrlimit(RLIMIT_FSIZE, &tight);
        EXPECT_THROW(file.finish(), Error);
        setrlimit(RLIMIT_FSIZE, &usual);
    }
    std::signal(SIGXFSZ, before);
    EXPECT_EQ(listNames(folder.path()), std::vector<std::string>{});
}

}  // namespace
}  // namespace viable::test
