#pragma once

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>

namespace viable::test {

/** While it lives, no file gets larger than `room` bytes: a disk that fills up. */
class FullDisk {
public:
    explicit FullDisk(rlim_t room) {
        EXPECT_EQ(::getrlimit(RLIMIT_FSIZE, &before_), 0);
        rlimit small = before_;
        small.rlim_cur = room;
        EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
    }
    ~FullDisk() {
        EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &before_), 0);
        std::signal(SIGXFSZ, handler_);
    }
    FullDisk(const FullDisk&) = delete;
    FullDisk& operator=(const FullDisk&) = delete;

private:
    rlimit before_{};
    void (*const handler_)(int) = std::signal(SIGXFSZ, SIG_IGN);
};

}  // namespace viable::test
