#include "draft/Xacro.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>

#include "core/ChildProcess.h"
#include "core/Text.h"
#include "robot/urdf/UrdfDocument.h"
#include "viable/core/Error.h"

namespace viable::detail {

namespace {

constexpr double kTimeLimit_s = 10.0;
constexpr rlim_t kMostMemory_B = 1u << 30;
constexpr int kNotInstalled = 127;

/** The child's side: becomes xacro. */
[[noreturn]] void become(const std::string& file, int out, int err) {
    const rlimit memory{kMostMemory_B, kMostMemory_B},
        time{static_cast<rlim_t>(kTimeLimit_s), static_cast<rlim_t>(kTimeLimit_s)};
    setrlimit(RLIMIT_AS, &memory);
    setrlimit(RLIMIT_CPU, &time);
    dup2(open("/dev/null", O_RDONLY), STDIN_FILENO);
    dup2(out, STDOUT_FILENO);
    dup2(err, STDERR_FILENO);
    execlp("xacro", "xacro", file.c_str(), static_cast<char*>(nullptr));
    _exit(kNotInstalled);
}

/** Of its messages, as far as it fits a line. */
std::string shorten(const std::string& text) {
    const std::size_t end = text.find_last_not_of(" \n");
    return makePrintable(text.substr(0, std::min<std::size_t>(end == std::string::npos ? 0 : end + 1, 300)));
}

}  // namespace

std::string expandXacro(const std::filesystem::path& file, const std::string& where) {
    const std::string path = std::filesystem::absolute(file).string();  // no option begins so
    const std::string command = "`xacro " + quoteForShell(file.string()) + " > NAME.urdf`";
    const auto refuse = [&](const std::string& what) {
        return badInput(where, "this is xacro input, and " + what, "Run " + command + " and use its output.");
    };
    int pipes[2][2];  // of its output and its messages
    if (pipe2(pipes[0], O_CLOEXEC) != 0 || pipe2(pipes[1], O_CLOEXEC) != 0)
        throw std::system_error(errno, std::generic_category(), "no pipe for xacro");
    const pid_t child = forkChild("for xacro");
    if (child == 0) become(path, pipes[0][1], pipes[1][1]);
    std::string text[2];
    pollfd open[2];
    for (int k = 0; k < 2; ++k) {
        close(pipes[k][1]);
        open[k] = {pipes[k][0], POLLIN, 0};
    }
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kTimeLimit_s);
    bool isLate = false, isLong = false;
    while ((open[0].fd >= 0 || open[1].fd >= 0) && !isLate && !isLong) {
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
        isLate = left.count() <= 0 || poll(open, 2, static_cast<int>(left.count())) == 0;
        for (int k = 0; k < 2 && !isLate; ++k) {
            if (open[k].fd < 0 || open[k].revents == 0) continue;
            char buffer[65536];
            const ssize_t count = read(open[k].fd, buffer, sizeof buffer);
            if (count <= 0) open[k].fd = -1;
            if (count > 0) text[k].append(buffer, static_cast<std::size_t>(count));
            isLong = isLong || text[k].size() > kMaxUrdfBytes;
        }
    }
    for (const auto& pipe : pipes) close(pipe[0]);
    if (isLate || isLong) kill(child, SIGKILL);
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (isLate) throw refuse(format("xacro did not end within %g s", kTimeLimit_s));
    if (isLong) throw refuse("xacro gave more than " + std::to_string(kMaxUrdfBytes) + " bytes");
    if (WIFEXITED(status) && WEXITSTATUS(status) == kNotInstalled)
        throw refuse("the program xacro, which expands it, was not found");
    if (status != 0) throw refuse("xacro failed: " + shorten(text[1]));
    return text[0];
}

}  // namespace viable::detail
