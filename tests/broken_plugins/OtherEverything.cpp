#include "BrokenPlugin.h"

static void changeEveryField(viable::AbiStamp& stamp) {
    auto* fields = reinterpret_cast<std::uint32_t*>(&stamp);
    for (std::size_t i = 1; i < sizeof stamp / sizeof *fields; ++i) fields[i] += 1;
}

// Differs in every field of the stamp but the first, the version, which alone is told where it differs.
VIABLE_BROKEN_TABLE("other_everything", changeEveryField(library.stamp))
