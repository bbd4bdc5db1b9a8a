#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace viable {

/** The newest of the values that one thread writes, for one other thread: three places that change hands. Neither side waits
for the other, and what is read is always whole. Values that nobody fetched are lost.
Real time: write() copies, and no more. */
template <class T>
class LatestValue {
public:
    /** By the one writing thread. */
    void write(const T& value) {
        places_[back_] = value;
        back_ = middle_.exchange(back_ | kNew, std::memory_order_acq_rel) & kPlace;
    }

    /** By the one reading thread. The newest value, valid until the next call; the default value of T where none has been
    written. */
    const T& read() {
        if (middle_.load(std::memory_order_relaxed) & kNew)
            front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kPlace;
        return places_[front_];
    }

private:
    static constexpr std::uint8_t kPlace = 3, kNew = 4;
    std::array<T, 3> places_{};
    std::uint8_t back_ = 0, front_ = 1;
    std::atomic<std::uint8_t> middle_{2};
};

}  // namespace viable
