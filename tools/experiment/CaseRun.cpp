#include "experiment/CaseRun.h"

namespace viable {

/** Ticks between two looks at the clock for the progress display. */
constexpr std::int64_t kProgressTicks = 256;

static bool isMissed(const std::vector<TickGap>& gaps, std::int64_t tick) {
    return std::any_of(gaps.begin(), gaps.end(),
                       [&](const TickGap& gap) { return tick >= gap.begin && tick - gap.begin < gap.count; });
}

CaseResult runCase(std::unique_ptr<ConfiguredCase> configured, const RunOptions& options) {
    RunningCase running(std::move(configured), {options.log}, true);
    const CasePlan& plan = running.plan();
    ControlLoop& loop = running.loop();
    TickRecord& record = running.record();
    const std::int64_t ticks = std::llround(plan.duration_s / plan.tick_s);
    double recordTime_us = 0.0;
    // A stop that has begun is led to its end, even beyond the duration.
    for (std::int64_t k = 0; (k < ticks || loop.isStopping()) && !running.isStopOver(); ++k) {
        if (options.stopRequest && options.stopRequest->load(std::memory_order_relaxed) != 0)
            loop.requestStop(StopReason::Requested, "the user asked for it");
        if (isMissed(plan.missedTicks, k))
            loop.missTick(record);
        else
            loop.tick(record);
        record.stage_us[static_cast<int>(Stage::Record)] = recordTime_us;
        running.count();
        if (Recorder* const recorder = running.recorder()) {
            // Simulated time can wait for the disk. The time of the hand-over itself goes into the
            // next row.
            auto before = std::chrono::steady_clock::now();
            while (!recorder->append(record)) {
                std::this_thread::yield();
                before = std::chrono::steady_clock::now();
            }
            recordTime_us =
                std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - before).count();
        }
        if (options.progress && k % kProgressTicks == 0)
            options.progress(std::min(1.0, static_cast<double>(k) / static_cast<double>(ticks)));
    }
    if (options.progress) options.progress(1.0);
    return running.finish(options.isAlone);
}

}  // namespace viable
