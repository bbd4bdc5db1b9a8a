#pragma once

#include <algorithm>

#include "core/ErrorList.h"
#include "viable/config/ConfigNode.h"

namespace viable::detail {

/** Reads the entries of a map, each whatever is wrong with the others, and keeps what is wrong. */
class MapReader {
public:
    /** @param node  must outlive this object, a Map. @param keys  all that it may have: others are complained of */
    MapReader(const ConfigNode& node, const std::vector<std::string>& keys, ErrorList& errors)
        : map_(node), errors_(errors) {
        for (const std::string& key : keys) map_.find(key);
        for (const auto& entry : node.entries)
            if (std::find(keys.begin(), keys.end(), entry.first) == keys.end())
                meant_.insert(findClosestName(entry.first, keys));
        isKnown_ = errors.collect([&] { map_.finish(); });
    }

    const ConfigNode* find(const std::string& key) const { return map_.node().find(key); }
    /** All keys are known. Where one is not, nothing can be called missing: it may be what was meant. */
    bool isKnown() const { return isKnown_; }
    /** False: an unknown key may have been meant for this one, so that its value, or the default, says nothing. */
    bool isSure(const std::string& key) const { return meant_.count(key) == 0; }

    /** Calls read(value) where the key is there. */
    template <class Read>
    void readOptional(const std::string& key, const Read& read) {
        if (const ConfigNode* value = find(key)) errors_.collect([&] { read(*value); });
    }
    /** The same of a key that must be there. */
    template <class Read>
    void require(const std::string& key, const Read& read) {
        if (isKnown_ || find(key)) errors_.collect([&] { read(map_.require(key)); });
    }

private:
    ConfigMap map_;
    ErrorList& errors_;
    std::set<std::string> meant_;  ///< by unknown keys
    bool isKnown_ = true;
};

}  // namespace viable::detail
