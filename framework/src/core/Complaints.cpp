#include "core/Complaints.h"

#include <algorithm>

#include "viable/core/Error.h"

namespace viable::detail {

namespace {

/** More are no help. */
constexpr std::size_t kMostTold = 100;

}  // namespace

void Complaints::add(const std::string& where, const std::string& what, const std::string& remedy) {
    all_.push_back({where, what, remedy});
}

void Complaints::throwIfAny(const std::string& subject) const {
    if (all_.empty()) return;
    if (all_.size() == 1) throw badInput(all_[0].where, all_[0].what, all_[0].remedy);
    std::string list = std::to_string(all_.size()) + " things are wrong:";
    for (std::size_t i = 0; i < std::min(all_.size(), kMostTold); ++i)
        list += "\n  " + std::to_string(i + 1) + ". " + badInput(all_[i].where, all_[i].what, all_[i].remedy).what();
    if (all_.size() > kMostTold) list += "\n  ... and " + std::to_string(all_.size() - kMostTold) + " more";
    throw badInput(subject, list);
}

}  // namespace viable::detail
