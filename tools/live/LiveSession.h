#pragma once

#include "core/LatestValue.h"
#include "experiment/RunningCase.h"
#include "live/PlacedObstacles.h"
#include "plugin/Teleoperation.h"
#include "realtime/RealTimeSetup.h"

namespace viable {

/** What a live arm does. */
enum class LiveState : unsigned char {
    Armed,     ///< the real arm is held where it is; the command's time stands still
    Running,   ///< it follows the command
    Stopping,  ///< it brakes for good
    Stopped,   ///< nobody drives it any more: the robot holds itself
};
/** "armed", "running", ... */
const char* getName(LiveState state);

/** Who asked for a change. */
enum class LiveAsker : unsigned char { Program, Key, Page, Signal, Duration, Fault };
const char* getName(LiveAsker asker);

/** A change of state. */
struct LiveEvent {
    LiveState state = LiveState::Armed;
    LiveAsker asker = LiveAsker::Program;
    double time_s = 0.0;  ///< of the first tick in that state
};

struct LiveOptions {
    CaseLog log;
    RealTimeWish realTime;
    bool waitsArmed = false;                                      ///< for resume(), before the command begins
    std::function<void()> prepareThread;                          ///< run by the new thread first; may be empty
    double duration_s = std::numeric_limits<double>::infinity();  ///< of the command's time; then it brakes
};

/** How a live arm is just now. */
struct LiveStatus {
    LiveState state = LiveState::Armed;
    double time_s = 0.0, commandTime_s = 0.0;
    std::int64_t missed = 0, lostRows = 0;
    double worstCompute_us = 0.0;
    TickRecord record;  ///< of the last tick
};

/** A case in real time: a thread of its own makes the ticks, by the clock of the plant or, where it has none, by that of the
computer. A tick that did not come in time is a missed one: the nominal arm follows the stop held ready.

Order: the case is rehearsed on the nominal arm (rehearse), the constructor opens the plant and the log, begin() starts
the thread, which asks the system for real time last of all; what it refuses is in timing().refusals, and the arm runs all
the same.
A plant without a clock is taken for a simulated one: what was missed is made up for at once.
Guarantees: those of ControlLoop. The log may lose rows where the disk is slow (counted), the loop never waits for it. At the
end, unless the plant fails or a robot goes on though it is told to brake, the nominal arm is at rest, and held for RunningCase::kSettling_s more, before the plant is let go.
Threads: pause(), resume(), stop(), record() by any; status() and events by one; the rest by the one that made it. */
class LiveSession {
public:
    /** Throws Error, see RunningCase. */
    LiveSession(std::unique_ptr<ConfiguredCase> configured, const LiveOptions& options);
    /** Stops, and waits for the end. */
    ~LiveSession();

    /** The same case, configured anew and without a real arm, for so many ticks; its code is then in memory. Throws Error, also
    where the arm had to be stopped in one of them. */
    static void rehearse(const CasePlan& plan, int ticks = 200);

    void begin();

    // Take effect in the next tick. A stop is final; a resume() before a pause() has taken effect counts for nothing.
    void pause(LiveAsker asker) noexcept { request(Wish::Pause, asker); }
    void resume(LiveAsker asker) noexcept { request(Wish::Resume, asker); }
    void stop(LiveAsker asker) noexcept { request(Wish::Stop, asker); }

    /** Whether the operator wants to keep what happens: the ticks from the next one on belong to a take with a number of its
    own (TickRecord::take), until he does not any more. The log has all ticks either way. */
    void record(bool wants) noexcept { wantsTake_.store(wants, std::memory_order_relaxed); }

    /** What was had of real time. After begin(); waits until that is known. */
    const LiveTiming& timing() const;
    /** Of a command that an operator's hand moves; null: another command. */
    std::shared_ptr<TeleoperationFeed> hand() const { return hand_; }
    /** Of its log, also without one. */
    const LogLayout& layout() const { return running_.layout(); }
    /** What a hand puts around the arm; null: nothing keeps the arm clear of obstacles. */
    PlacedObstacles* placed() { return placed_.get(); }
    /** Not older than kStatus_s, unless a plant's clock stands still. */
    const LiveStatus& status() { return latest_.read(); }
    /** All ticks have been made. */
    bool hasEnded() const { return hasEnded_.load(std::memory_order_acquire); }
    /** Of the changes so far the `index`th, from 0; false: there is none yet. Of more than kMaxEvents the last two are kept
    (the end), and those before that the places last for. */
    bool getEvent(std::size_t index, LiveEvent& event) const;

    /** Waits for the end and tells what came of it; once. Rethrows what the thread threw, which ended it. */
    CaseResult finish();

    static constexpr double kStatus_s = 0.016;  ///< a picture of a screen
    static constexpr std::size_t kMaxEvents = 1024;

private:
    enum class Wish : unsigned char { None, Pause, Resume, Stop };

    void request(Wish wish, LiveAsker asker) noexcept;
    void work();
    void makeTicks();
    void readWishes();
    void changeTo(LiveState state, LiveAsker asker);
    bool isOver();
    void makeTick(bool isMissed);
    void tellHand(const TickRecord& record);
    void markTake(TickRecord& record);
    void publish();

    TeleoperatedCommand* const teleoperated_;  // of the running case; null: another command
    const std::shared_ptr<TeleoperationFeed> hand_;
    RunningCase running_;
    std::unique_ptr<PlacedObstacles> placed_;
    const LiveOptions options_;
    const double tick_s_;
    const bool hasClock_;
    LiveTiming timing_;

    std::atomic<unsigned> wish_{0};  // Wish, and the asker above it; a stop is never replaced, a pause not by resume()
    std::atomic<bool> wantsTake_{false};
    LatestValue<LiveStatus> latest_;
    std::array<LiveEvent, kMaxEvents> events_{};
    std::atomic<std::size_t> eventCount_{0};
    std::atomic<bool> hasEntered_{false}, hasEnded_{false};
    std::exception_ptr failure_;  // of the thread
    std::thread thread_;

    // Of the thread.
    LiveState state_ = LiveState::Armed;
    LiveStatus status_;
    std::int64_t takes_ = 0;  // so far
    bool isTaking_ = false;
    std::int64_t tick_ = 0, lastStart_ns_ = 0, gap_ = 0, holdTicks_ = 0, publishTicks_ = 1;
    double recordTime_us_ = 0.0;
};

}  // namespace viable
