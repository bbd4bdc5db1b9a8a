#include "plugin/Teleoperation.h"

#include <chrono>

#include "core/LatestValue.h"

namespace viable {

namespace {

double readSteadyClock() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

const char* getName(HandState state) {
    switch (state) {
        case HandState::Released:
            return "released";
        case HandState::Engaged:
            return "engaged";
        case HandState::Held:
            return "held";
        case HandState::Refused:
            break;
    }
    return "refused";
}

const char* getName(HandRefusal refusal) {
    switch (refusal) {
        case HandRefusal::NotFinite:
            return "not_finite";
        case HandRefusal::NotTracked:
            return "not_tracked";
        case HandRefusal::Jump:
            return "jump";
        case HandRefusal::Silent:
            return "silent";
        case HandRefusal::Paused:
            return "paused";
        case HandRefusal::None:
            break;
    }
    return "none";
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
