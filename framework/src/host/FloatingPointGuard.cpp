#include "host/FloatingPointGuard.h"
#include "core/Text.h"

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace viable {

namespace {

using ModeBit = std::pair<std::uint64_t, const char*>;

#if defined(__SSE__)
std::uint64_t readControl() {
    return _mm_getcsr() & ~std::uint64_t(0x3f);
}  // without the flags
void writeControl(std::uint64_t control) {
    _mm_setcsr(static_cast<unsigned>(control));
}
constexpr ModeBit kModes[] = {{0x8000, "flush-to-zero"}, {0x0040, "denormals-are-zero"}};
constexpr std::uint64_t kRounding = 0x6000;
#elif defined(__aarch64__)
std::uint64_t readControl() {
    std::uint64_t fpcr;
    asm volatile("mrs %0, fpcr" : "=r"(fpcr));
    return fpcr;
}
void writeControl(std::uint64_t control) {
    asm volatile("msr fpcr, %0" : : "r"(control));
}
constexpr ModeBit kModes[] = {{1u << 24, "flush-to-zero"}};
constexpr std::uint64_t kRounding = 3u << 22;
#else
std::uint64_t readControl() {
    return 0;
}
void writeControl(std::uint64_t) {}
constexpr ModeBit kModes[] = {{0, ""}};
constexpr std::uint64_t kRounding = 0;
#endif

const char* getRoundingName(int rounding) {
    static constexpr std::pair<int, const char*> kRoundings[] = {
        {FE_TONEAREST, "to nearest"}, {FE_UPWARD, "upward"}, {FE_DOWNWARD, "downward"}, {FE_TOWARDZERO, "toward zero"}};
    for (const auto& [mode, name] : kRoundings)
        if (mode == rounding) return name;
    return "unknown";
}

}  // namespace

FloatingPointGuard::FloatingPointGuard() : rounding_(std::fegetround()), control_(readControl()) {
    std::fegetenv(&environment_);
}

FloatingPointGuard::~FloatingPointGuard() {
    std::fesetenv(&environment_);
}

std::uint64_t FloatingPointGuard::readModes() {
    return readControl();
}

const char* FloatingPointGuard::findChange(std::uint64_t modes) {
    const std::uint64_t changed = readControl() ^ modes;
    if (changed == 0) return nullptr;
    if (changed & kRounding) return "the rounding mode";
    for (const auto& [mask, name] : kModes)
        if (changed & mask) return name;
    return "which floating point exceptions trap";
}

void FloatingPointGuard::setModes(std::uint64_t modes) {
    std::fesetround(FE_TONEAREST);  // of registers that the one below does not govern
    writeControl(modes);
}

std::string FloatingPointGuard::describeChange() const {
    std::string text;
    const auto add = [&](const std::string& part) { detail::addItem(text, part); };
    const std::uint64_t changed = readControl() ^ control_;
    std::uint64_t named = kRounding;
    for (const auto& [mask, name] : kModes) {
        named |= mask;
        if (changed & mask) add(std::string(name) + (control_ & mask ? " switched off" : " switched on"));
    }
    if (std::fegetround() != rounding_ || (changed & kRounding))
        add(std::string("rounding ") + getRoundingName(std::fegetround()) + " instead of " +
            getRoundingName(rounding_));
    if (changed & ~named) add("floating point exceptions trapped or masked differently");
    return text;
}

}  // namespace viable
