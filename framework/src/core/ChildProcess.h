#pragma once

#include <sys/mman.h>
#include <sys/types.h>

#include <cerrno>
#include <csignal>
#include <memory>
#include <new>
#include <string>
#include <system_error>

namespace viable::detail {

/** Forks a process that ends with this one; returns its number here, and 0 there. SIGCHLD gets its default action:
who started us may have had it ignored, and then nobody is told of a death.
@param purpose  "for the runs", for the message of the std::system_error where there can be no process */
pid_t forkChild(const char* purpose);

/** Of a program that is broken itself. */
inline constexpr int kCrashSignals[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

/** "signal 11 (Segmentation fault)" */
std::string describeSignal(int signal);

/** How a process ended, by its wait status. @param where  when that was, such as " in configure()" */
std::string describeEnd(int status, const std::string& where = {});

/** Ends a process that has not returned, and says so. @param where  when, such as " from configure()" */
std::string endOverdue(pid_t process, double timeout_s, const std::string& where = {});

/** Owns an object that this process and those forked from it see at the same address. */
template <class T>
using SharedObject = std::unique_ptr<T, void (*)(T*)>;

/** The object must hold all of itself inside; its destructor is not called. */
template <class T>
SharedObject<T> makeSharedObject() {
    void* memory = mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED)
        throw std::system_error(errno, std::generic_category(), "no memory to share with a process");
    return {new (memory) T, [](T* object) { munmap(object, sizeof(T)); }};
}

}  // namespace viable::detail
