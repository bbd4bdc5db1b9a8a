#pragma once

#include "viable/log/TickRecord.h"

namespace viable {

/** Writes the ticks of a TorqueGuard or a ReferenceGuard to a log as `viable run` makes them. `viable report FOLDER`
makes pages of the logs in a folder. `viable export` makes tables, and `viable verify` checks them.

Real time: append() copies into a slot made beforehand; another thread writes. No allocation, lock or system call.
Thread: append() by one thread, the rest not beside it. */
class GuardLog {
public:
    /** @param file        to be created: FOLDER/NAME.mcap
        @param robot       as given to the guard, from loadRobot() where its links are to be drawn
        @param hasRealArm  of a TorqueGuard; false: of a ReferenceGuard without surroundings
    Throws Error: BadInput where the file exists already, LogNotWritten where it cannot be created. */
    GuardLog(const std::filesystem::path& file, const RobotDescription& robot, bool hasRealArm);
    /** Calls finish() and ignores its message. */
    ~GuardLog();
    GuardLog(GuardLog&&) noexcept;
    GuardLog& operator=(GuardLog&&) noexcept;

    /** Hands over the account of a tick: guard.record(). False: the writing thread is a second behind, and the row is
    lost. Not after finish(). */
    bool append(const TickRecord& record) noexcept;

    /** Writes what is left. Empty: every row handed over is in the file; else what went wrong. */
    std::string finish();

private:
    struct Inside;
    std::unique_ptr<Inside> inside_;
};

}  // namespace viable
