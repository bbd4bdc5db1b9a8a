// Every fault of a filter that is in the table alone, or in one call alone, in one library: it is copied under the name of
// each fault (viable_filter_<fault>.so) and does what the name says under which it was loaded.
#include <dlfcn.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cfenv>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <thread>

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

    /** Another class, with parameters of its own, in a table without a fault. */
    template <class Class, class Options = viable::NoOptions>
    void show(const char* summary) {
        entry = viable::makePluginEntry<viable::SafetyFilter, Class>(entry.name, summary);
        viable::openPlugin<Options>(entry);
    }

    viable::ParameterSpec parameters[2];
    viable::PluginEntry entry;
    viable::PluginLibrary library;
    const viable::PluginLibrary* shown = &library;
};

/** A type that only this library knows. */
struct DeviceMissing : std::runtime_error {
    DeviceMissing() : std::runtime_error("no device at port 7") {}
};

struct ThrowingFilter : broken::Filter {
    ThrowingFilter() { throw DeviceMissing(); }
};

struct IntThrowingFilter : broken::Filter {
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

class Liar : public broken::Filter {
    viable::FilterTraits traits() const override { return {viable::LimitSet::joints()}; }
};

class ThrowsInReset : public broken::Filter {
    void reset(const viable::MotionState&) override { throw std::runtime_error("no way back"); }
};

class ThrowsWhenAsked : public broken::Filter {
    viable::FilterTraits traits() const override { throw std::runtime_error("who knows"); }
};

struct RoundsWhenMade : broken::Filter {
    RoundsWhenMade() { std::fesetround(FE_UPWARD); }
};

class RoundsInConfigure : public broken::Filter {
    void configure(const viable::RunSetup&, const viable::Parameters&) override { std::fesetround(FE_UPWARD); }
};

/** Speeds up for ever, whatever it is given. */
class Rewrites : public broken::Filter {
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override {
        decision.holdJerk(viable::JointVector::Constant(input.nominal.q.size(), 1.0));
        return viable::FilterStatus::Modified;
    }
};

class CrashesWhenDestroyed : public broken::Filter {
public:
    ~CrashesWhenDestroyed() override {
        if (wasReset_) std::abort();
    }

private:
    void reset(const viable::MotionState&) override { wasReset_ = true; }
    bool wasReset_ = false;
};

/** Hangs in the call that VIABLE_HANGS_WHEN names: made, configured, asked or reset. */
class HangsBeforeTicks : public broken::Filter {
public:
    HangsBeforeTicks() { hangIf("made"); }
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        hangIf("configured");
    }
    viable::FilterTraits traits() const override {
        hangIf("asked");
        return {};
    }
    void reset(const viable::MotionState& start) override {
        Filter::reset(start);
        hangIf("reset");
    }

private:
    static void hangIf(const char* when) {
        const char* const wanted = std::getenv("VIABLE_HANGS_WHEN");
        while (wanted && std::string(wanted) == when) usleep(1000);
    }
};

/** The row under whose name this library was loaded; null where its name is in none. */
template <class Row, std::size_t n>
const Row* findOwn(const Row (&rows)[n]) {
    Dl_info info;
    if (dladdr(&rows, &info) == 0) return nullptr;
    const std::string file = info.dli_fname;
    for (const Row& row : rows) {
        const std::string ending = std::string("/viable_filter_") + row.name + ".so";
        if (file.size() >= ending.size() && file.compare(file.size() - ending.size(), ending.size(), ending) == 0)
            return &row;
    }
    return nullptr;
}

/** What a filter does in every tick after the first `after_ticks`, to a decision that is healthy. */
struct TickFault {
    const char* name;
    const char* summary;
    void (*misbehave)(viable::FilterDecision&);
};

__attribute__((no_sanitize("undefined"))) void writeNowhere(viable::FilterDecision&) {
    static volatile int* nowhere = nullptr;
    *nowhere = 1;
}

std::int64_t dig(std::int64_t depth) {
    volatile char room[4096];
    room[0] = static_cast<char>(depth);
    return depth < 0 ? 0 : dig(depth + 1) + room[0];
}

void loseMegabyte(viable::FilterDecision&) {
    static char* volatile lost;
    constexpr std::size_t kMegabyte = 1 << 20;
    lost = static_cast<char*>(std::malloc(kMegabyte));
    std::memset(lost, 1, kMegabyte);
}

/** Writes over the end of its memory, which is found when somebody else asks for some. */
void damageHeap(viable::FilterDecision&) {
    static char* memory = nullptr;
    if (memory) return;
    // Behind a piece this large lies, after a few, the rest of the heap and its size.
    for (int i = 0; i < 64; ++i) memory = static_cast<char*>(std::malloc(100'000));
    std::memset(memory + malloc_usable_size(memory), 0xff, 8);
}

void throwInThread(viable::FilterDecision&) {
    static bool hasBegun = false;
    if (hasBegun) return;
    hasBegun = true;
    std::thread([] { throw std::runtime_error("the thread lost its temper"); }).detach();
    usleep(200'000);
}

void takeMemory(viable::FilterDecision&) {
    static std::vector<std::unique_ptr<double>> kept;
    kept.emplace_back(new double(1.0));
}

// CMakeLists.txt makes one copy of the library for each name.
const TickFault kTickFaults[] = {
    {"aborts", "Calls abort() after the first after_ticks.", [](viable::FilterDecision&) { std::abort(); }},
    {"calls_exit", "Calls exit(0) after the first after_ticks.", [](viable::FilterDecision&) { std::exit(0); }},
    {"segfaults", "Writes through a null pointer in every tick after the first after_ticks.", writeNowhere},
    {"overflows_stack", "Calls itself without end after the first after_ticks.",
     [](viable::FilterDecision&) { dig(1); }},
    {"throwing_tick", "Throws in every tick after the first after_ticks.",
     [](viable::FilterDecision&) { throw std::runtime_error("the filter lost its temper"); }},
    {"throws_in_thread", "Starts a thread after the first after_ticks; an exception leaves it.", throwInThread},
    {"hangs", "Never comes back after the first after_ticks.",
     [](viable::FilterDecision&) {
         for (;;) std::this_thread::sleep_for(std::chrono::milliseconds(1));
     }},
    {"allocates", "Takes memory from the heap in every tick after the first after_ticks.", takeMemory},
    {"leaks", "Loses 1 MB in every tick after the first after_ticks.", loseMegabyte},
    {"damages_heap", "Writes over the end of its memory after the first after_ticks.", damageHeap},
    {"rounds_in_tick", "Rounds upward in every tick after the first after_ticks.",
     [](viable::FilterDecision&) { std::fesetround(FE_UPWARD); }},
    {"nan_output", "Decides NaN in every tick after the first after_ticks.",
     [](viable::FilterDecision& decision) { decision.value.setConstant(std::numeric_limits<double>::quiet_NaN()); }},
    {"wrong_size", "Decides for one joint too few in every tick after the first after_ticks.",
     [](viable::FilterDecision& decision) { decision.value.setZero(decision.value.size() - 1); }},
};

class MisbehavesInTick : public broken::LateFilter {
    void misbehave(viable::FilterDecision& decision) override { fault_->misbehave(decision); }
    const TickFault* fault_ = findOwn(kTickFaults);
};

struct Fault {
    const char* name;
    void (*spoil)(Table&);
};

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
    {"constructor_throws", [](Table& t) { t.show<ThrowingFilter>("Throws."); }},
    {"constructor_throws_int", [](Table& t) { t.show<IntThrowingFilter>("Throws."); }},
    // other calls than ticks
    {"liar", [](Table& t) { t.show<Liar>("Guarantees every limit and keeps none."); }},
    {"throws_in_reset", [](Table& t) { t.show<ThrowsInReset>("Throws in reset()."); }},
    {"throws_when_asked", [](Table& t) { t.show<ThrowsWhenAsked>("Throws when it is asked what it guarantees."); }},
    {"changes_rounding", [](Table& t) { t.show<RoundsWhenMade>("Rounds upward."); }},
    {"rounds_in_configure", [](Table& t) { t.show<RoundsInConfigure>("Rounds upward from configure() on."); }},
    {"rewrites", [](Table& t) { t.show<Rewrites>("Holds a jerk of 1 rad/s^3 for ever."); }},
    {"crashes_when_destroyed", [](Table& t) { t.show<CrashesWhenDestroyed>("Aborts in its destructor after a run."); }},
    {"hangs_before_ticks",
     [](Table& t) { t.show<HangsBeforeTicks>("Hangs in the call that VIABLE_HANGS_WHEN names."); }},
};

}  // namespace

// Every call begins with the healthy table again.
extern "C" VIABLE_PLUGIN_VISIBLE const viable::PluginLibrary* viable_plugin_library() {
    static const Fault* const fault = findOwn(kFaults);
    static const TickFault* const inTick = findOwn(kTickFaults);
    if (fault == nullptr && inTick == nullptr) return nullptr;
    alignas(Table) static unsigned char memory[sizeof(Table)];
    Table& table = *new (memory) Table(fault ? fault->name : inTick->name);
    if (fault)
        fault->spoil(table);
    else
        table.show<MisbehavesInTick, broken::LateOptions>(inTick->summary);
    return table.shown;
}
