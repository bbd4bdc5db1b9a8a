#include "plugin/Teleoperation.h"

#include <chrono>

#include "core/LatestValue.h"
#include "core/Text.h"

namespace viable {

static double readSteadyClock() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

const char* getName(HandState state) {
    return detail::enumName<HandState::Refused>(state, {"released", "engaged", "held", "refused"}, "refused");
}

const char* getName(HandRefusal refusal) {
    return detail::enumName<HandRefusal::Paused>(
        refusal, {"none", "not_finite", "not_tracked", "jump", "silent", "paused"}, "none");
}

struct TeleoperationFeed::Impl {
    LatestValue<Arrival> arrivals;
    LatestValue<Status> statuses;
    Arrival next;  // of the thread that puts
};

TeleoperationFeed::TeleoperationFeed(std::function<double()> clock)
    : clock_(clock ? std::move(clock) : readSteadyClock), impl_(std::make_unique<Impl>()) {}
TeleoperationFeed::~TeleoperationFeed() = default;

void TeleoperationFeed::put(const HandMessage& message) {
    impl_->next = {impl_->next.number + 1, now(), message};
    impl_->arrivals.write(impl_->next);
}

const TeleoperationFeed::Arrival& TeleoperationFeed::take() {
    return impl_->arrivals.read();
}

void TeleoperationFeed::tell(const Status& status) {
    impl_->statuses.write(status);
}

const TeleoperationFeed::Status& TeleoperationFeed::status() {
    return impl_->statuses.read();
}

TeleoperatedCommand::~TeleoperatedCommand() = default;

}  // namespace viable
