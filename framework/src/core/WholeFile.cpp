#include "viable/core/WholeFile.h"

#include <fstream>
#include <system_error>

#include "viable/core/Error.h"

namespace viable {

void replaceFile(const std::filesystem::path& file, const std::string& text) {
    const std::filesystem::path temporary = file.string() + ".part";
    std::error_code error;
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
    if (error)
        throw Error(ErrorKind::LogNotWritten, file.string(),
                    "cannot be replaced: " + error.message());
}

}  // namespace viable
