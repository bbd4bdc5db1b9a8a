#pragma once

#include <string>

namespace viable {

/** `text` on one line, without what would command a terminal: text from a file of somebody else is printed so. Line ends
and tabs become blanks, other control characters (C1 ones in UTF-8 too) `?`. */
std::string makePrintable(std::string text);

}  // namespace viable
