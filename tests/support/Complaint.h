#pragma once

#include "ExpectContains.h"
#include "viable/core/Error.h"

namespace viable::test {

/** What `action` complains about, by an Error of this kind; empty when it does not. */
template <class Action>
std::string findComplaint(const Action& action, ErrorKind kind = ErrorKind::BadInput) {
    try {
        action();
    } catch (const Error& e) {
        EXPECT_EQ(e.kind(), kind) << e.what();
        return e.what();
    }
    return {};
}

/** The same; fails when no error is thrown. */
template <class Action>
std::string catchError(const Action& action, ErrorKind kind = ErrorKind::BadInput) {
    const std::string complaint = findComplaint(action, kind);
    EXPECT_NE(complaint, "") << "no error was thrown";
    return complaint;
}

/** What `action` complains about says all of this. */
template <class Action>
void expectError(const std::vector<std::string>& parts, ErrorKind kind, const Action& action) {
    expectContains(catchError(action, kind), parts);
}
template <class Action>
void expectError(const std::vector<std::string>& parts, const Action& action) {
    expectError(parts, ErrorKind::BadInput, action);
}

}  // namespace viable::test
