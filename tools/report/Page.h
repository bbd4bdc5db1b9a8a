#pragma once

#include <filesystem>

#include "report/BinaryBlock.h"

namespace viable::detail {

/** A page of reports without data: HTML with two marks where the data belongs. */
class Page {
public:
    /** Throws Error (BadInput) where there is no such file. */
    explicit Page(const std::filesystem::path& file);

    /** Writes the page with its data, whole or not at all; version and time are added to `data`. Nothing in the data
    can end the element of the page that holds it. Throws Error: BadInput when the page has no place for the data,
    LogNotWritten when the target cannot be written. */
    void write(const std::filesystem::path& target, nlohmann::json data, const BinaryBlock& block) const;

private:
    std::filesystem::path file_;
    std::string text_;
};

}  // namespace viable::detail
