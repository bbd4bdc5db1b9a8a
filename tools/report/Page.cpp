#include "report/Page.h"

#include <ctime>

#include "core/Text.h"
#include "core/WholeFile.h"

namespace viable::detail {

namespace fs = std::filesystem;
using nlohmann::json;

static std::string getNow() {
    const std::time_t now = std::time(nullptr);
    char text[32];
    std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
    return text;
}

/** The page with its two blocks of data in place. */
static std::string fill(const std::string& page, const fs::path& file, const std::string& data,
                        const std::string& binary) {
    std::string text;
    std::size_t done = 0;
    for (const auto& [mark, content] : {std::pair<std::string, const std::string&>{"@@VIABLE_DATA@@", data},
                                        std::pair<std::string, const std::string&>{"@@VIABLE_BINARY@@", binary}}) {
        const std::size_t place = page.find(mark, done);
        if (place == std::string::npos)
            throw badInput(file.string(), "this page has no placeholder for the data (" + mark + ")",
                           "Run tools/setup.sh again, or install viable again.");
        text.append(page, done, place - done);
        text += content;
        done = place + mark.size();
    }
    return text.append(page, done, std::string::npos);
}

Page::Page(const fs::path& file) : file_(file), text_(readWhole(file).value_or("")) {
    if (text_.empty())
        throw badInput(file.string(), "the page of reports is missing",
                       "Run tools/setup.sh again, or install viable again.");
}

void Page::write(const fs::path& target, json data, const BinaryBlock& block) const {
    data["version"] = VIABLE_VERSION;
    data["created"] = getNow();
    // Names may hold any bytes, and no text may end the script element.
    const std::string text = replaceAll(data.dump(-1, ' ', false, json::error_handler_t::replace), "<", "\\u003c");
    replaceFile(target, fill(text_, file_, text, block.encode()));
}

}  // namespace viable::detail
