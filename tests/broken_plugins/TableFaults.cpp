// Every fault that is in the table alone, in one library: it is copied under the name of each fault
// (viable_filter_<fault>.so) and spoils a healthy table as the name says under which it was loaded.
#include <dlfcn.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "BrokenPlugin.h"

namespace {

struct Options {
    double gain = 1.0;
    bool isB = false;

    template <class V>
    void describe(V& v) {
        v(gain, "gain", "1/s", "First.");
        v(isB, "mode", "a|b", "Second.");
    }
};

/** The healthy table of a filter of this name, to be spoiled. */
struct Table {
    explicit Table(const char* name) {
        const std::vector<viable::ParameterSpec>& healthy = viable::settingsOf<Options>();
        std::copy(healthy.begin(), healthy.end(), parameters);
        entry = viable::makePluginEntry<viable::SafetyFilter, broken::Filter>(name, "A broken table.");
        entry.parameters = parameters;
        entry.parameterCount = healthy.size();
        library = {viable::kPluginMagic,
                   sizeof(viable::PluginLibrary),
                   viable::makeAbiStamp(),
                   sizeof(viable::PluginEntry),
                   1,
                   &entry,
                   nullptr};
    }
    Table(const Table&) = delete;

    viable::ParameterSpec parameters[2];
    viable::PluginEntry entry;
    viable::PluginLibrary library;
    const viable::PluginLibrary* shown = &library;
};

/** A type that only this library knows. */
class DeviceMissing : public std::runtime_error {
public:
    DeviceMissing() : std::runtime_error("no device at port 7") {}
};

class ThrowingFilter : public broken::Filter {
public:
    ThrowingFilter() { throw DeviceMissing(); }
};

class IntThrowingFilter : public broken::Filter {
public:
    IntThrowingFilter() { throw 7; }
};

// Every field but the first, the version, which alone is told where it differs.
void changeEveryField(viable::AbiStamp& stamp) {
    auto* fields = reinterpret_cast<std::uint32_t*>(&stamp);
    for (std::size_t i = 1; i < sizeof stamp / sizeof *fields; ++i) fields[i] += 1;
}

void openOnce() {
    static int calls = 0;
    if (++calls > 1) throw std::runtime_error("called again");
}

struct Fault {
    const char* name;
    void (*spoil)(Table&);
};

// CMakeLists.txt makes one copy of the library for each name.
const Fault kFaults[] = {
    // a table of something else, or of another build
    {"wrong_magic", [](Table& t) { t.library.magic ^= 1; }},
    {"other_version", [](Table& t) { t.library.stamp.interfaceVersion += 1; }},
    {"other_everything", [](Table& t) { changeEveryField(t.library.stamp); }},
    {"other_entry_size", [](Table& t) { t.library.entrySize += 8; }},
    // the shorter table of an older interface, the longer one of a later one, one that ends before its version
    {"short_table", [](Table& t) { t.library.size -= 8; }},
    {"long_table", [](Table& t) { t.library.size += 8; }},
    {"tiny_table", [](Table& t) { t.library.size = 12; }},
    {"null_table", [](Table& t) { t.shown = nullptr; }},
    {"table_throws", [](Table&) { throw std::runtime_error("no table today"); }},
    // entries
    {"null_entries", [](Table& t) { t.library.entries = nullptr; }},
    {"no_entries", [](Table& t) { t.library.entryCount = 0; }},
    {"many_entries", [](Table& t) { t.library.entryCount = 4000000000u; }},
    {"no_name", [](Table& t) { t.entry.name = nullptr; }},
    {"wrong_name", [](Table& t) { t.entry.name = "right_name"; }},
    {"unknown_kind", [](Table& t) { t.entry.kind = static_cast<viable::PluginKind>(5); }},
    {"wrong_kind",
     [](Table& t) {
         t.entry =
             viable::makePluginEntry<viable::NominalController, broken::Controller>("wrong_kind", "A controller.");
     }},
    {"no_create", [](Table& t) { t.entry.create = nullptr; }},
    {"no_destroy", [](Table& t) { t.entry.destroy = nullptr; }},
    // parameters
    {"null_parameters", [](Table& t) { t.entry.parameters = nullptr; }},
    {"nameless_parameter", [](Table& t) { t.parameters[1].name = nullptr; }},
    {"twin_parameters", [](Table& t) { t.parameters[1].name = "gain"; }},
    {"empty_range",
     [](Table& t) {
         t.parameters[0].min = 2, t.parameters[0].max = 1;
         t.library.open = openOnce;
     }},
    // what it does once its stamp is known to be right
    {"open_throws",
     [](Table& t) {
         t.library.open = [] {
             openOnce();
             throw std::runtime_error("no options today");
         };
     }},
    {"opens_another_build",
     [](Table& t) {
         t.library.stamp.layout += 1;
         t.library.open = [] { std::abort(); };
     }},
    {"limit_of_taken_name", [](Table& t) { t.library.open = [] { viable::addLimit("motor", "Nm", {}); }; }},
    // cannot be made: and says why, does not say why, lets exceptions out
    {"null_create",
     [](Table& t) {
         t.entry.create = [](char* message, std::size_t size) -> void* {
             std::snprintf(message, size, "the device is not plugged in");
             return nullptr;
         };
     }},
    {"silent_create", [](Table& t) { t.entry.create = [](char*, std::size_t) -> void* { return nullptr; }; }},
    {"create_throws",
     [](Table& t) {
         t.entry.create = [](char*, std::size_t) -> void* { throw std::runtime_error("thrown across the border"); };
     }},
    {"create_throws_int", [](Table& t) { t.entry.create = [](char*, std::size_t) -> void* { throw 7; }; }},
    {"constructor_throws",
     [](Table& t) {
         t.entry = viable::makePluginEntry<viable::SafetyFilter, ThrowingFilter>("constructor_throws", "Throws.");
     }},
    {"constructor_throws_int",
     [](Table& t) {
         t.entry =
             viable::makePluginEntry<viable::SafetyFilter, IntThrowingFilter>("constructor_throws_int", "Throws.");
     }},
};

/** The fault under whose name this library was loaded; null where the name is none of them. */
const Fault* findFault() {
    Dl_info info;
    if (dladdr(&kFaults, &info) == 0) return nullptr;
    const std::string file = info.dli_fname;
    for (const Fault& fault : kFaults) {
        const std::string ending = std::string("/viable_filter_") + fault.name + ".so";
        if (file.size() >= ending.size() && file.compare(file.size() - ending.size(), ending.size(), ending) == 0)
            return &fault;
    }
    return nullptr;
}

}  // namespace

// Every call begins with the healthy table again.
extern "C" VIABLE_PLUGIN_VISIBLE const viable::PluginLibrary* viable_plugin_library() {
    static const Fault* const fault = findFault();
    if (fault == nullptr) return nullptr;
    alignas(Table) static unsigned char memory[sizeof(Table)];
    Table& table = *new (memory) Table(fault->name);
    fault->spoil(table);
    return table.shown;
}
