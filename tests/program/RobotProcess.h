#pragma once

#include <signal.h>
#include <sys/mman.h>
#include <time.h>

#include <atomic>

#include "Program.h"

namespace viable::test {

/** One arm twice: simulated, and behind the plant `link`. */
inline const char* const kLinkedExperiment = "experiments/planar_two_link_linked.yaml";

inline void sleepFor(double seconds) {
    const timespec pause{static_cast<time_t>(seconds),
                         static_cast<long>(1e9 * (seconds - static_cast<time_t>(seconds)))};
    nanosleep(&pause, nullptr);
}

/** A second process, and where it listens. Its clock runs slowly where the machine is busy with other tests. */
class Robot {
public:
    explicit Robot(bool usesUdp, std::vector<std::string> more = {"--clock", "0.5"}) {
        static std::atomic<int> count{0};
        std::vector<std::string> arguments{"robot", kLinkedExperiment, "--case", "simulated"};
        if (usesUdp) {
            arguments.insert(arguments.end(), {"--listen", "127.0.0.1:0"});
        } else {
            name_ = "viable-program-" + std::to_string(getpid()) + "-" + std::to_string(++count);
            arguments.insert(arguments.end(), {"--shm", name_});
        }
        arguments.insert(arguments.end(), more.begin(), more.end());
        program_ = std::make_unique<Program>(arguments);
        const std::string line = await(" at ");
        const std::size_t at = line.rfind(" at ");
        address_ = line.substr(at + 4, line.find('\n', at) - at - 4);
    }
    ~Robot() {
        if (!hasEnded_) {
            kill(program_->pid(), SIGKILL);
            program_->wait();
        }
        if (!name_.empty()) shm_unlink(("/" + name_).c_str());  // a killed one leaves it
    }
    Robot(const Robot&) = delete;
    Robot& operator=(const Robot&) = delete;

    const std::string& address() const { return address_; }
    /** Waits until it has said so; what it has said then. */
    std::string await(const std::string& words) const {
        for (int k = 0; k < 2000; ++k) {
            std::string text = program_->output();
            const std::size_t at = text.find(words);
            if (at != std::string::npos && text.find('\n', at) != std::string::npos) return text;
            sleepFor(0.01);
        }
        ADD_FAILURE() << "'" << words << "' was not said in 20 s:\n" << program_->output();
        return {};
    }
    Outcome end(int signal) {
        kill(program_->pid(), signal);
        hasEnded_ = true;
        return program_->wait();
    }

private:
    std::unique_ptr<Program> program_;
    std::string name_, address_;  // name_: of shared memory
    bool hasEnded_ = false;
};

}  // namespace viable::test
