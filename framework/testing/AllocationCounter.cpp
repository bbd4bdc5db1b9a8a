#include "viable/testing/AllocationCounter.h"

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define VIABLE_SANITIZED
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define VIABLE_SANITIZED
#endif
#if defined(__GLIBC__) && !defined(VIABLE_SANITIZED)
#define VIABLE_COUNTS_ALLOCATIONS
#endif

namespace {

#ifdef VIABLE_COUNTS_ALLOCATIONS
// Constant start value and no destructor: usable in malloc before main and after it.
thread_local std::int64_t allocations = 0;
#endif

}  // namespace

#ifdef VIABLE_COUNTS_ALLOCATIONS

// glibc lets a program define these; operator new ends in malloc or aligned_alloc.
extern "C" {

void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
    ++allocations;
    return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) {
    ++allocations;
    return __libc_calloc(count, size);
}

void* realloc(void* old, std::size_t size) {
    ++allocations;
    return __libc_realloc(old, size);
}

void* memalign(std::size_t alignment, std::size_t size) {
    ++allocations;
    return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) {
    ++allocations;
    return __libc_memalign(alignment, size);
}

int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
    if (alignment < sizeof(void*) || (alignment & (alignment - 1)) != 0) return EINVAL;
    ++allocations;
    void* const memory = __libc_memalign(alignment, size);
    if (memory == nullptr) return ENOMEM;
    *out = memory;
    return 0;
}

}  // extern "C"

#endif

namespace viable::testing {

bool AllocationCounter::isAvailable() {
#ifdef VIABLE_COUNTS_ALLOCATIONS
    return true;
#else
    return false;
#endif
}

const char* AllocationCounter::whyNot() {
    return "allocations are not counted in sanitizer builds and without glibc";
}

std::int64_t AllocationCounter::total() {
#ifdef VIABLE_COUNTS_ALLOCATIONS
    return allocations;
#else
    return 0;
#endif
}

}  // namespace viable::testing
