#pragma once

#include "viable/core/Error.h"

#ifndef __GLIBCXX__
#error \
    "getParts() reads behind the zero of what(): only libstdc++'s std::runtime_error is known to keep all of a string"
#endif

namespace viable {

/** What an Error was made of. */
struct ErrorParts {
    std::string place, cause, remedy;  ///< as given to its constructor; each may be empty
};

ErrorParts getParts(const Error& error);

}  // namespace viable
