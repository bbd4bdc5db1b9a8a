#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "BrokenPlugin.h"
#include "WitnessPage.h"

namespace {

struct WitnessOptions {
    std::filesystem::path file;
    bool isPaced = true;

    template <class V>
    void describe(V& v) {
        v(file, "file", "Of a WitnessPage's size.").required();
        v(isPaced, "paced", "In real time.");
    }
};

/** Set-points to and fro; says elsewhere than in the log how many ticks have begun, and when. */
class Witness : public broken::Command {
public:
    ~Witness() override {
        if (page_) munmap(page_, sizeof(viable::test::WitnessPage));
    }
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        tick_ = std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * setup.tick_s));
        const auto options = parameters.get<WitnessOptions>();
        paced_ = options.isPaced;
        const int file = open(options.file.c_str(), O_RDWR | O_CLOEXEC);
        void* memory = mmap(nullptr, sizeof(viable::test::WitnessPage), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        close(file);
        if (memory == MAP_FAILED) throw std::runtime_error("the witness has no page");
        page_ = static_cast<viable::test::WitnessPage*>(memory);
    }
    viable::TickStatus sample(double t, viable::MotionCommand& out) override {
        using Clock = std::chrono::steady_clock;
        if (paced_) {
            std::this_thread::sleep_until(next_);
            // A little is caught up, not a long halt.
            next_ = std::max(next_, Clock::now() - 20 * tick_) + tick_;
        }
        page_->begun_ns[ticks_ % page_->kKept] = std::chrono::nanoseconds(Clock::now().time_since_epoch()).count();
        page_->ticks.store(static_cast<std::int64_t>(++ticks_), std::memory_order_release);
        return setPoint(static_cast<std::int64_t>(t) % 2 == 0 ? 0.3 : -0.3, out);
    }

private:
    std::chrono::nanoseconds tick_{0};
    std::chrono::steady_clock::time_point next_{};
    bool paced_ = true;
    viable::test::WitnessPage* page_ = nullptr;
    std::size_t ticks_ = 0;
};

}  // namespace

VIABLE_PLUGIN(viable::CommandSource, Witness, "witness", "Counts the ticks in a file of its own.", WitnessOptions)
