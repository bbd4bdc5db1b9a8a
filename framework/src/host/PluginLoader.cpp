#include "host/PluginLoader.h"

#include <cxxabi.h>
#include <dlfcn.h>
#include <elf.h>
#include <link.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <mutex>

#include "core/ChildProcess.h"
#include "core/Text.h"
#include "host/FloatingPointGuard.h"
#include "host/PluginCall.h"
#include "host/ProcessGuard.h"
#include "limits/LimitRows.h"

// The build says where plugins are installed below the prefix.
#ifndef VIABLE_INSTALL_LIBDIR
#define VIABLE_INSTALL_LIBDIR "lib"
#endif

namespace viable {

namespace fs = std::filesystem;

namespace {

// Counts beyond these can only come from a damaged table.
constexpr std::uint32_t kMaxEntries = 64;
constexpr std::uint64_t kMaxParameters = 1024;

constexpr std::size_t kMessageSize = 1024;

/** Why a library cannot be used: completes the sentence "the plugin library X cannot be used: ". */
struct Refusal {
    std::string what;
    std::string remedy;
};

std::string quoted(const std::string& text) {
    return "'" + text + "'";
}

using detail::join;

std::string nameLibrary(const fs::path& file) {
    return "the plugin library " + quoted(file.string());
}

std::string makeFileName(PluginKind kind, const std::string& name) {
    return std::string("viable_") + getName(kind) + "_" + name + ".so";
}

struct LibraryName {
    PluginKind kind;
    std::string name;
};

bool startsWith(const std::string& text, const std::string& start) {
    return text.compare(0, start.size(), start) == 0;
}

bool endsWith(const std::string& text, const std::string& end) {
    return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/** Splits viable_<kind>_<name>.so. */
std::optional<LibraryName> parseFileName(const std::string& fileName) {
    for (PluginKind kind : kPluginKinds) {
        const std::string start = std::string("viable_") + getName(kind) + "_";
        if (startsWith(fileName, start) && endsWith(fileName, ".so") && fileName.size() > start.size() + 3)
            return LibraryName{kind, fileName.substr(start.size(), fileName.size() - start.size() - 3)};
    }
    return std::nullopt;
}

// --- The file, before the dynamic linker sees it ------------------------------------------------

/** Refuses what anybody on this machine could have put there or changed. */
void checkRights(const fs::path& file) {
    struct stat own {
    }, folder{};
    const fs::path place = file.parent_path();
    if (::stat(file.c_str(), &own) != 0 || ::stat(place.c_str(), &folder) != 0) return;  // told below
    if (own.st_mode & S_IWOTH)
        throw Refusal{"every user of this machine may write to it, so nobody knows whose code it is",
                      "If it is yours: chmod o-w " + file.string()};
    // In a folder with the sticky bit (as /tmp) others can add files, and leave mine alone.
    const bool isMine = own.st_uid == 0 || own.st_uid == ::geteuid();
    if ((folder.st_mode & S_IWOTH) && !((folder.st_mode & S_ISVTX) && isMine))
        throw Refusal{"every user of this machine may write to its folder " + place.string() +
                          ", so nobody knows whose code it is",
                      "Copy it to a folder of yours, or if that one is: chmod o-w " + place.string()};
}

struct FileHeader {
    std::vector<unsigned char> start;  // at most one ELF header
    std::uintmax_t size = 0;
};

FileHeader readHeader(const fs::path& file) {
    std::error_code error;
    FileHeader header;
    header.size = fs::file_size(file, error);
    std::ifstream stream(file, std::ios::binary);
    if (error || !stream)
        throw Refusal{"it cannot be read: " + (error ? error.message() : std::string(std::strerror(errno))),
                      "Give the file and its folder read permission"};
    header.start.resize(sizeof(ElfW(Ehdr)));
    stream.read(reinterpret_cast<char*>(header.start.data()), static_cast<std::streamsize>(header.start.size()));
    header.start.resize(static_cast<std::size_t>(std::max<std::streamsize>(0, stream.gcount())));
    return header;
}

/** What the dynamic linker says to a file that it is known to refuse while reading the header. */
std::string askDynamicLinker(const fs::path& file) {
    if (dlopen(file.c_str(), RTLD_LAZY | RTLD_LOCAL)) return "nothing";
    const char* text = dlerror();
    return text ? text : "nothing";
}

std::string getMachineName(unsigned machine) {
    static const std::map<unsigned, const char*> names = {{EM_X86_64, "x86-64"},
                                                          {EM_386, "32-bit x86"},
                                                          {EM_AARCH64, "64-bit ARM"},
                                                          {EM_ARM, "32-bit ARM"},
                                                          {EM_RISCV, "RISC-V"}};
    const auto known = names.find(machine);
    return known != names.end() ? known->second : "ELF machine " + std::to_string(machine);
}

unsigned findOwnMachine() {
    static const unsigned machine = [] {
        ElfW(Ehdr) own{};
        std::ifstream("/proc/self/exe", std::ios::binary).read(reinterpret_cast<char*>(&own), sizeof own);
        return static_cast<unsigned>(own.e_machine);
    }();
    return machine;
}

/** Refuses what dlopen would refuse with a riddle, and what it would crash on: glibc maps a file
that ends in the middle of a segment and the process dies of SIGBUS at the first touch. */
void checkElf(const fs::path& file) {
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (fs::is_directory(status)) throw Refusal{"it is a folder, not a file", "Name the .so file itself"};
    if (!fs::is_regular_file(status)) throw Refusal{"it is not a regular file", ""};

    const FileHeader header = readHeader(file);
    if (header.size == 0) throw Refusal{"it is empty (0 bytes)", "Build it again"};
    if (std::memcmp(header.start.data(), ELFMAG, std::min<std::size_t>(header.start.size(), SELFMAG)) != 0)
        throw Refusal{"it is not a shared library (no ELF file); the dynamic linker says: " + askDynamicLinker(file),
                      "Build the plugin with viable_add_plugin()"};
    const std::string cutOff = "it is cut off: ";
    const std::string buildAgain = "Copy or build it again";
    if (header.start.size() < sizeof(ElfW(Ehdr)))
        throw Refusal{cutOff + "it ends after " + std::to_string(header.size) +
                          " bytes, inside its header; the dynamic linker says: " + askDynamicLinker(file),
                      buildAgain};

    ElfW(Ehdr) elf;
    std::memcpy(&elf, header.start.data(), sizeof elf);
    const unsigned char ownClass = sizeof(void*) == 8 ? ELFCLASS64 : ELFCLASS32;
    const std::string otherMachine = "Build the plugin on or for this machine";
    if (elf.e_ident[EI_CLASS] != ownClass)
        throw Refusal{std::string("it is built for a ") + (elf.e_ident[EI_CLASS] == ELFCLASS32 ? "32" : "64") +
                          "-bit machine, viable for a " + std::to_string(8 * sizeof(void*)) +
                          "-bit one; the dynamic linker says: " + askDynamicLinker(file),
                      otherMachine};
    if (elf.e_machine != findOwnMachine())
        throw Refusal{"it is built for another processor (" + getMachineName(elf.e_machine) + "), viable for " +
                          getMachineName(findOwnMachine()),
                      otherMachine};

    const auto reachesBeyond = [&](std::uint64_t offset, std::uint64_t size) {
        return offset > header.size || size > header.size - offset;
    };
    const auto refuseCutOff = [&](const char* part) {
        throw Refusal{cutOff + "it ends after " + std::to_string(header.size) + " bytes, before " + part + " does",
                      buildAgain};
    };
    if (elf.e_phentsize != sizeof(ElfW(Phdr)) || elf.e_phnum == 0)
        throw Refusal{"its ELF header is damaged", buildAgain};
    const std::uint64_t segmentsSize = std::uint64_t(elf.e_phnum) * sizeof(ElfW(Phdr));
    if (reachesBeyond(elf.e_phoff, segmentsSize)) refuseCutOff("its table of segments");
    std::vector<ElfW(Phdr)> segments(elf.e_phnum);
    std::ifstream stream(file, std::ios::binary);
    stream.seekg(static_cast<std::streamoff>(elf.e_phoff));
    stream.read(reinterpret_cast<char*>(segments.data()), static_cast<std::streamsize>(segmentsSize));
    if (!stream) refuseCutOff("its table of segments");
    for (const ElfW(Phdr) & segment : segments)
        if (segment.p_type == PT_LOAD && reachesBeyond(segment.p_offset, segment.p_filesz))
            refuseCutOff("one of its segments");
    // The last thing that linkers write: without it the file has lost its end, loadable or not.
    if (elf.e_shoff != 0 && reachesBeyond(elf.e_shoff, std::uint64_t(elf.e_shnum) * elf.e_shentsize))
        refuseCutOff("its table of sections");
}

// --- The table that the library shows -----------------------------------------------------------

std::string getCompilerName(std::uint32_t compiler) {
    return compiler == 1 ? "gcc" : compiler == 2 ? "clang" : "an unknown compiler";
}

std::string getSanitizerName(std::uint32_t bits) {
    if (bits == 0) return "without a sanitizer";
    std::vector<std::string> names;
    if (bits & 1u) names.push_back("AddressSanitizer");
    if (bits & 2u) names.push_back("ThreadSanitizer");
    if (bits & ~3u) names.push_back("an unknown sanitizer");
    return "with " + join(names, " and ");
}

/** Each differing field in words, with both values and what to do about it. */
std::vector<std::string> describeDifferences(const AbiStamp& theirs, const AbiStamp& ours) {
    std::vector<std::string> found;
    const auto compare = [&](std::uint32_t AbiStamp::*field, const char* words, const char* remedy) {
        if (theirs.*field != ours.*field)
            found.push_back(std::string("its ") + words + " is " + std::to_string(theirs.*field) + ", viable's " +
                            std::to_string(ours.*field) + ": " + remedy);
    };
    const char* rebuild = "build it again with the headers of this viable";
    const char* sameEigen =
        "build it with the same Eigen as viable, and without -march=native, -mavx and EIGEN_MAX_... definitions";
    const char* sameCompiler = "build it with the compiler that built viable";

    compare(&AbiStamp::pointerSize, "pointer size in bytes", "build it for this machine");
    compare(&AbiStamp::eigenMaxAlignBytes, "Eigen alignment (EIGEN_MAX_ALIGN_BYTES)", sameEigen);
    compare(&AbiStamp::eigenVersion, "Eigen version (world * 10000 + major * 100 + minor)", sameEigen);
    compare(&AbiStamp::rowMajor, "storage order (EIGEN_DEFAULT_TO_ROW_MAJOR)", sameEigen);
    if (theirs.compiler != ours.compiler)
        found.push_back("it was built with " + getCompilerName(theirs.compiler) + ", viable with " +
                        getCompilerName(ours.compiler) + ": " + sameCompiler);
    compare(&AbiStamp::compilerMajor, "compiler's major version", sameCompiler);
    compare(&AbiStamp::cxxAbi, "C++ ABI version (__GXX_ABI_VERSION)", "build it with the same -fabi-version as viable");
    compare(&AbiStamp::libstdcxxNewAbi, "std::string ABI (_GLIBCXX_USE_CXX11_ABI)",
            "build it with the same _GLIBCXX_USE_CXX11_ABI as viable");
    compare(&AbiStamp::cxxStandard, "C++ standard (__cplusplus / 100)",
            "build it with the same CMAKE_CXX_STANDARD as viable");
    compare(&AbiStamp::libstdcxxDebug, "_GLIBCXX_DEBUG setting",
            "build it with the same _GLIBCXX_DEBUG setting as viable");
    if (theirs.ndebug != ours.ndebug)
        found.push_back(std::string("it was built ") + (theirs.ndebug ? "with" : "without") + " NDEBUG, viable " +
                        (ours.ndebug ? "with" : "without") +
                        ": link the plugin to viable::viable, which sets -UNDEBUG");
    if (theirs.fastMath != ours.fastMath)
        found.push_back(std::string("it was built ") + (theirs.fastMath ? "with" : "without") +
                        " -ffast-math, viable " + (ours.fastMath ? "with" : "without") +
                        ": build it without -ffast-math, -ffinite-math-only and -Ofast");
    if (theirs.sanitizer != ours.sanitizer)
        found.push_back("it was built " + getSanitizerName(theirs.sanitizer) + ", viable " +
                        getSanitizerName(ours.sanitizer) + ": build both with the same -fsanitize option");
    compare(&AbiStamp::layout, "hash over the layout of shared types", rebuild);
    return found;
}

bool isBlank(const char* text) {
    return text == nullptr || *text == '\0';
}

void checkParameters(const PluginEntry& entry) {
    const auto refuse = [&](const std::string& what) {
        throw Refusal{"the parameter table of " + quoted(entry.name) + " " + what,
                      "Correct the options that the plugin describes"};
    };
    const std::string count = std::to_string(entry.parameterCount) + " entries";
    if (entry.parameterCount > kMaxParameters)
        refuse("has " + count + " (at most " + std::to_string(kMaxParameters) + ")");
    if (entry.parameterCount > 0 && entry.parameters == nullptr)
        refuse("is missing although it is said to have " + count);
    for (std::uint64_t i = 0; i < entry.parameterCount; ++i) {
        const ParameterSpec& spec = entry.parameters[i];
        const std::string position = "(entry " + std::to_string(i + 1) + ") ";
        if (isBlank(spec.name)) refuse(position + "has a parameter without a name");
        const std::string self = position + "declares " + quoted(spec.name) + " ";
        if (std::strcmp(spec.name, "plugin") == 0) refuse(self + ", the key that names the plugin itself");
        if (spec.unit == nullptr || spec.help == nullptr)
            refuse(self + "without a " + (spec.unit == nullptr ? "unit" : "help text") + " (write \"\" for none)");
        if (spec.type > ParameterType::Rows)
            refuse(self + "with the unknown type " + std::to_string(static_cast<std::uint32_t>(spec.type)));
        if (spec.type == ParameterType::Choice && isBlank(spec.choices))
            refuse(self + "as a choice without any choices");
        if (std::isnan(spec.min) || std::isnan(spec.max) || spec.min > spec.max)
            refuse(self + "with the empty range " + spec.range().text());
        if (spec.minCount < 0 || spec.minCount > spec.maxCount)
            refuse(self + "with room for " + std::to_string(spec.minCount) + " to " + std::to_string(spec.maxCount) +
                   " numbers");
        for (std::uint64_t k = 0; k < i; ++k)
            if (std::strcmp(spec.name, entry.parameters[k].name) == 0)
                refuse("declares " + quoted(spec.name) + " twice (entries " + std::to_string(k + 1) + " and " +
                       std::to_string(i + 1) + ")");
    }
}

void checkTable(const PluginLibrary* library) {
    const std::string rebuild = "Build it again with the headers of this viable";
    if (library == nullptr)
        throw Refusal{std::string(kPluginSymbol) + "() returned no table", "Use VIABLE_PLUGIN() to export the plugin"};
    // Field by field in this order: what stands behind a field may only be read once it is right.
    if (library->magic != kPluginMagic)
        throw Refusal{
            detail::format("its table does not begin with viable's magic number (%016llx instead of %016llx): "
                           "it is not a viable plugin, or one of another generation",
                           static_cast<unsigned long long>(library->magic),
                           static_cast<unsigned long long>(kPluginMagic)),
            rebuild};
    // The version stands in the same place in every version; all behind it may have moved.
    constexpr std::size_t kVersionEnd = offsetof(PluginLibrary, stamp) + sizeof(std::uint32_t);
    const auto compare = [&](const std::string& what, std::uint64_t theirs, const char* unit, std::uint64_t ours) {
        if (theirs != ours)
            throw Refusal{what + " " + std::to_string(theirs) + unit + ", viable's " + std::to_string(ours), rebuild};
    };
    if (library->size >= kVersionEnd)
        compare("its plugin interface version is", library->stamp.interfaceVersion, "", kPluginInterfaceVersion);
    compare("its table has", library->size, " bytes", sizeof(PluginLibrary));
    const std::vector<std::string> differences = describeDifferences(library->stamp, makeAbiStamp());
    if (!differences.empty()) throw Refusal{join(differences, "; "), ""};
    compare("an entry of its table has", library->entrySize, " bytes", sizeof(PluginEntry));
    if (library->entries == nullptr || library->entryCount == 0)
        throw Refusal{"its table has no entries", "Use VIABLE_PLUGIN() to export the plugin"};
    if (library->entryCount > kMaxEntries)
        throw Refusal{"its table says that it has " + std::to_string(library->entryCount) + " entries (at most " +
                          std::to_string(kMaxEntries) + ")",
                      rebuild};
    for (std::uint32_t i = 0; i < library->entryCount; ++i) {
        const PluginEntry& entry = library->entries[i];
        const std::string self = "entry " + std::to_string(i + 1) + " of its table ";
        const std::string remedy = "Use VIABLE_PLUGIN() to export the plugin";
        if (entry.kind > PluginKind::RealPlant)
            throw Refusal{self + "is of the unknown kind " + std::to_string(static_cast<std::uint32_t>(entry.kind)),
                          remedy};
        if (isBlank(entry.name)) throw Refusal{self + "has no name", remedy};
        if (entry.summary == nullptr) throw Refusal{self + "(" + quoted(entry.name) + ") has no summary", remedy};
        if (entry.create == nullptr || entry.destroy == nullptr)
            throw Refusal{self + "(" + quoted(entry.name) + ") has no " +
                              (entry.create == nullptr ? "create" : "destroy") + " function",
                          remedy};
    }
}

using TableFunction = const PluginLibrary* (*)();

/** Runs code of the library; whatever it throws becomes a Refusal that begins with `what`. */
template <class Work>
void runForeign(const std::string& what, std::string remedy, const Work& work) {
    const std::string thrown = describeThrow([&] {
        try {
            work();
        } catch (const Error&) {  // its words end with a remedy of their own
            remedy.clear();
            throw;
        }
    });
    if (!thrown.empty()) throw Refusal{what + " " + thrown, remedy};
}

/** The library's checked table. Until the stamp is known to be equal its code hands over plain data only. */
const PluginLibrary* openTable(TableFunction getTable, const std::string& file) {
    const PluginLibrary* library = nullptr;
    runForeign(std::string(kPluginSymbol) + "()", "Use VIABLE_PLUGIN() to export the plugin",
               [&] { library = getTable(); });
    checkTable(library);
    static std::mutex opening;
    static std::map<const PluginLibrary*, std::optional<Refusal>> opened;  // why it was refused
    const std::lock_guard<std::mutex> lock(opening);
    const auto [known, isNew] = opened.try_emplace(library);
    if (isNew && library->open) try {
            runForeign("the function that describes its options and adds its kinds of limits",
                       "Leave only describe() and addLimit() there, and let them throw nothing",
                       [&] { detail::addLimitsOf(file, library->open); });
        } catch (const Refusal& refusal) {
            known->second = refusal;
        }
    if (known->second) throw *known->second;
    for (std::uint32_t i = 0; i < library->entryCount; ++i) checkParameters(library->entries[i]);
    return library;
}

// --- Loading ------------------------------------------------------------------------------------

/** What the start-up code of a library changed. */
struct LoadChange {
    std::string arithmetic;  ///< such a library is refused
    std::string process;     ///< of what the whole program shares (see ProcessGuard)
};

/** What is known of a library, with what is not empty in `more`. Libraries stay in the process, so that their start-up code
does not run again when somebody asks for them a second time: only this memory tells it then. */
LoadChange updLoadChange(const std::string& library, const LoadChange& more = {}) {
    static std::mutex changing;
    static std::map<std::string, LoadChange> changes;
    const std::lock_guard<std::mutex> lock(changing);
    LoadChange& known = changes[library];
    if (!more.arithmetic.empty()) known.arithmetic = more.arithmetic;
    if (!more.process.empty()) known.process = more.process;
    return known;
}

/** Refuses a library that needs a sanitizer's runtime which this program has not: that runtime would end the program
before the stamp could be read. */
void checkSanitizer(const fs::path& file) {
    struct Runtime {
        std::uint32_t bit;
        const char *symbol, *name;
    };
    constexpr Runtime kRuntimes[] = {{1u, "__asan_init", "AddressSanitizer"}, {2u, "__tsan_init", "ThreadSanitizer"}};
    std::ifstream stream(file, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
    for (const Runtime& runtime : kRuntimes)
        if (!(makeAbiStamp().sanitizer & runtime.bit) &&
            bytes.find(std::string(runtime.symbol) + '\0') != std::string::npos)
            throw Refusal{std::string("it is built with ") + runtime.name + ", this viable is not",
                          "Build it without -fsanitize, or build viable with it, too"};
}

/** @param text  of the dynamic linker, which loaded nothing */
[[noreturn]] void refuseUnlinked(const std::string& text) {
    constexpr char kUndefined[] = "undefined symbol: ";
    const std::size_t at = text.find(kUndefined);
    if (at == std::string::npos) throw Refusal{"the dynamic linker says: " + text, ""};
    const std::size_t begin = at + sizeof kUndefined - 1;
    const std::string symbol = text.substr(begin, text.find_first_of(" \t,", begin) - begin);
    int status = 0;
    const std::unique_ptr<char, void (*)(void*)> demangled(
        abi::__cxa_demangle(symbol.c_str(), nullptr, nullptr, &status), std::free);
    // What a plugin of another interface version asks for may not exist any more; its table cannot be seen then.
    if (status == 0 && startsWith(demangled.get(), "viable::"))
        throw Refusal{"it was built for another viable: this one, of plugin interface version " +
                          std::to_string(kPluginInterfaceVersion) + ", has no " + demangled.get(),
                      "Build it again with the headers of this viable"};
    throw Refusal{
        "the dynamic linker says: " + text,
        "Link the plugin to the library that defines this symbol, or build it again with the headers of this viable"};
}

void* openLibrary(const fs::path& file, int more = 0) {
    return dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE | more);
}

/** Opens the library in a process of its own. Throws Error when that one does not come back from its start-up code. */
void tryLibrary(const fs::path& file, double timeout_s) {
    if (openLibrary(file, RTLD_NOLOAD)) return;  // it is open: its start-up code has run
    constexpr struct timespec kLook { 0, 1'000'000 };
    const auto hasOpened = detail::makeSharedObject<std::atomic<bool>>();
    const auto begin = std::chrono::steady_clock::now();
    const pid_t child = detail::forkChild("to open a plugin library");
    if (child == 0) {
        for (const int signal : detail::kCrashSignals) std::signal(signal, SIG_DFL);  // this process tells of it
        try {
            void* const handle = openLibrary(file);  // what the linker refuses is told below
            if (void* const symbol = handle ? dlsym(handle, kPluginSymbol) : nullptr)
                openTable(reinterpret_cast<TableFunction>(symbol), file);
        } catch (...) {  // likewise
        }
        *hasOpened = true;
        _exit(0);
    }
    std::string lost;
    for (int status = 0; lost.empty();) {
        const pid_t ended = waitpid(child, &status, WNOHANG);
        if (ended == child && *hasOpened) return;
        if (ended == child)
            lost = detail::describeEnd(status);
        else if (std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() >= timeout_s)
            lost = detail::endOverdue(child, timeout_s);
        else
            nanosleep(&kLook, nullptr);
    }
    throw Error(ErrorKind::PluginFailed, nameLibrary(file), "failed while it was loaded: " + lost,
                "Fix its static objects, describe() and the function of its limits: `gdb --args viable run ...` "
                "without --isolate shows the line.");
}

/** Loads the file (canonical path) and returns its checked table; throws Refusal. */
const PluginLibrary* loadTable(const fs::path& file, double trial_s) {
    checkRights(file);
    checkElf(file);
    checkSanitizer(file);
    if (trial_s > 0.0) tryLibrary(file, trial_s);

    std::string change = updLoadChange(file).arithmetic;
    std::string failure;
    std::optional<Refusal> refusal;
    void* handle = nullptr;
    const PluginLibrary* library = nullptr;
    {
        FloatingPointGuard guard;
        ProcessGuard processGuard;
        PluginWatch watch(nameLibrary(file));
        const PluginCall call(&watch, kLoading);  // its static objects are its first code
        handle = openLibrary(file);
        if (handle) addLoadedLibrary(file);
        if (handle == nullptr) {
            const char* text = dlerror();
            failure = text ? text : "no reason given";
        } else if (void* symbol = dlsym(handle, kPluginSymbol)) {
            try {
                library = openTable(reinterpret_cast<TableFunction>(symbol), file);
            } catch (const Refusal& found) {
                refusal = found;
            }
        } else {
            refusal = {std::string("it has no function ") + kPluginSymbol + "(), so it is not a viable plugin",
                       "Add VIABLE_PLUGIN(...) to one of its source files"};
        }
        if (change.empty()) change = guard.describeChange();
        updLoadChange(file, {change, processGuard.undo()});
    }
    if (handle == nullptr) refuseUnlinked(failure);
    if (!change.empty())
        throw Refusal{
            "it changed the floating point arithmetic of the whole thread when it was loaded (" + change +
                "; set back)",
            "Compile and link it without -ffast-math and -Ofast, and change no floating point mode in static objects"};
    if (refusal) throw *refusal;
    return library;
}

/** @param path  as found, its file name is the guarantee that the table must keep */
PluginInfo load(const fs::path& path, std::optional<PluginKind> wanted, double trial_s) {
    const std::optional<LibraryName> guaranteed = parseFileName(path.filename());
    const fs::path expected = "viable_<kind>_<name>.so";
    std::error_code error;
    const fs::path file = fs::canonical(path, error);
    if (error) throw Refusal{error.message(), "Check the path for typing errors and dangling links"};
    if (!fs::is_directory(file) && !guaranteed)
        throw Refusal{"its file name is not " + expected.string() +
                          " with the kind command, controller, filter, robust_loop or plant",
                      "Where it is a plugin, rename the file to what it is; `viable plugins` lists those there are"};
    if (wanted && guaranteed && guaranteed->kind != *wanted)
        throw Refusal{std::string("a ") + getName(*wanted) + " is asked for and this is a " + getName(guaranteed->kind),
                      "Name a library viable_" + std::string(getName(*wanted)) + "_<name>.so"};
    const PluginLibrary* library = loadTable(file, trial_s);
    std::vector<std::string> contents;
    for (std::uint32_t i = 0; i < library->entryCount; ++i) {
        const PluginEntry& entry = library->entries[i];
        if (entry.kind == guaranteed->kind && guaranteed->name == entry.name)
            return {entry.kind, entry.name, entry.summary, file, &entry};
        contents.push_back(std::string(getName(entry.kind)) + " " + quoted(entry.name));
    }
    throw Refusal{"by its file name it is the " + std::string(getName(guaranteed->kind)) + " " +
                      quoted(guaranteed->name) + ", by its table the " + join(contents, " and the "),
                  "Rename the file to " + makeFileName(library->entries[0].kind, library->entries[0].name)};
}

Error makeError(const std::string& where, const fs::path& library, const Refusal& refusal) {
    return badInput(where, "the plugin library " + library.string() + " cannot be used: " + refusal.what,
                    refusal.remedy);
}

std::string describeDuplicate(PluginKind kind, const std::string& name, const fs::path& first, const fs::path& second) {
    return std::string("there are two libraries for the ") + getName(kind) + " " + quoted(name) + ": " +
           first.string() + " and " + second.string();
}
const char* const kDuplicateRemedy = "Remove one of them, or take one folder out of VIABLE_PLUGIN_PATH";

/** The libraries of one folder by their file names; a folder that cannot be read is empty. */
std::vector<fs::path> listFolder(const fs::path& folder) {
    std::vector<fs::path> files;
    std::error_code error;
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
        const std::string name = it->path().filename();
        if (startsWith(name, "viable_") && endsWith(name, ".so")) files.push_back(it->path());
    }
    std::sort(files.begin(), files.end());
    return files;
}

/** Something of that name lies there, even a dangling link or a folder. */
bool isThere(const fs::path& file) {
    std::error_code error;
    return fs::exists(fs::symlink_status(file, error));
}

bool isSameFile(const fs::path& a, const fs::path& b) {
    std::error_code error;
    return fs::equivalent(a, b, error) && !error;
}

Error makeMiss(PluginKind kind, const std::string& request, const std::string& where,
               const std::vector<fs::path>& searchPath) {
    std::vector<std::string> available, elsewhere, tried;
    for (const fs::path& folder : searchPath) {
        tried.push_back((folder / makeFileName(kind, request)).string());
        for (const fs::path& file : listFolder(folder)) {
            const std::optional<LibraryName> found = parseFileName(file.filename());
            if (!found) continue;
            if (found->kind == kind)
                available.push_back(found->name);
            else if (found->name == request)
                elsewhere.push_back(getName(found->kind));
        }
    }
    std::sort(available.begin(), available.end());
    available.erase(std::unique(available.begin(), available.end()), available.end());

    const std::string word = getName(kind);
    std::string what = "there is no " + word + " plugin called " + quoted(request);
    const std::string closest = findClosestName(request, available);
    if (!closest.empty()) what += "; did you mean " + quoted(closest) + "?";
    if (!elsewhere.empty()) what += " (there is a " + elsewhere.front() + " of that name)";
    what += closest.empty() || !elsewhere.empty() ? ". " : " ";
    what += available.empty() ? "No " + word + " plugin was found at all" : "Available: " + join(available, ", ");
    what += ". Tried: " + (tried.empty() ? "no folder" : join(tried, ", "));
    return badInput(
        where, what,
        std::string("Correct the name, give the path of a library, or add its folder to VIABLE_PLUGIN_PATH") +
            (std::getenv("VIABLE_PLUGIN_PATH") ? "" : ", which is not set here"));
}

// --- Classes in Python ---------------------------------------------------------------------------

constexpr char kPythonLibrary[] = "viable_python.so";

bool isIdentifier(const std::string& text) {
    const auto isLetter = [](unsigned char c) { return std::isalpha(c) || c == '_' || c >= 0x80; };
    return !text.empty() && isLetter(static_cast<unsigned char>(text[0])) &&
           std::all_of(text.begin(), text.end(), [&](unsigned char c) { return isLetter(c) || std::isdigit(c); });
}

/** A wheel has a library for each version of Python, linked to no libpython: here is the name of that for the libpython which the
package tells (make_environment() of viable/_paths.py), and which it finds from now on. Empty where none is told. */
std::string openPython(const std::string& where) {
    const char* const given = std::getenv("VIABLE_LIBPYTHON");
    if (!given || !*given) return "";
    if (!dlopen(given, RTLD_NOW | RTLD_GLOBAL))
        throw badInput(where, std::string("VIABLE_LIBPYTHON: ") + dlerror(), "Unset it, or name a libpython");
    const std::string name = fs::path(given).filename();  // libpython3.12.so.1.0
    return "viable_" + name.substr(std::min<std::size_t>(3, name.size()), name.find(".so") - 3) + ".so";
}

/** The library that runs classes in Python. It stands beside the folders of plugins, not in one: it is none itself. */
fs::path findPythonLibrary(const std::string& where, const std::vector<fs::path>& searchPath) {
    std::vector<std::string> tried;
    const auto look = [&](const std::string& name) {
        for (const fs::path& folder : searchPath) {
            const fs::path candidate = (folder.has_filename() ? folder : folder.parent_path()).parent_path() / name;
            std::error_code error;
            if (fs::is_regular_file(candidate, error)) return fs::canonical(candidate);
            tried.push_back(candidate.string());
        }
        return fs::path();
    };
    fs::path library = look(kPythonLibrary);
    if (const std::string name = library.empty() ? openPython(where) : ""; !name.empty()) library = look(name);
    if (!library.empty()) return library;
    throw badInput(
        where,
        std::string("a plugin in Python needs ") + kPythonLibrary + ", which is not there. Tried: " + join(tried, ", "),
        "Install the Debian package python3-viable (apt-get install ./python3-viable_*.deb), or, where viable is "
        "built, python3-dev and pybind11-dev, and build the target viable_python. Of a wheel: Python needs its shared "
        "library (apt-get install libpython3.N); where VIABLE_PYTHON is set, name it in VIABLE_LIBPYTHON");
}

PluginInfo findPython(PluginKind kind, const std::string& request, const std::string& where, const fs::path& folder,
                      const std::vector<fs::path>& searchPath, double trial_s) {
    const std::string word = getName(kind);
    if (kind == PluginKind::RobustLoop || kind == PluginKind::RealPlant)
        throw badInput(where, "a " + word + " cannot be a class in Python; commands, controllers and filters can",
                       "Write it in C++: viable new " + word + " NAME");
    const std::size_t colon = request.rfind(".py:");
    const std::string name = colon == std::string::npos ? std::string() : request.substr(colon + 4);
    if (!isIdentifier(name))
        throw badInput(where, quoted(request) + " names no class", "Write the file and its class: my_law.py:MyLaw");
    const fs::path file = fs::absolute(folder / request.substr(0, colon + 3)).lexically_normal();
    std::error_code error;
    if (!fs::is_regular_file(file, error))
        throw badInput(where, "there is no Python file " + file.string(),
                       "Correct the path: it is relative to the folder of the file that names it");
    try {
        checkRights(file);
    } catch (const Refusal& refusal) {
        throw badInput(where, "the Python file " + file.string() + " cannot be used: " + refusal.what, refusal.remedy);
    }
    const fs::path library = findPythonLibrary(where, searchPath);
    try {
        const PluginLibrary* const table = loadTable(library, trial_s);
        for (std::uint32_t i = 0; i < table->entryCount; ++i)
            if (table->entries[i].kind == kind)
                return {kind, name, table->entries[i].summary, file, &table->entries[i]};
        throw Refusal{"it has no entry for a " + word, "Build it again"};
    } catch (const Refusal& refusal) {
        throw makeError(where, library, refusal);
    }
}

}  // namespace

std::string findLoadChange(const fs::path& library) {
    return updLoadChange(library).process;
}

const char* getName(PluginKind kind) {
    return detail::enumName<PluginKind::RealPlant>(kind, {"command", "controller", "filter", "robust_loop", "plant"});
}

PluginLoader::PluginLoader(std::vector<fs::path> searchPath, double trial_s)
    : searchPath_(std::move(searchPath)), trial_s_(trial_s) {
    // Absolute from the start: a later change of the current folder must not change what is loaded.
    for (fs::path& folder : searchPath_) folder = fs::absolute(folder).lexically_normal();
}

std::vector<fs::path> PluginLoader::makeDefaultSearchPath() {
    std::vector<fs::path> folders;
    const auto add = [&](const fs::path& folder) {
        const fs::path clean = folder.lexically_normal();
        if (std::find(folders.begin(), folders.end(), clean) == folders.end()) folders.push_back(clean);
    };
    if (const char* variable = std::getenv("VIABLE_PLUGIN_PATH")) {
        const std::string text = variable;
        for (std::size_t begin = 0; begin <= text.size();) {
            const std::size_t end = std::min(text.find(':', begin), text.size());
            const std::string entry = text.substr(begin, end - begin);
            begin = end + 1;
            if (entry.empty()) continue;  // "a::b" and a colon at the end are habits, no folders
            if (!fs::path(entry).is_absolute())
                throw badInput("VIABLE_PLUGIN_PATH", "the entry " + quoted(entry) + " is not an absolute path",
                               "Write it from the root (" + fs::absolute(entry).string() +
                                   "?): which libraries run must not depend on the current folder");
            add(entry);
        }
    }
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    if (!error) {
        const fs::path folder = program.parent_path();
        add(folder / "plugins");
        add(folder / ".." / VIABLE_INSTALL_LIBDIR / "viable" / "plugins");
        add(folder / ".." / "lib" / "viable" / "plugins");
    }
    return folders;
}

PluginInfo PluginLoader::find(PluginKind kind, const std::string& request, const std::string& where,
                              const fs::path& folder) const {
    if (request.empty())
        throw badInput(where, std::string("the name of the ") + getName(kind) + " plugin is empty",
                       "Write its name or the path of its library");
    // FILE.py:CLASS, or FILE.py, which lacks its class.
    if (request.find(".py:") != std::string::npos || endsWith(request, ".py"))
        return findPython(kind, request, where, folder, searchPath_, trial_s_);

    fs::path library;
    if (request.find('/') != std::string::npos || endsWith(request, ".so")) {
        library = fs::absolute(folder / request).lexically_normal();
    } else {
        for (const fs::path& place : searchPath_) {
            const fs::path candidate = place / makeFileName(kind, request);
            if (!isThere(candidate)) continue;
            if (library.empty())
                library = candidate;
            else if (!isSameFile(library, candidate))
                throw badInput(where, describeDuplicate(kind, request, library, candidate), kDuplicateRemedy);
        }
        if (library.empty()) throw makeMiss(kind, request, where, searchPath_);
    }
    try {
        return load(library, kind, trial_s_);
    } catch (const Refusal& refusal) {
        throw makeError(where, library, refusal);
    }
}

std::vector<PluginInfo> PluginLoader::list(std::vector<RefusedLibrary>& refused) const {
    std::map<std::pair<PluginKind, std::string>, std::vector<fs::path>> byName;
    const auto refuse = [&](const fs::path& library, const Refusal& refusal) {
        refused.push_back({library, refusal.remedy.empty() ? refusal.what : refusal.what + ". " + refusal.remedy});
    };
    for (const fs::path& folder : searchPath_) {
        for (const fs::path& file : listFolder(folder)) {
            const std::optional<LibraryName> name = parseFileName(file.filename());
            if (!name) {
                refuse(file, {"its file name is not viable_<kind>_<name>.so",
                              "Where it is a plugin, rename the file to what it is"});
                continue;
            }
            std::vector<fs::path>& files = byName[{name->kind, name->name}];
            if (std::none_of(files.begin(), files.end(),
                             [&](const fs::path& other) { return isSameFile(file, other); }))
                files.push_back(file);
        }
    }

    std::vector<PluginInfo> infos;
    for (const auto& [key, files] : byName) {
        if (files.size() > 1) {
            for (std::size_t i = 0; i < files.size(); ++i)
                refuse(files[i],
                       {describeDuplicate(key.first, key.second, files[i], files[i == 0 ? 1 : 0]), kDuplicateRemedy});
            continue;
        }
        try {
            infos.push_back(load(files.front(), key.first, trial_s_));
        } catch (const Refusal& refusal) {
            refuse(files.front(), refusal);
        } catch (const Error& e) {
            refuse(files.front(), {e.what(), ""});
        }
    }
    return infos;  // sorted by kind and name, because the map is
}

void* PluginLoader::createObject(const PluginInfo& info) {
    // The text is copied out of the library's reach at once, whatever becomes of the exception.
    char message[kMessageSize] = "";
    std::string failure;
    void* object = nullptr;
    std::string change;
    {
        FloatingPointGuard guard;
        PluginWatch watch(info);
        const PluginCall call(&watch, kMaking);
        const std::string thrown = describeThrow([&] { object = info.entry->create(message, sizeof message); });
        if (!thrown.empty()) failure = "its create function " + thrown;
        change = guard.describeChange();
    }
    if (object == nullptr) {
        message[sizeof message - 1] = '\0';
        if (failure.empty()) failure = *message ? message : "it gives no reason";
        throw Error(
            ErrorKind::PluginFailed, info.library.string(),
            std::string("the ") + getName(info.kind) + " " + quoted(info.name) + " could not be made: " + failure);
    }
    if (!change.empty()) {
        info.entry->destroy(object);
        throw Error(ErrorKind::PluginFailed, info.library.string(),
                    std::string("the ") + getName(info.kind) + " " + quoted(info.name) +
                        " changed the floating point arithmetic of the whole thread when it was made (" + change +
                        "; set back)",
                    "Compile and link it without -ffast-math and -Ofast");
    }
    return object;
}

}  // namespace viable
