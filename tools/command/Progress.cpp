#include "Progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/Characters.h"

namespace viable {

constexpr int kBarWidth = 30;  // a line has at most 80 columns
constexpr std::size_t kLongestShown = 20;
constexpr std::chrono::seconds kPlainInterval{5};
constexpr std::chrono::milliseconds kJsonInterval{100}, kDrawInterval{50};
/** What ends before shows nothing. */
constexpr std::chrono::seconds kSilent{2};

/** On what moves its cursor. */
static bool isTerminal(int descriptor) {
    const char* const terminal = std::getenv("TERM");
    return isatty(descriptor) == 1 && !(terminal && std::strcmp(terminal, "dumb") == 0);
}

bool hasColor(int descriptor) {
    const char* const refusal = std::getenv("NO_COLOR");
    return isTerminal(descriptor) && !(refusal && *refusal);
}

bool areMessagesJson() {
    const char* const form = std::getenv("VIABLE_MESSAGES");
    return form && std::strcmp(form, "json") == 0;
}

Progress::Progress(std::vector<std::string> names)
    : names_(std::move(names)),
      shares_(names_.size()),
      json_(areMessagesJson()),
      terminal_(isTerminal(STDERR_FILENO)),
      color_(hasColor(STDERR_FILENO)),
      begin_(std::chrono::steady_clock::now()),
      lastDrawn_(begin_) {
    for (auto& share : shares_) share = 0.0;
}

void Progress::draw(bool last) {
    const auto now = std::chrono::steady_clock::now();
    if (json_) {
        if (!last && now - lastDrawn_ < kJsonInterval) return;
        lastDrawn_ = now;
        return drawJson();
    }
    const double elapsed = std::chrono::duration<double>(now - begin_).count();
    const auto tellLeft = [&](double share) {
        if (!(share > 0.0 && share < 1.0)) return std::string();
        const auto left_s = static_cast<long>(elapsed / share * (1.0 - share) + 0.5);
        const long unit = left_s < 120 ? 1 : left_s < 7200 ? 60 : 3600;
        return std::to_string(left_s / unit) + (unit == 1 ? " s left" : unit == 60 ? " min left" : " h left");
    };
    if (!drawn_ && now - begin_ < kSilent) return;
    if (!terminal_) {
        if (last || (drawn_ && now - lastDrawn_ < kPlainInterval)) return;
        lastDrawn_ = now;
        drawn_ = true;
        std::string line = "running:";
        double all = 0.0;
        for (std::size_t i = 0; i < names_.size(); ++i) {
            all += shares_[i] / static_cast<double>(names_.size());
            line += " " + names_[i] + " " + std::to_string(static_cast<int>(100.0 * shares_[i])) + " %";
        }
        if (const std::string left = tellLeft(all); !left.empty()) line += ", " + left;
        std::fprintf(stderr, "%s\n", line.c_str());
        return;
    }
    const bool isOver = !last && std::all_of(shares_.begin(), shares_.end(), [](const auto& s) { return s >= 1.0; });
    if (isOver ? !drawn_ : !last && now - lastDrawn_ < kDrawInterval) return;
    lastDrawn_ = now;
    if (drawn_) std::fprintf(stderr, "\033[%zuA", names_.size());
    if (isOver) std::fprintf(stderr, "\r\033[J");
    drawn_ = !isOver;
    std::size_t width = 0;
    for (const std::string& name : names_) width = std::max(width, detail::countCharacters(name));
    width = std::min(width, kLongestShown);
    for (std::size_t i = 0; i < names_.size() && !isOver; ++i) {
        const double share = shares_[i];
        const std::string name = detail::shorten(names_[i], kLongestShown);
        const int filled = static_cast<int>(share * kBarWidth);
        const std::string bar(static_cast<std::size_t>(filled), '=');
        std::fprintf(stderr, "\r\033[K%s%*s [%s%-*s%s] %3d %% %s\n", name.c_str(),
                     static_cast<int>(width - detail::countCharacters(name)), "", color_ ? "\033[32m" : "", kBarWidth,
                     bar.c_str(), color_ ? "\033[0m" : "", static_cast<int>(100.0 * share), tellLeft(share).c_str());
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
