#include <stdexcept>

#include "BrokenPlugin.h"

namespace {

// The constructor throws a type that only this library knows.
class DeviceMissing : public std::runtime_error {
public:
    DeviceMissing() : std::runtime_error("no device at port 7") {}
};

class ThrowingFilter : public broken::Filter {
public:
    ThrowingFilter() { throw DeviceMissing(); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowingFilter, "constructor_throws", "Throws.", nullptr)
