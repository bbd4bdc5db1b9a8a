#include "core/ChildProcess.h"

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/Text.h"

namespace viable::detail {

pid_t forkChild(const char* purpose) {
    std::fflush(nullptr);  // what is in the buffers now is ours to write
    std::signal(SIGCHLD, SIG_DFL);
    const pid_t parent = getpid();
    const pid_t child = fork();
    if (child < 0) throw std::system_error(errno, std::generic_category(), std::string("no process ") + purpose);
    if (child == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() != parent) _exit(0);  // it has ended before that
    }
    return child;
}

std::string describeSignal(int signal) {
    const char* name = sigdescr_np(signal);
    return "signal " + std::to_string(signal) + " (" + (name ? name : "unknown") + ")";
}

std::string describeEnd(int status, const std::string& where) {
    if (WIFSIGNALED(status)) return "its process died" + where + ": " + describeSignal(WTERMSIG(status));
    return "its process ended" + where + ": it called exit(" + std::to_string(WEXITSTATUS(status)) + ")";
}

std::string endOverdue(pid_t process, double timeout_s, const std::string& where) {
    kill(process, SIGKILL);
    while (waitpid(process, nullptr, 0) < 0 && errno == EINTR) {
    }
    return "it did not return" + where + format(" for %g s; its process was ended", timeout_s);
}

}  // namespace viable::detail
