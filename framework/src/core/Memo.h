#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <future>
#include <map>
#include <mutex>
#include <string>

namespace viable::detail {

/** Remembers what takes long to make, by a text that says all it is made of. Any number of threads: who asks for what
another is making waits for that. What could not be made is not remembered. */
template <typename Value>
class Memo {
public:
    /** @param most  values kept at a time; beyond that all are forgotten */
    explicit Memo(std::size_t most) : most_(most) {}

    /** The value of `key`; `make` is called when there is none yet, and must not ask for the same key. Passes on what `make`
    throws. */
    template <typename Make>
    Value get(const std::string& key, Make make) {
        std::promise<Value> own;
        std::shared_future<Value> result;
        std::uint64_t ownNumber = 0;
        {
            const std::lock_guard lock(mutex_);
            if (known_.size() >= most_ && known_.count(key) == 0) known_.clear();
            const auto [place, isNew] = known_.try_emplace(key);
            Entry& entry = place->second;
            if (isNew) {
                entry = {own.get_future().share(), ++count_};
                ownNumber = entry.number;
            }
            result = entry.value;
        }
        if (ownNumber > 0) {
            try {
                own.set_value(make());
            } catch (...) {
                {
                    const std::lock_guard lock(mutex_);
                    const auto place = known_.find(key);  // forgotten and made anew by another in the meantime
                    if (place != known_.end() && place->second.number == ownNumber) known_.erase(place);
                }
                own.set_exception(std::current_exception());
            }
        }
        return result.get();
    }

private:
    struct Entry {
        std::shared_future<Value> value;
        std::uint64_t number = 0;  // of all that were ever made
    };
    const std::size_t most_;
    std::mutex mutex_;
    std::uint64_t count_ = 0;
    std::map<std::string, Entry> known_;
};

}  // namespace viable::detail
