#pragma once

#include <cstddef>
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
        bool isOwn = false;
        {
            const std::lock_guard lock(mutex_);
            if (known_.size() >= most_ && known_.count(key) == 0) known_.clear();
            const auto [entry, isNew] = known_.emplace(key, std::shared_future<Value>());
            if (isNew) entry->second = own.get_future().share();
            isOwn = isNew;
            result = entry->second;
        }
        if (isOwn) {
            try {
                own.set_value(make());
            } catch (...) {
                {
                    const std::lock_guard lock(mutex_);
                    known_.erase(key);
                }
                own.set_exception(std::current_exception());
            }
        }
        return result.get();
    }

private:
    const std::size_t most_;
    std::mutex mutex_;
    std::map<std::string, std::shared_future<Value>> known_;
};

}  // namespace viable::detail
