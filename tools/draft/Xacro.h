#pragma once

#include <filesystem>
#include <string>

namespace viable::detail {

/** What the program `xacro` makes of a file. It runs without a shell, for at most 10 s, with 1 GB of memory; throws Error
(BadInput) where it is not installed, fails, or gives more than a URDF may have.
@param where  the element that needs it, for the message */
std::string expandXacro(const std::filesystem::path& file, const std::string& where);

}  // namespace viable::detail
