#include "host/ProcessGuard.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <locale>
#include <mutex>
#include <optional>

#include "core/ChildProcess.h"
#include "core/Descriptor.h"
#include "core/Text.h"

namespace viable {

namespace {

/** Those of sigaction that a program can see; the system adds some of its own. */
constexpr int kSignalFlags =
    SA_NOCLDSTOP | SA_NOCLDWAIT | SA_SIGINFO | SA_ONSTACK | SA_RESTART | SA_NODEFER | SA_RESETHAND;

std::optional<struct sigaction> readAction(int signal) {
    struct sigaction action {};
    if (sigaction(signal, nullptr, &action) != 0) return std::nullopt;  // the C library's own
    return action;
}

bool isSame(const struct sigaction& a, const struct sigaction& b) {
    return a.sa_handler == b.sa_handler && ((a.sa_flags ^ b.sa_flags) & kSignalFlags) == 0;
}

std::string readLocale() {
    const char* name = std::setlocale(LC_ALL, nullptr);
    return name ? name : "C";
}

/** What the program had when the first of the present guards began. */
class SharedState {
public:
    SharedState() : folder_(::open(".", O_PATH | O_DIRECTORY | O_CLOEXEC)), locale_(readLocale()) {
        for (int signal = 1; signal < NSIG; ++signal) actions_[signal] = readAction(signal);
    }

    void restore(std::string& text) const {
        const std::string locale = readLocale();  // that of C++ brings its own along
        if (std::locale() != cxxLocale_) {
            std::locale::global(cxxLocale_);
            detail::addItem(text, "the global locale of C++");
        }
        if (readLocale() != locale_) std::setlocale(LC_ALL, locale_.c_str());
        if (locale != locale_) detail::addItem(text, "the locale (" + locale + " instead of " + locale_ + ")");
        struct stat before {
        }, now{};
        if (folder_ >= 0 && ::fstat(folder_, &before) == 0 &&
            (::stat(".", &now) != 0 || before.st_dev != now.st_dev || before.st_ino != now.st_ino)) {
            std::error_code unknown;
            const std::string name = std::filesystem::current_path(unknown).string();
            const bool isBack = ::fchdir(folder_) == 0;
            detail::addItem(text, "the working folder (to " + name + (isBack ? ")" : ", and there is no way back)"));
        }
        for (int signal = 1; signal < NSIG; ++signal) {
            const auto& action = actions_[signal];
            const auto is = readAction(signal);
            if (!action || !is || isSame(*action, *is)) continue;
            sigaction(signal, &*action, nullptr);
            detail::addItem(text, "what is done at " + detail::describeSignal(signal));
        }
    }

private:
    detail::Descriptor folder_;
    std::string locale_;
    std::locale cxxLocale_;
    std::array<std::optional<struct sigaction>, NSIG> actions_;
};

std::mutex stateMutex;
int guards = 0;
std::optional<SharedState> state;  // while there are guards

}  // namespace

ProcessGuard::ProcessGuard() : threadLocale_(::uselocale(locale_t{})) {
    const std::lock_guard<std::mutex> lock(stateMutex);
    if (guards == 0) state.emplace();
    ++guards;
}

ProcessGuard::~ProcessGuard() {
    undo();
    const std::lock_guard<std::mutex> lock(stateMutex);
    if (--guards == 0) state.reset();
}

std::string ProcessGuard::undo() {
    std::string text;
    if (::uselocale(locale_t{}) != threadLocale_) {
        ::uselocale(threadLocale_);
        text = "the locale of the thread";
    }
    const std::lock_guard<std::mutex> lock(stateMutex);
    state->restore(text);
    return text;
}

}  // namespace viable
