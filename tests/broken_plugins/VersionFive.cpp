// Shows the very table of plugin interface version 5: it is longer, and what stands behind the version stands elsewhere.
#include <cstdint>

namespace {

struct TableFive {
    std::uint64_t magic;
    std::uint32_t size;
    std::uint32_t interfaceVersion;
    std::uint32_t restOfStamp[29];  // sizes of 14 types, and facts of the toolchain
    std::uint32_t entrySize, entryCount;
    const void* entries;
};
static_assert(sizeof(TableFive) == 152);

}  // namespace

extern "C" __attribute__((visibility("default"))) const void* viable_plugin_library() {
    static const TableFive table{0x766961626c652031ull, sizeof(TableFive), 5, {8, 16, 30400, 136}, 56, 1, &table};
    return &table;
}
