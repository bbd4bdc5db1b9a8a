#pragma once

#include <sys/resource.h>
#include <sys/wait.h>

#include <sstream>

#include "ExpectContains.h"
#include "Paths.h"
#include "TemporaryFolder.h"
#include "records/LogReader.h"

namespace viable::test {

inline int countRows(const std::filesystem::path& log) {
    LogReader reader(log);
    TickRecord record;
    int rows = 0;
    while (reader.read(record)) ++rows;
    return rows;
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

struct Outcome {
    int code = -1;  ///< exit code, or -signal
    std::string out, err;
};

/** The program, started in the project's folder with the misbehaving plugins on its path. */
class Program {
public:
    explicit Program(std::vector<std::string> arguments, std::function<void()> prepare = {}) {
        out_ = folder_ / "out";
        err_ = folder_ / "err";
        pid_ = fork();
        if (pid_ == 0) {
            if (!freopen(out_.c_str(), "w", stdout) || !freopen(err_.c_str(), "w", stderr)) _exit(99);
            if (chdir(VIABLE_SOURCE_DIR) != 0) _exit(99);
            setenv("VIABLE_PLUGIN_PATH", VIABLE_BINARY_DIR "/tests/broken_plugins", 1);
            if (prepare) prepare();
            std::vector<char*> argv{const_cast<char*>(VIABLE_PROGRAM)};
            for (std::string& argument : arguments) argv.push_back(argument.data());
            argv.push_back(nullptr);
            execv(VIABLE_PROGRAM, argv.data());
            _exit(99);
        }
    }
    pid_t pid() const { return pid_; }
    /** What it has written to its standard output so far. */
    std::string output() const { return readFile(out_); }
    Outcome wait() {
        int status = 0;
        waitpid(pid_, &status, 0);
        return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), readFile(out_), readFile(err_)};
    }

private:
    TemporaryFolder folder_;
    std::filesystem::path out_, err_;
    pid_t pid_;
};

inline Outcome run(std::vector<std::string> arguments, std::function<void()> prepare = {}) {
    return Program(std::move(arguments), std::move(prepare)).wait();
}

/** A run that ended with this code and said all of this: where it is 0 to its output, else to its errors. */
inline Outcome expectOutcome(const Outcome& o, int code, const std::vector<std::string>& parts = {}) {
    EXPECT_EQ(o.code, code) << o.out << o.err;
    expectContains(code == 0 ? o.out : o.err, parts);
    return o;
}
inline Outcome expectRun(std::vector<std::string> arguments, int code, const std::vector<std::string>& parts = {}) {
    return expectOutcome(run(std::move(arguments)), code, parts);
}

}  // namespace viable::test
