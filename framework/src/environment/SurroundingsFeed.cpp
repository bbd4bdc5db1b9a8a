#include "viable/environment/Surroundings.h"

namespace viable {

SurroundingsFeed::SurroundingsFeed(std::shared_ptr<const Surroundings> first, double stamp_s) {
    VIABLE_CHECK(first, "a feed begins with surroundings");
    slots_[used_] = {std::move(first), stamp_s, 0};
}

void SurroundingsFeed::put(std::shared_ptr<const Surroundings> next, double stamp_s) {
    VIABLE_CHECK(next, "surroundings are put whole");
    slots_[written_] = {std::move(next), stamp_s, ++version_};
    written_ = ready_.exchange(written_ | kNew, std::memory_order_acq_rel) & ~kNew;
    slots_[written_].surroundings.reset();  // never taken, or given back by the user
}

SurroundingsFeed::View SurroundingsFeed::take() {
    if (ready_.load(std::memory_order_relaxed) & kNew)
        used_ = ready_.exchange(used_, std::memory_order_acq_rel) & ~kNew;
    return view();
}

SurroundingsFeed::View SurroundingsFeed::view() const {
    const Slot& slot = slots_[used_];
    return {slot.surroundings.get(), slot.stamp_s, slot.version};
}

}  // namespace viable
