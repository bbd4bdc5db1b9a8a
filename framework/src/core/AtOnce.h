#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

namespace viable::detail {

/** That this process may use. */
std::size_t countCores();

/** Calls work(0) to work(count - 1), at most so many at a time, and returns when all have ended. They begin in this order
and must not wait for each other. Once one has thrown no more begin, and what the first of them threw is
thrown: the same for any number of cores. */
void forEachAtOnce(std::size_t count, const std::function<void(std::size_t)>& work, std::size_t threads = countCores());

}  // namespace viable::detail
