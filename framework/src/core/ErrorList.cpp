#include "core/ErrorList.h"

#include <algorithm>

#include "core/ErrorParts.h"

namespace viable::detail {

class ErrorList::List : public Error {
public:
    List(const std::string& subject, const std::string& text, std::vector<Entry> errors)
        : Error(ErrorKind::BadInput, subject, text), errors_(std::move(errors)) {}
    const std::vector<Entry>& errors() const { return errors_; }

private:
    std::vector<Entry> errors_;
};

void ErrorList::add(const std::string& where, const std::string& what, const std::string& remedy) {
    if (told_.emplace(where, what).second) all_.push_back({where, what, remedy});
}

void ErrorList::add(const Error& error) {
    if (const auto* list = dynamic_cast<const List*>(&error)) {
        for (const Entry& entry : list->errors()) add(entry.where, entry.what, entry.remedy);
        return;
    }
    const ErrorParts parts = getParts(error);
    add(parts.place, parts.cause, parts.remedy);
}

void ErrorList::throwIfAny(const std::string& subject) const {
    if (all_.empty() && other_) std::rethrow_exception(other_);
    if (all_.empty()) return;
    if (all_.size() == 1) throw badInput(all_[0].where, all_[0].what, all_[0].remedy);
    std::string list =
        (all_.size() >= kMostTold ? "at least " : "") + std::to_string(all_.size()) + " things are wrong:";
    for (std::size_t i = 0; i < std::min(all_.size(), kMostTold); ++i)
        list += "\n  " + std::to_string(i + 1) + ". " + badInput(all_[i].where, all_[i].what, all_[i].remedy).what();
    if (all_.size() > kMostTold) list += "\n  ... and " + std::to_string(all_.size() - kMostTold) + " more";
    throw List(subject, list, all_);
}

}  // namespace viable::detail
