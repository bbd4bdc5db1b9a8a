#pragma once

#include <atomic>
#include <chrono>
#include <string>
#include <vector>

namespace viable {

/** VIABLE_MESSAGES=json: what viable tells a program that called it (progress, the error that ends it) stands in lines of
JSON on its standard error output. */
bool areMessagesJson();

/** Whether what is written there may be in colour: to a terminal that is not `dumb`, without a NO_COLOR that says something. */
bool hasColor(int descriptor);

/** Shows how far several cases are: one bar per line on a terminal, redrawn in place, and gone when all are at 1, but for
the last draw; otherwise a plain line every few seconds, for programs one of JSON ten times a second. One drawing thread;
the shares are set from any thread. */
class Progress {
public:
    explicit Progress(std::vector<std::string> names);

    void set(std::size_t index, double share) { shares_[index].store(share, std::memory_order_relaxed); }
    /** Draws when it is time to; call it every 100 ms or so. */
    void draw(bool last = false);

private:
    std::vector<std::string> names_;
    std::vector<std::atomic<double>> shares_;
    void drawJson() const;

    bool json_, terminal_;
    bool color_;
    bool drawn_ = false;
    std::chrono::steady_clock::time_point begin_, lastDrawn_;
};

}  // namespace viable
