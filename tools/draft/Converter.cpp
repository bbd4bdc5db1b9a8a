#include "draft/Converter.h"

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

constexpr int kNotInstalled = 127;
/** How mjcf_to_urdf.py ends where it says on two lines what is wrong, and what to do. */
constexpr int kRefused = 93;

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;
using Command = std::vector<std::string>;

struct Limits {
    double time_s, work_s;  ///< on the clock, and of the processor
    rlim_t memory_B;
};

/** The child's side: becomes the command. @param words  of it, and a null pointer */
[[noreturn]] void become(char* const* words, const Limits& most, std::FILE* out, std::FILE* err) {
    const std::pair<int, rlim_t> limits[] = {
        {RLIMIT_AS, most.memory_B}, {RLIMIT_CPU, static_cast<rlim_t>(most.work_s)}, {RLIMIT_FSIZE, kMaxUrdfBytes + 1}};
    setpgid(0, 0);  // its own group, with all that it starts
    for (const auto& [what, value] : limits) {
        const rlimit limit{value, value};
        setrlimit(what, &limit);
    }
    dup2(open("/dev/null", O_RDONLY), STDIN_FILENO);
    dup2(fileno(out), STDOUT_FILENO);
    dup2(fileno(err), STDERR_FILENO);
    execvp(words[0], words);
    _exit(kNotInstalled);
}

std::string readAll(std::FILE* file) {
    std::string text(kMaxUrdfBytes + 1, '\0');
    std::rewind(file);
    text.resize(std::fread(text.data(), 1, text.size(), file));
    return text;
}

/** Runs a command. `refuse(what, said)` makes the error of one that cannot be had, ends badly or says too much; `said` is
its standard error where it ended by itself with kRefused. @return  its output */
template <class Refuse>
std::string run(const Command& command, const Limits& limits, const Refuse& refuse) {
    const std::string& name = command.front();
    const File out(std::tmpfile(), std::fclose), err(std::tmpfile(), std::fclose);
    if (!out || !err) throw std::system_error(errno, std::generic_category(), "no file for the output of " + name);
    std::vector<char*> words;
    for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    const pid_t child = forkChild(("for " + name).c_str());
    if (child == 0) become(words.data(), limits, out.get(), err.get());
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(limits.time_s);
    int status = 0;
    while (waitpid(child, &status, WNOHANG) == 0) {
        if (std::chrono::steady_clock::now() > end) {
            kill(-child, SIGKILL);
            throw refuse(endOverdue(child, limits.time_s), "");
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    const std::string text = readAll(out.get());
    if (text.size() > kMaxUrdfBytes)
        throw refuse(name + " gave more than " + std::to_string(kMaxUrdfBytes) + " bytes", "");
    if (status == 0) return text;
    if (WIFEXITED(status) && WEXITSTATUS(status) == kNotInstalled)
        throw refuse("the program " + name + ", which reads it, was not found", "");
    const std::string said = readAll(err.get());
    if (WIFEXITED(status) && WEXITSTATUS(status) == kRefused) throw refuse("", said);
    const std::string shown = said.substr(0, 300);  // as far as it fits a line
    throw refuse(name + " failed: " + makePrintable(shown.substr(0, shown.find_last_not_of(" \n") + 1)), "");
}

}  // namespace

std::string expandXacro(const std::filesystem::path& file, const std::string& where) {
    const std::string path = std::filesystem::absolute(file).string();  // no option begins so
    return run({"xacro", path}, {10.0, 10.0, 1u << 30}, [&](const std::string& what, const std::string&) {
        return badInput(where, "this is xacro input, and " + (what.empty() ? "xacro failed" : what),
                        "Run `xacro " + quoteForShell(file.string()) + " > NAME.urdf` and use its output.");
    });
}

std::string convertMjcf(const std::filesystem::path& script, const std::filesystem::path& file,
                        std::vector<std::string>& notes) {
    const std::string path = std::filesystem::absolute(file).string();
    std::string text =
        run({"python3", "-B", script.string(), path}, {120.0, 30.0, rlim_t{4} << 30},
            [&](const std::string& what, const std::string& said) {
                if (!what.empty())
                    return badInput(file.string(), "this is a MuJoCo model, and " + what,
                                    "Give the arm's own file, without the scene around it.");
                const std::size_t line = std::min(said.find('\n'), said.size() - 1);
                return badInput(file.string(), makePrintable(said.substr(0, line)),
                                makePrintable(said.substr(line + 1, said.find_last_not_of('\n') - line)));
            });
    for (std::size_t end; text.compare(0, 6, "note: ") == 0 && (end = text.find('\n')) != std::string::npos;) {
        notes.push_back(file.string() + ": " + makePrintable(text.substr(6, end - 6)));
        text.erase(0, end + 1);
    }
    return text;
}

}  // namespace viable::detail
