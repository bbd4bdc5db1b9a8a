#include "viable/core/Error.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "core/ErrorParts.h"

namespace viable {

static std::string compose(const std::string& where, const std::string& what, const std::string& remedy) {
    std::string text;
    if (!where.empty()) text.append(where.c_str()).append(": ");
    text += what.c_str();
    if (!remedy.empty()) text.append(". ").append(remedy.c_str());
    // Behind the text that what() ends with stand the parts, each with a zero after it, for getParts(): std::runtime_error
    // keeps all of a string. A member would change the layout of what plugins throw.
    text.push_back('\0');
    for (const std::string* part : {&where, &what, &remedy}) text.append(part->c_str()).push_back('\0');
    return text;
}

static std::size_t calcEditDistance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        std::size_t diagonal = row[0];
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
            diagonal = row[j];
            row[j] = std::min({replaced, row[j] + 1, row[j - 1] + 1});
        }
    }
    return row.back();
}

Error::Error(ErrorKind kind, const std::string& where, const std::string& what, const std::string& remedy)
    : std::runtime_error(compose(where, what, remedy)), kind_(kind) {}

ErrorParts getParts(const Error& error) {
    const char* at = error.what();
    const auto next = [&at] { return std::string(at += std::strlen(at) + 1); };
    return {next(), next(), next()};  // in this order
}

Error badInput(const std::string& where, const std::string& what, const std::string& remedy) {
    return Error(ErrorKind::BadInput, where, what, remedy);
}

std::string findClosestName(const std::string& name, const std::vector<std::string>& candidates) {
    std::string closest;
    // More than about a third of the letters wrong is another word, not a slip.
    std::size_t best = std::max<std::size_t>(2, name.size() / 3) + 1;
    for (const std::string& candidate : candidates) {
        const std::size_t distance = calcEditDistance(name, candidate);
        if (distance < best) {
            best = distance;
            closest = candidate;
        }
    }
    return closest;
}

namespace detail {

void failCheck(const char* condition, const char* file, int line, const char* text) {
    std::fprintf(stderr, "viable: internal error at %s:%d: %s (%s). Please report this.\n", file, line, text,
                 condition);
    std::abort();
}

}  // namespace detail

}  // namespace viable
