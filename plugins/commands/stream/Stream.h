#pragma once

#include <functional>

#include "StreamMessage.h"
#include "TargetSocket.h"
#include "plugin/CommandReceiver.h"
#include "plugin/RehearsedCommand.h"

namespace viable {

/** Targets from another program of this computer and user, as they come: 10 to 200 times a second, late, or not at all.

Method: all datagrams that have arrived are looked at in each tick; the newest good one is the target, and the program is
answered what became of each. Between targets the command is what CommandReceiver makes of them. One program at a time: another
one is refused until this one has said goodbye, or has been silent for kSilent_s. A rehearsal opens the socket, so that another
listener is told of in time; programs learn of it at the start of the run.
Guarantees: finite commands, whatever arrives. Without fresh targets the command rests at the last one. Limits are kept by
the filter, not here.
Real time: no allocation, lock, wait or throw after reset(); a system call per tick, and two per message, kMostMessages at
most. */
class Stream : public RehearsedCommand {
public:
    static constexpr double kSilent_s = 0.5;
    static constexpr int kMostMessages = 16;  ///< per tick

    /** @param clock  CLOCK_MONOTONIC [ns]; empty: that one */
    explicit Stream(std::function<std::int64_t()> clock = {});
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void beginRehearsal() noexcept override { isRehearsal_ = true; }
    void reset(const MotionState& start) override;
    CommandTraits traits() const override { return {first_.space}; }
    TickStatus sample(double t, MotionCommand& out) override;

private:
    bool isTool() const { return first_.space == MotionCommand::Space::Tool; }
    TargetVerdict checkTarget(const TargetMessage& message, std::ptrdiff_t size, std::int64_t now_ns) const;
    void take(const TargetMessage& message);

    const std::function<std::int64_t()> clock_;
    std::string name_, description_;
    std::int64_t stale_ns_ = 0;
    int n_ = 0;
    bool isRehearsal_ = false;
    MotionCommand first_;
    CommandReceiver receiver_;
    std::shared_ptr<TargetSocket> socket_;
    MotionCommand target_;          // the newest
    std::uint64_t sender_ = 0;      // who sends; 0: nobody
    std::int64_t sent_ns_ = 0;      // its newest target
    std::int64_t received_ns_ = 0;  // when that came
};

}  // namespace viable
