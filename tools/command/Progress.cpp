#include "Progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>

namespace viable {

namespace {
constexpr int kBarWidth = 40;
constexpr std::chrono::seconds kPlainInterval{5};
constexpr std::chrono::milliseconds kJsonInterval{100};
}  // namespace

bool areMessagesJson() {
    const char* const form = std::getenv("VIABLE_MESSAGES");
    return form && std::strcmp(form, "json") == 0;
}

Progress::Progress(std::vector<std::string> names)
    : names_(std::move(names)),
      shares_(names_.size()),
      json_(areMessagesJson()),
      terminal_(isatty(STDERR_FILENO) == 1),
      color_(terminal_ && !std::getenv("NO_COLOR")),
      begin_(std::chrono::steady_clock::now()),
      lastDrawn_(begin_) {
    for (auto& share : shares_) share = 0.0;
}

void Progress::draw(bool last) {
    const auto now = std::chrono::steady_clock::now();
    if (json_) {
        if (!last && now - lastDrawn_ < kJsonInterval) return;
        lastDrawn_ = now;
        drawJson();
        return;
    }
    if (!terminal_) {
        if (last || now - lastDrawn_ < kPlainInterval) return;  // a short run needs no lines
        lastDrawn_ = now;
        std::string line = "running:";
        for (std::size_t i = 0; i < names_.size(); ++i)
            line += " " + names_[i] + " " + std::to_string(static_cast<int>(100.0 * shares_[i])) + " %";
        std::fprintf(stderr, "%s\n", line.c_str());
        return;
    }
    if (drawn_) std::fprintf(stderr, "\033[%zuA", names_.size());
    drawn_ = true;
    const double elapsed = std::chrono::duration<double>(now - begin_).count();
    std::size_t width = 0;
    for (const std::string& name : names_) width = std::max(width, name.size());
    for (std::size_t i = 0; i < names_.size(); ++i) {
        const double share = shares_[i];
        const int filled = static_cast<int>(share * kBarWidth);
        const std::string bar(static_cast<std::size_t>(filled), '=');
        std::string tail = share > 0.0 && share < 1.0
                               ? std::to_string(static_cast<int>(elapsed / share * (1.0 - share) + 0.5)) + " s left"
                               : "";
        std::fprintf(stderr, "\r\033[K%-*s [%s%-*s%s] %3d %% %s\n", static_cast<int>(width), names_[i].c_str(),
                     color_ ? "\033[32m" : "", kBarWidth, bar.c_str(), color_ ? "\033[0m" : "",
                     static_cast<int>(100.0 * share), tail.c_str());
    }
    std::fflush(stderr);
}

void Progress::drawJson() const {
    nlohmann::json shares = nlohmann::json::object();
    for (std::size_t i = 0; i < names_.size(); ++i) shares[names_[i]] = shares_[i].load();
    std::fprintf(
        stderr, "%s\n",
        nlohmann::json{{"progress", shares}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    std::fflush(stderr);
}

}  // namespace viable
