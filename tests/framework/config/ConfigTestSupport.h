#pragma once

#include <chrono>
#include <functional>

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "viable/config/ConfigNode.h"

namespace viable {

/** Every leaf of a tree in file order: key path and content. */
inline void listLeaves(const ConfigNode& node, std::vector<std::pair<std::string, std::string>>& leaves) {
    if (node.kind == ConfigNode::Kind::Scalar) {
        leaves.emplace_back(node.keyPath, (node.quoted ? "text " : "plain ") + node.text);
    } else if (node.items.empty() && node.entries.empty()) {
        leaves.emplace_back(node.keyPath, "kind " + std::to_string(static_cast<int>(node.kind)));
    }
    for (const ConfigNode& item : node.items) listLeaves(item, leaves);
    for (const auto& entry : node.entries) listLeaves(entry.second, leaves);
}

inline std::vector<std::pair<std::string, std::string>> listLeaves(const ConfigNode& node) {
    std::vector<std::pair<std::string, std::string>> leaves;
    listLeaves(node, leaves);
    return leaves;
}

/** The same content; places may differ. */
inline bool isSameTree(const ConfigNode& a, const ConfigNode& b) {
    if (a.kind != b.kind || a.text != b.text || a.quoted != b.quoted || a.keyPath != b.keyPath ||
        a.items.size() != b.items.size() || a.entries.size() != b.entries.size()) {
        return false;
    }
    for (std::size_t i = 0; i < a.items.size(); ++i)
        if (!isSameTree(a.items[i], b.items[i])) return false;
    for (std::size_t i = 0; i < a.entries.size(); ++i) {
        if (a.entries[i].first != b.entries[i].first || !isSameTree(a.entries[i].second, b.entries[i].second))
            return false;
    }
    return true;
}

/** Shortest of three runs, so that a busy machine does not count. [ms] */
inline double measure_ms(const std::function<void()>& action) {
    double best = 1e300;
    for (int i = 0; i < 3; ++i) {
        const auto start = std::chrono::steady_clock::now();
        action();
        const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
        best = std::min(best, time.count());
    }
    return best;
}

using test::catchError;
using test::expectContains;
using test::expectError;
using test::TemporaryFolder;

inline std::string repeat(const std::string& text, int times) {
    std::string result;
    result.reserve(text.size() * static_cast<std::size_t>(times));
    for (int i = 0; i < times; ++i) result += text;
    return result;
}

}  // namespace viable
