#include "live/LiveSession.h"

#include <pthread.h>
#include <signal.h>

#include "core/Text.h"
#include "plugin/RehearsedCommand.h"
#include "realtime/TickPacer.h"

namespace viable {

constexpr unsigned kAskerShift = 8;

/** Ticks that wait for the disk at most. */
constexpr std::size_t kCapacity = 8192;

/** Takes that the summary lists; the log knows those after it, too. */
constexpr std::int64_t kListedTakes = 1000;

static CaseLog widen(CaseLog log) {
    log.capacity = std::max(log.capacity, kCapacity);
    log.isLive = true;
    log.moreObstacles = PlacedObstacles::listNames();
    return log;
}

/** Does a filter take the surroundings that it is to keep clear of? */
static bool keepsClear(SurroundingsFeed* feed) {
    if (!feed) return false;
    if (!feed->claim()) return true;
    feed->release();
    return false;
}

const char* getName(LiveState state) {
    return detail::enumName<LiveState::Stopped>(state, {"armed", "running", "stopping", "stopped"}, "stopped");
}

const char* getName(LiveAsker asker) {
    return detail::enumName<LiveAsker::Fault>(asker, {"program", "key", "page", "signal", "duration", "fault"},
                                              "fault");
}

void LiveSession::rehearse(const CasePlan& plan, int ticks) {
    CasePlan nominal = plan;
    nominal.realPlant.reset();
    nominal.robustLoop.reset();
    nominal.disturbances.reset();
    nominal.holdsOnReal = nominal.feedsExternalTorque = false;
    std::unique_ptr<ConfiguredCase> configured = configureCase(nominal);
    if (auto* const command = dynamic_cast<RehearsedCommand*>(configured->plugins.command.get()))
        command->beginRehearsal();
    RunningCase running(std::move(configured), {}, false);
    for (int k = 0; k < ticks && !running.loop().isStopping(); ++k) {
        running.showPeople();
        running.loop().tick(running.record());
        running.count();
    }
    // A command that comes from somewhere may not have come yet.
    if (!running.loop().isStopping() || running.loop().stopReason() == StopReason::CommandFailed) return;
    const CaseResult result = running.finish(true);
    throw Error(ErrorKind::PluginFailed, "case " + plan.name,
                "before the real arm was moved, in a rehearsal on the nominal arm, it " + result.stopMessage,
                result.stopRemedy);
}

LiveSession::LiveSession(std::unique_ptr<ConfiguredCase> configured, const LiveOptions& options)
    : teleoperated_(dynamic_cast<TeleoperatedCommand*>(configured->plugins.command.get())),
      hand_(teleoperated_ ? teleoperated_->feed() : nullptr),
      running_(std::move(configured), widen(options.log), false),
      options_(options),
      tick_s_(running_.plan().tick_s),
      hasClock_(running_.loop().hasClock()) {
    timing_.hasClock = hasClock_;
    timing_.takes.reserve(kListedTakes);
    if (SurroundingsFeed* const feed = running_.configured().feed.get(); keepsClear(feed))
        placed_ = std::make_unique<PlacedObstacles>(running_.configured(), *feed, running_.recorder());
    publishTicks_ = std::max<std::int64_t>(1, std::llround(kStatus_s / tick_s_));
    if (options_.waitsArmed)
        running_.loop().pause();
    else
        state_ = LiveState::Running;
    changeTo(state_, LiveAsker::Program);
    publish();
}

LiveSession::~LiveSession() {
    stop(LiveAsker::Program);
    if (thread_.joinable()) thread_.join();
}

void LiveSession::begin() {
    sigset_t all, before;  // signals stay with the thread that waits for them
    sigfillset(&all);
    for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP}) sigdelset(&all, signal);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    try {
        thread_ = std::thread([this] { work(); });
    } catch (...) {
        pthread_sigmask(SIG_SETMASK, &before, nullptr);
        throw;
    }
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

const LiveTiming& LiveSession::timing() const {
    while (!hasEntered_.load(std::memory_order_acquire)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return timing_;
}

void LiveSession::request(Wish wish, LiveAsker asker) noexcept {
    const unsigned word = static_cast<unsigned>(wish) | static_cast<unsigned>(asker) << kAskerShift;
    unsigned before = wish_.load(std::memory_order_relaxed);
    do {
        const auto waiting = static_cast<Wish>(before & 0xff);
        if (waiting == Wish::Stop || (waiting == Wish::Pause && wish == Wish::Resume)) return;
    } while (!wish_.compare_exchange_weak(before, word, std::memory_order_acq_rel));
}

bool LiveSession::getEvent(std::size_t index, LiveEvent& event) const {
    if (index >= eventCount_.load(std::memory_order_acquire)) return false;
    event = events_[index];
    return true;
}

void LiveSession::changeTo(LiveState state, LiveAsker asker) {
    state_ = state;
    const std::size_t count = eventCount_.load(std::memory_order_relaxed);
    if (count >= (state < LiveState::Stopping ? kMaxEvents - 2 : kMaxEvents)) return;
    events_[count] = {state, asker, running_.loop().time()};
    eventCount_.store(count + 1, std::memory_order_release);
}

/** What was asked for since the last tick, and what the loop decided itself. */
void LiveSession::readWishes() {
    ControlLoop& loop = running_.loop();
    const unsigned word = wish_.load(std::memory_order_relaxed) == 0 ? 0 : wish_.exchange(0, std::memory_order_acq_rel);
    const auto asker = static_cast<LiveAsker>(word >> kAskerShift);
    if (loop.isStopping()) {
        if (state_ < LiveState::Stopping) changeTo(LiveState::Stopping, LiveAsker::Fault);
        return;
    }
    const auto stop = [&](LiveAsker by) {
        loop.requestStop(StopReason::Requested,
                         by == LiveAsker::Duration ? "its time was over" : "the user asked for it");
        changeTo(LiveState::Stopping, by);
    };
    const auto wish = static_cast<Wish>(word & 0xff);
    if (wish == Wish::Stop) return stop(asker);
    if (wish == Wish::Pause && state_ == LiveState::Running) {
        loop.pause();
        changeTo(LiveState::Armed, asker);
    } else if (wish == Wish::Resume && state_ == LiveState::Armed) {
        loop.resume();
        changeTo(LiveState::Running, asker);
    }
    if (loop.commandTime() >= options_.duration_s - 0.5 * tick_s_) stop(LiveAsker::Duration);
}

/** At the end the real arm has a while to come to rest, too. */
bool LiveSession::isOver() {
    if (!running_.isStopOver()) return false;
    return running_.loop().hasFailed() || ++holdTicks_ * tick_s_ > RunningCase::kSettling_s;
}

void LiveSession::makeTick(bool isMissed) {
    ControlLoop& loop = running_.loop();
    TickRecord& record = running_.record();
    if (isMissed)
        loop.missTick(record);
    else
        loop.tick(record);
    if (placed_)
        PlacedObstacles::renumber(*running_.configured().feed->view().surroundings, *running_.plan().environment,
                                  record.reports[LimitKind::Clearance]);
    if (teleoperated_) tellHand(record);
    markTake(record);
    const std::int64_t end_ns = TickPacer::readClock_ns();
    record.stage_us[static_cast<int>(Stage::Record)] = recordTime_us_;
    timing_.compute.add(std::llround(1e3 * record.compute_us), tick_);
    if (!record.missed) {
        const std::int64_t start_ns = end_ns - std::llround(1e3 * record.compute_us);
        if (lastStart_ns_ != 0) timing_.interval.add(start_ns - lastStart_ns_, tick_);
        record.interval_us = lastStart_ns_ == 0 ? 0.0 : 1e-3 * static_cast<double>(start_ns - lastStart_ns_);
        lastStart_ns_ = start_ns;
        gap_ = 0;
    } else {
        record.interval_us = 0.0;
        lastStart_ns_ = 0;
        ++timing_.missed;
        timing_.longestGap = std::max(timing_.longestGap, ++gap_);
    }
    running_.count();
    if (Recorder* const recorder = running_.recorder(); recorder && !recorder->append(record)) ++timing_.lostRows;
    recordTime_us_ = 1e-3 * static_cast<double>(TickPacer::readClock_ns() - end_ns);
    ++timing_.ticks;
    if (++tick_ % publishTicks_ == 0) publish();
}

void LiveSession::markTake(TickRecord& record) {
    const bool wants = wantsTake_.load(std::memory_order_relaxed);
    if (wants && !isTaking_) ++takes_;
    isTaking_ = wants;
    record.take = wants ? takes_ : 0;
    if (!wants || takes_ > kListedTakes) return;
    std::vector<LiveTiming::Take>& listed = timing_.takes;
    if (static_cast<std::int64_t>(listed.size()) < takes_) listed.push_back({record.time_s, record.time_s});
    listed.back().end_s = record.time_s;
}

/** An operator who lets go wants the arm at rest as soon as it can be. */
void LiveSession::tellHand(const TickRecord& record) {
    JointVector rest = record.nominal.q;
    for (Eigen::Index i = 0; i < rest.size(); ++i) rest[i] = record.stops[i].rest;
    teleoperated_->observe(record.nominal.q, rest);
}

void LiveSession::publish() {
    status_.state = state_;
    status_.time_s = running_.loop().time();
    status_.commandTime_s = running_.loop().commandTime();
    status_.missed = timing_.missed;
    status_.lostRows = timing_.lostRows;
    status_.worstCompute_us = 1e-3 * static_cast<double>(timing_.compute.worst_ns());
    status_.record = running_.record();
    latest_.write(status_);
}

void LiveSession::makeTicks() {
    TickPacer pacer(tick_s_);
    pacer.start();
    for (readWishes(); !isOver(); readWishes()) {
        if (hasClock_) {
            makeTick(false);
            continue;
        }
        const WakeUp wakeUp = pacer.wait();
        if (wakeUp.isInterrupted) continue;
        if (wakeUp.hasSlept) timing_.wakeUp.add(wakeUp.lateness_ns, tick_);
        for (std::int64_t k = 0; k < wakeUp.missed && !running_.loop().hasStopped(); ++k) {
            makeTick(true);
            readWishes();
        }
        makeTick(false);
    }
}

void LiveSession::work() {
    RealTimeState realTime;
    const auto keepFailure = [&](const auto& step) {
        try {
            step();
        } catch (...) {  // such as: there is no memory for a sentence
            failure_ = std::current_exception();
        }
    };
    keepFailure([&] {
        if (options_.prepareThread) options_.prepareThread();
        realTime = enterRealTime(options_.realTime);
        timing_.isRealTime = realTime.isRealTime();
        for (const RealTimeRefusal& refusal : realTime.refusals()) timing_.refusals.push_back(refusal.sentence());
    });
    hasEntered_.store(true, std::memory_order_release);
    if (!failure_) keepFailure([&] { makeTicks(); });
    running_.loop().releasePlant();  // now: a robot that hears nothing for long takes it for a fault
    const ControlLoop& loop = running_.loop();
    const bool hasBraked = state_ == LiveState::Stopping && loop.stopReason() == StopReason::Requested &&
                           loop.hasStopped() && !loop.hasFailed();
    changeTo(LiveState::Stopped, hasBraked ? LiveAsker::Program : LiveAsker::Fault);
    publish();
    hasEnded_.store(true, std::memory_order_release);
}

CaseResult LiveSession::finish() {
    if (thread_.joinable()) thread_.join();
    if (failure_) std::rethrow_exception(failure_);
    CaseResult result = running_.finish(true);
    LiveEvent event;
    for (std::size_t k = 0; getEvent(k, event); ++k)
        timing_.changes.push_back({getName(event.state), getName(event.asker), event.time_s});
    result.live = timing_;
    if (result.stopReason == StopReason::Requested) {  // it was to end like that
        result.stopReason = StopReason::None;
        result.stopMessage.clear();
    }
    return result;
}

}  // namespace viable
