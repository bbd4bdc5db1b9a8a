#pragma once

#include <string>

#include "viable/core/Error.h"

namespace viable {

/** What an Error was made of. */
struct ErrorParts {
    std::string place, cause, remedy;  ///< as given to its constructor; each may be empty
};

ErrorParts getParts(const Error& error);

}  // namespace viable
