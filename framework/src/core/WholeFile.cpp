#include "core/WholeFile.h"

#include <fstream>
#include <system_error>

#include "viable/core/Error.h"

namespace viable {

void replaceFile(const std::filesystem::path& file, const std::string& text) {
    std::error_code error;
    if (std::filesystem::exists(file, error) && !std::filesystem::is_regular_file(file, error))
        throw Error(ErrorKind::LogNotWritten, file.string(), "this is no file that could be replaced", "Name a file.");
    const std::filesystem::path temporary = file.string() + ".part";
    {
        std::ofstream stream(temporary, std::ios::binary);
        stream << text;
        stream.close();
        if (!stream) {
            std::filesystem::remove(temporary, error);
            throw Error(ErrorKind::LogNotWritten, file.string(), "the file cannot be written",
                        "Free space, or give the right to write there.");
        }
    }
    std::filesystem::rename(temporary, file, error);
    if (error) throw Error(ErrorKind::LogNotWritten, file.string(), "cannot be replaced: " + error.message());
}

void refuseExisting(const std::string& option, const std::filesystem::path& file) {
    std::error_code error;
    if (std::filesystem::exists(std::filesystem::symlink_status(file, error)))
        throw badInput(option + " " + file.string(), "the file exists already and is never overwritten",
                       "Choose another name, or remove it.");
}

}  // namespace viable
