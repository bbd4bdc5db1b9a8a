#include "draft/Xacro.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "core/ChildProcess.h"
#include "core/Text.h"
#include "robot/urdf/UrdfDocument.h"
#include "viable/core/Error.h"

namespace viable::detail {

namespace {

constexpr double kTimeLimit_s = 10.0;
constexpr rlim_t kMostMemory_B = 1u << 30;
constexpr int kNotInstalled = 127;

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

/** The child's side: becomes xacro. */
[[noreturn]] void become(const std::string& path, std::FILE* out, std::FILE* err) {
    const std::pair<int, rlim_t> limits[] = {
        {RLIMIT_AS, kMostMemory_B}, {RLIMIT_CPU, static_cast<rlim_t>(kTimeLimit_s)}, {RLIMIT_FSIZE, kMaxUrdfBytes + 1}};
    setpgid(0, 0);  // its own group, with all that it starts
    for (const auto& [what, most] : limits) {
        const rlimit limit{most, most};
        setrlimit(what, &limit);
    }
    dup2(open("/dev/null", O_RDONLY), STDIN_FILENO);
    dup2(fileno(out), STDOUT_FILENO);
    dup2(fileno(err), STDERR_FILENO);
    execlp("xacro", "xacro", path.c_str(), static_cast<char*>(nullptr));
    _exit(kNotInstalled);
}

std::string readAll(std::FILE* file) {
    std::string text(kMaxUrdfBytes + 1, '\0');
    std::rewind(file);
    text.resize(std::fread(text.data(), 1, text.size(), file));
    return text;
}

}  // namespace

std::string expandXacro(const std::filesystem::path& file, const std::string& where) {
    const std::string path = std::filesystem::absolute(file).string();  // no option begins so
    const auto refuse = [&](const std::string& what) {
        return badInput(where, "this is xacro input, and " + what,
                        "Run `xacro " + quoteForShell(file.string()) + " > NAME.urdf` and use its output.");
    };
    const File out(std::tmpfile(), std::fclose), err(std::tmpfile(), std::fclose);
    if (!out || !err) throw std::system_error(errno, std::generic_category(), "no file for the output of xacro");
    const pid_t child = forkChild("for xacro");
    if (child == 0) become(path, out.get(), err.get());
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kTimeLimit_s);
    int status = 0;
    while (waitpid(child, &status, WNOHANG) == 0) {
        if (std::chrono::steady_clock::now() > end) {
            kill(-child, SIGKILL);
            throw refuse(endOverdue(child, kTimeLimit_s));
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    const std::string text = readAll(out.get());
    if (text.size() > kMaxUrdfBytes) throw refuse("xacro gave more than " + std::to_string(kMaxUrdfBytes) + " bytes");
    if (WIFEXITED(status) && WEXITSTATUS(status) == kNotInstalled)
        throw refuse("the program xacro, which expands it, was not found");
    if (status == 0) return text;
    const std::string said = readAll(err.get()).substr(0, 300);  // as far as it fits a line
    throw refuse("xacro failed: " + makePrintable(said.substr(0, said.find_last_not_of(" \n") + 1)));
}

}  // namespace viable::detail
