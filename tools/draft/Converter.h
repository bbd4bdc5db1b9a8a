#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace viable::detail {

/** What the program `xacro` makes of a file. It runs without a shell, for at most 10 s, with 1 GB of memory; throws Error
(BadInput) where it is not installed, fails, or gives more than a URDF may have.
@param where  the element that needs it, for the message */
std::string expandXacro(const std::filesystem::path& file, const std::string& where);

/** The URDF that `python3` makes of a MuJoCo model with the library's own Python package; in the same way, for at most 30 s
of the processor, with 4 GB.
@param script  mjcf_to_urdf.py, as installed
@param notes  get what a URDF cannot hold, one sentence each */
std::string convertMjcf(const std::filesystem::path& script, const std::filesystem::path& file,
                        std::vector<std::string>& notes);

}  // namespace viable::detail
