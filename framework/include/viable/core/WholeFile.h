#pragma once

#include <filesystem>
#include <string>

namespace viable {

/** Writes a file whole or not at all; one that is there is replaced. Throws Error (LogNotWritten). */
void replaceFile(const std::filesystem::path& file, const std::string& text);

}  // namespace viable
