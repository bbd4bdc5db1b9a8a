#pragma once

#include <clocale>
#include <filesystem>
#include <string>

namespace viable {

/** Remembers what all of the program shares and foreign code can change: the locale of C (of the program and of this
thread) and of C++, the working folder and what is done at each signal; sets it back when it goes out of scope. Tables
would else show commas for points, files go elsewhere, Ctrl-C and crashes be swallowed.
Guards of several threads may overlap: what was changed is then told by the first that ends. */
class ProcessGuard {
public:
    ProcessGuard();
    ~ProcessGuard();
    ProcessGuard(const ProcessGuard&) = delete;
    ProcessGuard& operator=(const ProcessGuard&) = delete;

    /** Sets back what differs from the time of construction, and tells it in words; empty when nothing does. */
    std::string undo();

private:
    locale_t threadLocale_;
};

/** What a loaded library (canonical path) changed of that when it was loaded, in words; empty: nothing. */
std::string findLoadChange(const std::filesystem::path& library);

}  // namespace viable
