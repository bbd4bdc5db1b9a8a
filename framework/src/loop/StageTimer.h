#pragma once

#include <chrono>

#include "viable/log/TickRecord.h"

namespace viable {

/** Splits a tick's time between its stages. */
class StageTimer {
public:
    explicit StageTimer(TickRecord& record) : record_(record), begin_(Clock::now()), last_(begin_) {
        record_.stage_us.fill(0.0);
    }
    /** What has passed since the last mark belongs to `stage`. */
    void mark(Stage stage) {
        const Clock::time_point now = Clock::now();
        record_.stage_us[static_cast<std::size_t>(stage)] +=
            std::chrono::duration<double, std::micro>(now - last_).count();
        last_ = now;
    }
    void finish() { record_.compute_us = std::chrono::duration<double, std::micro>(Clock::now() - begin_).count(); }

private:
    using Clock = std::chrono::steady_clock;

    TickRecord& record_;
    Clock::time_point begin_, last_;
};

}  // namespace viable
