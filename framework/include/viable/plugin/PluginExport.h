#pragma once

#include <cstdio>
#include <exception>

#include "viable/braking/DesiredJerk.h"
#include "viable/plugin/NominalController.h"
#include "viable/plugin/RealPlant.h"
#include "viable/plugin/RobustLoop.h"
#include "viable/plugin/SafetyFilter.h"
#include "viable/qp/BoxQp.h"

namespace viable {

/** Raised whenever a class or struct that crosses the border changes its layout or its virtual table. They stand in
core/, config/, qp/, braking/, robot/, environment/, limits/ and plugin/, and in filter/ and simulation/ for plugins
to build on. A test compares with the record of this version (tools/scripts/record_interface.sh writes it). */
inline constexpr std::uint32_t kPluginInterfaceVersion = 13;

inline constexpr std::uint64_t kPluginMagic = 0x76696162'6c652031ull;  // "viable 1"

enum class PluginKind : std::uint32_t { CommandSource, NominalController, SafetyFilter, RobustLoop, RealPlant };

/** Everything that must be equal on both sides before a C++ object may cross the border.
Fixed-width integers only, so that it can be read by a host of any build. */
struct AbiStamp {
    std::uint32_t interfaceVersion;
    std::uint32_t pointerSize;
    std::uint32_t eigenMaxAlignBytes;
    std::uint32_t eigenVersion;  ///< world * 10000 + major * 100 + minor
    std::uint32_t rowMajor;      ///< EIGEN_DEFAULT_TO_ROW_MAJOR
    std::uint32_t compiler;      ///< 1 gcc, 2 clang, 0 other
    std::uint32_t compilerMajor;
    std::uint32_t cxxAbi;           ///< __GXX_ABI_VERSION
    std::uint32_t libstdcxxNewAbi;  ///< _GLIBCXX_USE_CXX11_ABI
    std::uint32_t cxxStandard;      ///< __cplusplus / 100
    std::uint32_t ndebug;
    std::uint32_t fastMath;        ///< bit 0 -ffast-math, bit 1 -ffinite-math-only
    std::uint32_t libstdcxxDebug;  ///< _GLIBCXX_DEBUG changes the containers
    std::uint32_t sanitizer;       ///< bit 0 address, bit 1 thread
    std::uint32_t layout;          ///< hash over size and alignment of the types that cross the border
};

/** One plugin in a library. */
struct PluginEntry {
    PluginKind kind;
    const char* name;                 ///< snake_case; equals the folder's and the library's name
    const char* summary;              ///< one sentence
    const ParameterSpec* parameters;  ///< once the library's open() has run
    std::uint64_t parameterCount;
    /** A new plugin as a pointer to its interface class, or null with a reason in `message`. Never
     * throws. */
    void* (*create)(char* message, std::size_t messageSize);
    /** Never throws. */
    void (*destroy)(void*);
};

/** The descriptor of a plugin library for the host: magic and size first, then the stamp, then the rest. */
struct PluginLibrary {
    std::uint64_t magic;
    std::uint32_t size;  ///< sizeof(PluginLibrary)
    AbiStamp stamp;
    std::uint32_t entrySize;  ///< sizeof(PluginEntry)
    std::uint32_t entryCount;
    const PluginEntry* entries;
    /** Fills the entries' parameters and adds the library's kinds of limits. The host calls it once, when the stamp is
    equal; a throw refuses the library. Null: nothing is left to do. */
    void (*open)();
};

/** The one symbol that the host looks up: `extern "C" const viable::PluginLibrary*
 * viable_plugin_library()`. */
inline constexpr const char* kPluginSymbol = "viable_plugin_library";

#if defined(__has_feature)  // clang; gcc defines __SANITIZE_...__ instead
#define VIABLE_HAS_FEATURE(feature) __has_feature(feature)
#else
#define VIABLE_HAS_FEATURE(feature) 0
#endif
#if defined(__SANITIZE_ADDRESS__) || VIABLE_HAS_FEATURE(address_sanitizer)
#define VIABLE_SANITIZER_ADDRESS 1u
#else
#define VIABLE_SANITIZER_ADDRESS 0u
#endif
#if defined(__SANITIZE_THREAD__) || VIABLE_HAS_FEATURE(thread_sanitizer)
#define VIABLE_SANITIZER_THREAD 2u
#else
#define VIABLE_SANITIZER_THREAD 0u
#endif

namespace {  // internal linkage on purpose: each library stamps its own build

/** FNV-1a (32 bit) over the sizes and alignments of the types, in this order. */
template <class... Types>
constexpr std::uint32_t hashLayout() {
    std::uint32_t hash = 2166136261u;
    for (std::size_t number : {sizeof(Types)..., alignof(Types)...})
        for (int byte = 0; byte < 4; ++byte, number >>= 8)
            hash = (hash ^ static_cast<std::uint32_t>(number & 0xff)) * 16777619u;
    return hash;
}

/** The stamp of the translation unit that includes this header. */
inline AbiStamp makeAbiStamp() {
    AbiStamp s{};
    s.interfaceVersion = kPluginInterfaceVersion;
    s.pointerSize = sizeof(void*);
    s.eigenMaxAlignBytes = EIGEN_MAX_ALIGN_BYTES;
    s.eigenVersion = EIGEN_WORLD_VERSION * 10000 + EIGEN_MAJOR_VERSION * 100 + EIGEN_MINOR_VERSION;
#ifdef EIGEN_DEFAULT_TO_ROW_MAJOR
    s.rowMajor = 1;
#endif
#if defined(__clang__)
    s.compiler = 2;
    s.compilerMajor = __clang_major__;
#elif defined(__GNUC__)
    s.compiler = 1;
    s.compilerMajor = __GNUC__;
#endif
    s.cxxAbi = __GXX_ABI_VERSION;
#ifdef _GLIBCXX_USE_CXX11_ABI
    s.libstdcxxNewAbi = _GLIBCXX_USE_CXX11_ABI;
#endif
    s.cxxStandard = static_cast<std::uint32_t>(__cplusplus / 100);
#ifdef NDEBUG
    s.ndebug = 1;
#endif
#ifdef __FAST_MATH__
    s.fastMath = 1;
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
    s.fastMath |= 2;
#endif
#ifdef _GLIBCXX_DEBUG
    s.libstdcxxDebug = 1;
#endif
    s.sanitizer = VIABLE_SANITIZER_ADDRESS | VIABLE_SANITIZER_THREAD;
    constexpr std::uint32_t layout =
        hashLayout<ParameterSpec, Parameters, SettingList, SettingValue, LimitRow, ArmLimit, FilterTraits, PlantTraits,
                   RobustTraits, ControllerTraits, CommandTraits, ConfigNode, JointVector, JointMatrix, JointState,
                   MotionState, Pose, JointLimits, RobotDescription, RunSetup, Dynamics, Tick, MotionCommand,
                   ControllerInput, ControllerOutput, FilterInput, FilterDecision, HeldMotion, LinearErrorLoop,
                   CommandSource, NominalController, SafetyFilter, RobustLoop, RealPlant, GridStop, BoxQp,
                   DesiredJerk>();
    s.layout = layout;
    return s;
}

}  // namespace

namespace detail {

template <class Interface>
constexpr PluginKind kindOf() {
    if constexpr (std::is_same_v<Interface, CommandSource>)
        return PluginKind::CommandSource;
    else if constexpr (std::is_same_v<Interface, NominalController>)
        return PluginKind::NominalController;
    else if constexpr (std::is_same_v<Interface, SafetyFilter>)
        return PluginKind::SafetyFilter;
    else if constexpr (std::is_same_v<Interface, RobustLoop>)
        return PluginKind::RobustLoop;
    else {
        static_assert(std::is_same_v<Interface, RealPlant>, "not a plugin interface");
        return PluginKind::RealPlant;
    }
}

template <class Interface, class Class>
void* createPlugin(char* message, std::size_t messageSize) {
    static_assert(std::is_base_of_v<Interface, Class>, "the class does not implement the interface");
    try {
        return static_cast<Interface*>(new Class);
    } catch (const std::exception& e) {
        std::snprintf(message, messageSize, "its constructor threw: %s", e.what());
    } catch (...) {
        std::snprintf(message, messageSize, "its constructor threw something other than a std::exception");
    }
    return nullptr;
}

template <class Interface>
void destroyPlugin(void* plugin) {
    try {
        delete static_cast<Interface*>(plugin);
    } catch (...) {  // a destructor marked noexcept(false); the host has nothing to do about it
    }
}

}  // namespace detail

/** The options of a plugin that has none. */
struct NoOptions {
    template <class V>
    void describe(V&) {}
};

inline void addNoLimits() {}

/** The entry for `Class`, which implements `Interface`; without its parameters. */
template <class Interface, class Class>
PluginEntry makePluginEntry(const char* name, const char* summary) {
    return {detail::kindOf<Interface>(),      name, summary, nullptr, 0, &detail::createPlugin<Interface, Class>,
            &detail::destroyPlugin<Interface>};
}

/** The work of PluginLibrary::open() for a library with one entry, which reads `Options`. */
template <class Options, void (*addLimits)() = addNoLimits>
void openPlugin(PluginEntry& entry) {
    const std::vector<ParameterSpec>& parameters = settingsOf<Options>();
    entry.parameters = parameters.data();
    entry.parameterCount = parameters.size();
    addLimits();
}

}  // namespace viable

#define VIABLE_PLUGIN_VISIBLE __attribute__((visibility("default")))

/** Makes the library a plugin: once per library, outside any namespace. `Options` is a struct with describe() (see
config/Settings.h); without any: viable::NoOptions. Behind it may stand a function that adds kinds of limits, see
addLimit().
    VIABLE_PLUGIN(viable::SafetyFilter, TosbpFilter, "tosbp", "Keeps ...", TosbpOptions) */
#define VIABLE_PLUGIN(Interface, Class, name, summary, ... /* Options[, addLimits] */)                 \
    extern "C" VIABLE_PLUGIN_VISIBLE const viable::PluginLibrary* viable_plugin_library() {            \
        static viable::PluginEntry entry = viable::makePluginEntry<Interface, Class>(name, summary);   \
        static const viable::PluginLibrary library = {viable::kPluginMagic,                            \
                                                      sizeof(viable::PluginLibrary),                   \
                                                      viable::makeAbiStamp(),                          \
                                                      sizeof(viable::PluginEntry),                     \
                                                      1,                                               \
                                                      &entry,                                          \
                                                      [] { viable::openPlugin<__VA_ARGS__>(entry); }}; \
        return &library;                                                                               \
    }
