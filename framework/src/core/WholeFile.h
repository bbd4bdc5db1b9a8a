#pragma once

#include <filesystem>
#include <string>

namespace viable {

/** Writes a file whole or not at all; one that is there is replaced, a folder or device is not. Throws Error
(LogNotWritten). */
void replaceFile(const std::filesystem::path& file, const std::string& text);

/** Refuses a place for a new file where something is already. @param option  that named it. Throws Error (BadInput). */
void refuseExisting(const std::string& option, const std::filesystem::path& file);

}  // namespace viable
