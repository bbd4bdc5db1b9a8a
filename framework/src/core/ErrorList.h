#pragma once

#include <cstddef>
#include <exception>
#include <set>
#include <utility>

#include "viable/core/Error.h"

namespace viable::detail {

/** What is wrong with one file or request, told together: who mends it wants all of it at once. */
class ErrorList {
public:
    /** The arguments of badInput(). What is told already, as of a block that several cases share, is not told again. */
    void add(const std::string& where, const std::string& what, const std::string& remedy = {});

    /** Calls `reading` and keeps what it throws, so that the next can be looked at, too: BadInput as one error or
    several, of anything else the first. @return  true: it threw nothing */
    template <class Reading>
    bool collect(const Reading& reading) {
        try {
            reading();
            return true;
        } catch (const Error& error) {
            if (error.kind() == ErrorKind::BadInput)
                add(error);
            else
                keepOther();
        } catch (...) {
            keepOther();
        }
        return false;
    }

    bool isEmpty() const { return all_.empty(); }
    /** More would not be told: whoever would have to work for it may stop. */
    bool isFull() const { return other_ || all_.size() >= kMostTold; }

    /** Throws Error (BadInput) unless empty: one error as badInput() tells it, several as a numbered list; where
    there is none, what else was thrown.
    @param subject  what all of them are about, such as a file */
    void throwIfAny(const std::string& subject) const;

private:
    static constexpr std::size_t kMostTold = 100;  // more are no help
    struct Entry {
        std::string where, what, remedy;
    };
    class List;  // several, thrown

    void add(const Error& error);
    void keepOther() {
        if (!other_) other_ = std::current_exception();
    }

    std::vector<Entry> all_;
    std::set<std::pair<std::string, std::string>> told_;  ///< where and what
    std::exception_ptr other_;
};

}  // namespace viable::detail
