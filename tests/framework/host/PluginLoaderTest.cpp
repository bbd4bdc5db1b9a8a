#include "Paths.h"

#include <dlfcn.h>
#include <elf.h>
#include <signal.h>

#include <cfenv>
#include <locale>
#include <typeinfo>

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "core/Text.h"
#include "host/PluginCall.h"
#include "host/ProcessGuard.h"

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace viable::test {
namespace {

namespace fs = std::filesystem;

const fs::path kBroken = VIABLE_BROKEN_PLUGIN_DIR;
const std::string kWhere = "demo.yaml:7:11: filter.plugin";

/** An environment variable with another value until the end of the scope. */
class ScopedVariable {
public:
    ScopedVariable(const char* name, const std::string& value) : name_(name) {
        if (const char* old = std::getenv(name)) old_ = old;
        setenv(name, value.c_str(), 1);
    }
    ~ScopedVariable() {
        if (old_)
            setenv(name_, old_->c_str(), 1);
        else
            unsetenv(name_);
    }

private:
    const char* name_;
    std::optional<std::string> old_;
};

void writeBytes(const fs::path& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary).write(bytes.data(), std::streamsize(bytes.size()));
}

/** The message with which the loader refuses, or "(accepted)". */
std::string findMessage(const PluginLoader& loader, const std::string& request,
                        PluginKind kind = PluginKind::SafetyFilter) {
    try {
        loader.find(kind, request, kWhere, {});
    } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::BadInput);
        EXPECT_EQ(std::string(error.what()).rfind(kWhere + ": ", 0), 0u)
            << "does not begin with who asks: " << error.what();
        return error.what();
    }
    return "(accepted)";
}

std::string findBroken(const std::string& name) {
    return findMessage(PluginLoader({kBroken}), name);
}

std::string makeMessage(const std::string& name) {
    const PluginInfo info = PluginLoader({kBroken}).find(PluginKind::SafetyFilter, name, kWhere, {});
    try {
        PluginLoader::create<SafetyFilter>(info);
    } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::PluginFailed);
        EXPECT_EQ(error.exitCode(), 4);
        return error.what();
    }
    return "(made)";
}

// --- Classes in Python --------------------------------------------------------------------------

TEST(PluginLoader, AClassInPythonIsAFileAndAClass) {
    const TemporaryFolder folder;
    const std::string law = folder.write("law.py", "class Law: pass\n");
    const PluginLoader loader({kBroken});
    EXPECT_CONTAINS(findMessage(loader, law), "names no class. Write the file and its class: my_law.py:MyLaw");
    EXPECT_CONTAINS(findMessage(loader, law + ":"), "names no class");
    EXPECT_CONTAINS(findMessage(loader, law + ":1x"), "names no class");
    EXPECT_CONTAINS(findMessage(loader, "no/such/law.py:Law"), "there is no Python file");
    EXPECT_CONTAINS(findMessage(loader, law + ":Law", PluginKind::RobustLoop),
                    "a robust_loop cannot be a class in Python; commands, controllers and filters can. Write it in "
                    "C++: viable new robust_loop NAME");
    EXPECT_CONTAINS(findMessage(loader, law + ":Law", PluginKind::RealPlant), "a plant cannot be a class in Python");
}

TEST(PluginLoader, WithoutPythonTheRemedyIsNamed) {
    const TemporaryFolder folder;
    const fs::path law = folder.write("law.py", "class Law: pass\n");
    const fs::path bin = law.parent_path() / "bin";
    expectContains(findMessage(PluginLoader({bin / "plugins"}), law.string() + ":Law"),
                   {(bin / "viable_python.so").string(), "Install the Debian package python3-viable"});
}

TEST(PluginLoader, APythonFileThatAnybodyMayChangeIsRefused) {
    const TemporaryFolder folder;
    const fs::path law = folder.write("law.py", "class Law: pass\n");
    fs::permissions(law, fs::perms::others_write, fs::perm_options::add);
    expectContains(findMessage(PluginLoader({kBroken}), law.string() + ":Law"),
                   {"every user of this machine may write to it", "chmod o-w"});
}

// --- The good case ------------------------------------------------------------------------------

TEST(PluginLoader, KindsAreTheWordsOfFileNames) {
    EXPECT_STREQ(getName(PluginKind::CommandSource), "command");
    EXPECT_STREQ(getName(PluginKind::NominalController), "controller");
    EXPECT_STREQ(getName(PluginKind::SafetyFilter), "filter");
    EXPECT_STREQ(getName(PluginKind::RobustLoop), "robust_loop");
    EXPECT_STREQ(getName(PluginKind::RealPlant), "plant");
}

TEST(PluginLoader, FindsByNameAndMakesAWorkingPlugin) {
    const PluginInfo info = PluginLoader({kBroken}).find(PluginKind::SafetyFilter, "liar", kWhere, {});
    EXPECT_EQ(info.kind, PluginKind::SafetyFilter);
    EXPECT_EQ(info.name, "liar");
    EXPECT_EQ(info.summary, "Guarantees every limit and keeps none.");
    EXPECT_EQ(info.library, fs::canonical(kBroken / "viable_filter_liar.so"));
    const PluginPtr<SafetyFilter> filter = PluginLoader::create<SafetyFilter>(info);
    EXPECT_TRUE(filter->traits().guarantees.hasJoints());

    // The object works: M = 2, b = 1 gives (5 - 1) / 2 = 2 rad/s^2.
    RobotDescription robot;
    robot.joints.resize(1);
    RunSetup setup{robot, JointLimits::unlimited(1), 0.001, 1.0, {}, {}};
    const JointVector zero = JointVector::Zero(1);
    setup.start = {zero, zero, zero};
    filter->configure(setup, Parameters());
    filter->reset(setup.start);
    Dynamics dynamics;
    dynamics.M = JointMatrix::Constant(1, 1, 2.0);
    dynamics.b = JointVector::Constant(1, 1.0);
    FilterDecision decision;
    EXPECT_EQ(filter->filter({setup.start, JointVector::Constant(1, 5.0), dynamics}, decision), FilterStatus::Passed);
    EXPECT_EQ(decision.held, HeldQuantity::Acceleration);
    EXPECT_DOUBLE_EQ(decision.value[0], 2.0);
}

TEST(PluginLoader, FindsByPathRelativeToTheFolderOfTheFileThatAsks) {
    const PluginLoader nowhere({});
    const std::string file = "viable_filter_liar.so";
    for (const std::string& request :
         {file, "./" + file, "../" + kBroken.filename().string() + "/" + file, (kBroken / file).string()}) {
        EXPECT_EQ(nowhere.find(PluginKind::SafetyFilter, request, kWhere, kBroken).library,
                  fs::canonical(kBroken / file))
            << request;
    }
    EXPECT_EQ(nowhere.find(PluginKind::SafetyFilter, "second/viable_filter_twin.so", kWhere, kBroken).library,
              fs::canonical(kBroken / "second" / "viable_filter_twin.so"));
}

TEST(PluginLoader, ListsWhatIsThereAndSaysWhatWasRefused) {
    std::vector<RefusedLibrary> refused;
    const std::vector<PluginInfo> infos = PluginLoader({kBroken}).list(refused);
    std::vector<std::string> names;
    for (const PluginInfo& info : infos) names.push_back(std::string(getName(info.kind)) + " " + info.name);
    EXPECT_EQ(detail::join(names),
              "command changing_limits, command jumping_setpoint, command silent_command, command witness, "
              "controller extreme_torque, controller nan_torque, controller wrong_size_torque, filter aborts, "
              "filter allocates, filter calls_exit, filter changes_process_when_configured, "
              "filter changes_process_when_loaded, filter changes_process_when_made, filter changes_rounding, "
              "filter constructor_throws, filter constructor_throws_int, filter crashes_when_destroyed, "
              "filter create_throws, filter create_throws_int, filter damages_heap, filter guaranteeing, filter hangs, "
              "filter hangs_before_ticks, filter leaks, filter liar, filter misbehaves, filter nan_output, "
              "filter null_create, filter overflows_stack, filter rewrites, filter rounds_in_configure, "
              "filter rounds_in_tick, filter same_class_one, filter same_class_two, filter segfaults, "
              "filter silent_create, filter throwing_tick, filter throws_in_reset, filter throws_in_thread, "
              "filter throws_when_asked, filter upright, filter wrong_size, robust_loop throwing_robust, "
              "plant failing_plant, plant pushed");

    std::map<std::string, std::string> reasons;
    for (const RefusedLibrary& library : refused) reasons[library.library.filename()] = library.reason;
    EXPECT_EQ(refused.size(), reasons.size());
    EXPECT_CONTAINS(reasons["viable_filter_other_ndebug.so"], "NDEBUG");
    EXPECT_CONTAINS(reasons["viable_filter_no_symbol.so"], "viable_plugin_library");
    EXPECT_CONTAINS(reasons["viable_filter_flushes_to_zero.so"], "floating point");
    std::size_t libraries = 0;
    for (const fs::directory_entry& entry : fs::directory_iterator(kBroken))
        libraries += entry.path().extension() == ".so" ? 1 : 0;
    EXPECT_EQ(infos.size() + refused.size(), libraries);
}

// --- Where plugins are looked for ---------------------------------------------------------------

TEST(PluginLoader, DefaultSearchPathIsVariableThenProgramThenInstallFolder) {
    const ScopedVariable variable("VIABLE_PLUGIN_PATH", "/first/place::/second/place/:");
    const std::vector<fs::path> path = PluginLoader::makeDefaultSearchPath();
    const fs::path program = fs::canonical("/proc/self/exe").parent_path();
    ASSERT_GE(path.size(), 4u);
    EXPECT_EQ(path[0], "/first/place");
    EXPECT_EQ(path[1], "/second/place/");
    EXPECT_EQ(path[2], program / "plugins");
    EXPECT_EQ(path.back(), program.parent_path() / "lib" / "viable" / "plugins");
    for (const fs::path& folder : path) EXPECT_TRUE(folder.is_absolute()) << folder;
    for (std::size_t i = 3; i < path.size(); ++i)
        expectContains(path[i].string(), {(program.parent_path() / "lib").string(), "/viable/plugins"});
}

TEST(PluginLoader, Fault52_RelativeEntryOfTheSearchPathIsRefused) {
    for (const char* entry : {"plugins", "./plugins", "../plugins", "."}) {
        const ScopedVariable variable("VIABLE_PLUGIN_PATH", std::string("/first:") + entry);
        EXPECT_CONTAINS(catchError([&] { PluginLoader::makeDefaultSearchPath(); }),
                        std::string("VIABLE_PLUGIN_PATH: the entry '") + entry + "' is not an absolute path");
    }
}

TEST(PluginLoader, Fault52_CurrentFolderIsNeverSearched) {
    // A library beside the user's files must not be run because its name fits.
    const TemporaryFolder folder;
    fs::copy_file(kBroken / "viable_filter_liar.so", folder.path() / "viable_filter_liar.so");
    const fs::path before = fs::current_path();
    fs::current_path(folder.path());
    const std::string message = findMessage(PluginLoader({"/nowhere"}), "liar");
    fs::current_path(before);
    EXPECT_CONTAINS(message, "there is no filter plugin called 'liar'");
}

TEST(PluginLoader, Fault52_WhatEverybodyMayWriteToIsRefused) {
    const TemporaryFolder folder;
    const fs::path library = folder.path() / "viable_filter_liar.so";
    fs::copy_file(kBroken / "viable_filter_liar.so", library);
    const PluginLoader loader({folder.path()});
    EXPECT_EQ(findMessage(loader, "liar"), "(accepted)");
    fs::permissions(folder.path(), fs::perms(0777));
    EXPECT_CONTAINS(findMessage(loader, "liar"),
                    "the plugin library " + library.string() +
                        " cannot be used: every user of this machine may write to its folder " +
                        folder.path().string() + ", so nobody knows whose code it is. Copy it to a folder");
    EXPECT_CONTAINS(findMessage(PluginLoader({}), library.string()), "may write to its folder");
    fs::permissions(folder.path(), fs::perms(01777));  // as /tmp: only its owner can change a file there
    EXPECT_EQ(findMessage(loader, "liar"), "(accepted)");
    fs::permissions(folder.path(), fs::perms(0755));
    fs::permissions(library, fs::perms(0666));
    EXPECT_CONTAINS(findMessage(loader, "liar"),
                    "every user of this machine may write to it, so nobody knows whose "
                    "code it is. If it is yours: chmod o-w " +
                        library.string());
    std::vector<RefusedLibrary> refused;
    EXPECT_TRUE(loader.list(refused).empty());
    ASSERT_EQ(refused.size(), 1u);
}

TEST(PluginLoader, Fault48_ATrialFindsWhatDoesNotSurviveBeingLoaded) {
    const fs::path deadly = fs::canonical(kBroken / "deadly");
    const auto expectLost = [&](const std::string& name, double trial_s, const std::string& how) {
        EXPECT_CONTAINS(
            catchError([&] { PluginLoader({deadly}, trial_s).find(PluginKind::SafetyFilter, name, kWhere, {}); },
                       ErrorKind::PluginFailed),
            "the plugin library '" + deadly.string() + "/viable_filter_" + name +
                ".so': failed while it was loaded: " + how + ". Fix its static");
    };
    expectLost("crashes_on_load", 30.0, "its process died: signal 6 (Aborted)");
    expectLost("exits_on_load", 30.0, "its process ended: it called exit(0)");
    expectLost("hangs_on_load", 0.2, "it did not return for 0.2 s; its process was ended");
    std::vector<RefusedLibrary> refused;
    EXPECT_TRUE(PluginLoader({deadly}, 0.2).list(refused).empty());
    EXPECT_EQ(refused.size(), 3u);
    // What is in order is found as ever, and what the linker refuses is told as ever.
    const PluginLoader other({kBroken}, 30.0);
    EXPECT_EQ(findMessage(other, "liar"), "(accepted)");
    EXPECT_EQ(findMessage(other, "unresolved_symbol"), findMessage(PluginLoader({kBroken}), "unresolved_symbol"));
}

TEST(PluginLoader, Fault52_SearchPathDoesNotFollowTheCurrentFolder) {
    const fs::path before = fs::current_path();
    fs::current_path(kBroken.parent_path());
    const PluginLoader loader({kBroken.filename()});
    fs::current_path("/");
    EXPECT_EQ(findMessage(loader, "liar"), "(accepted)");
    fs::current_path(before);
    EXPECT_TRUE(loader.searchPath().front().is_absolute());
}

TEST(PluginLoader, AMissNamesTheClosestAllAvailableAndEveryPathTried) {
    const PluginLoader loader({"/nowhere/at/all", kBroken});
    expectContains(findMessage(loader, "nan_torqe", PluginKind::NominalController),
                   {"there is no controller plugin called 'nan_torqe'", "did you mean 'nan_torque'?",
                    "Available: extreme_torque, nan_torque, wrong_size_torque",
                    "Tried: /nowhere/at/all/viable_controller_nan_torqe.so, " +
                        (kBroken / "viable_controller_nan_torqe.so").string(),
                    "VIABLE_PLUGIN_PATH"});
}

TEST(PluginLoader, AMissSaysWhenTheNameIsOfAnotherKind) {
    expectContains(findMessage(PluginLoader({kBroken}), "nan_torque"),
                   {"there is no filter plugin called 'nan_torque'", "there is a controller of that name"});
}

TEST(PluginLoader, AMissWithoutAnythingAvailableSaysSo) {
    EXPECT_CONTAINS(findMessage(PluginLoader({"/nowhere"}), "tosbp"),
                    "No filter plugin was found at all. Tried: /nowhere/viable_filter_tosbp.so");
    EXPECT_CONTAINS(findMessage(PluginLoader({}), "tosbp"), "Tried: no folder");
    EXPECT_CONTAINS(findMessage(PluginLoader({}), ""), "the name of the filter plugin is empty");
}

TEST(PluginLoader, Fault43_TwoLibrariesOfOneNameAreRefusedAndBothNamed) {
    const PluginLoader loader({kBroken / "first", kBroken / "second"});
    EXPECT_CONTAINS(findMessage(loader, "twin"), "there are two libraries for the filter 'twin': " +
                                                     (kBroken / "first" / "viable_filter_twin.so").string() + " and " +
                                                     (kBroken / "second" / "viable_filter_twin.so").string());
    std::vector<RefusedLibrary> refused;
    EXPECT_TRUE(loader.list(refused).empty());
    ASSERT_EQ(refused.size(), 2u);
    for (const RefusedLibrary& library : refused) expectContains(library.reason, {"/first/", "/second/"});
}

TEST(PluginLoader, Fault43_OneFileReachedTwiceIsNoDuplicate) {
    const TemporaryFolder folder;
    fs::create_directory_symlink(kBroken / "first", folder.path() / "link");
    fs::create_directory(folder.path() / "other");
    fs::create_symlink(kBroken / "first" / "viable_filter_twin.so", folder.path() / "other" / "viable_filter_twin.so");
    const PluginLoader loader(
        {kBroken / "first", folder.path() / "link", folder.path() / "other", kBroken / "second" / ".." / "first"});
    EXPECT_EQ(loader.find(PluginKind::SafetyFilter, "twin", kWhere, {}).library,
              fs::canonical(kBroken / "first" / "viable_filter_twin.so"));
    std::vector<RefusedLibrary> refused;
    EXPECT_EQ(loader.list(refused).size(), 1u);
    EXPECT_TRUE(refused.empty());
}

// --- Files that are no libraries ----------------------------------------------------------------

TEST(PluginLoader, Fault39_MissingFile) {
    EXPECT_CONTAINS(findMessage(PluginLoader({}), "/nowhere/viable_filter_missing.so"),
                    "/nowhere/viable_filter_missing.so cannot be used: No such file or directory");
}

TEST(PluginLoader, Fault39_DanglingLinkIsFoundAndRefused) {
    const TemporaryFolder folder;
    fs::create_symlink("gone.so", folder.path() / "viable_filter_dangling.so");
    EXPECT_CONTAINS(findMessage(PluginLoader({folder.path()}), "dangling"),
                    "viable_filter_dangling.so cannot be used: No such file or directory");
}

TEST(PluginLoader, Fault39_Directory) {
    const TemporaryFolder folder;
    fs::create_directory(folder.path() / "viable_filter_folder.so");
    const PluginLoader loader({folder.path()});
    EXPECT_CONTAINS(findMessage(loader, "folder"), "it is a folder, not a file");
    EXPECT_CONTAINS(findMessage(loader, kBroken.string()), "it is a folder, not a file");
}

TEST(PluginLoader, Fault39_NotElf) {
    const TemporaryFolder folder;
    const PluginLoader loader({folder.path()});
    const fs::path file = folder.path() / "viable_filter_text.so";
    writeBytes(file, "#!/bin/sh\necho this is a linker script, a text, anything but a library\n");
    expectContains(findMessage(loader, "text"),
                   {"it is not a shared library (no ELF file)", "the dynamic linker says: ", "invalid ELF header"});
    writeBytes(file, "abc");
    expectContains(findMessage(loader, "text"), {"the dynamic linker says: ", "file too short"});
    writeBytes(file, "");
    EXPECT_CONTAINS(findMessage(loader, "text"), "it is empty (0 bytes)");
}

TEST(PluginLoader, Fault39_WrongArchitecture) {
    const TemporaryFolder folder;
    const PluginLoader loader({folder.path()});
    const std::string library = readFile(kBroken / "viable_filter_liar.so");
    std::string other = library;
    const char machine = other[18] == EM_S390 ? EM_AARCH64 - 256 : EM_S390;  // e_machine, low byte
    other[18] = machine;
    other[19] = 0;
    writeBytes(folder.path() / "viable_filter_machine.so", other);
    EXPECT_CONTAINS(findMessage(loader, "machine"), "it is built for another processor (ELF machine 22), viable for ");

    other = library;
    other[EI_CLASS] = sizeof(void*) == 8 ? ELFCLASS32 : ELFCLASS64;
    writeBytes(folder.path() / "viable_filter_class.so", other);
    expectContains(findMessage(loader, "class"),
                   {sizeof(void*) == 8 ? "it is built for a 32-bit machine, viable for a 64-bit one"
                                       : "it is built for a 64-bit machine, viable for a 32-bit one",
                    "the dynamic linker says: ", "wrong ELF class"});
}

TEST(PluginLoader, Fault39_TruncatedAnywhere) {
    const TemporaryFolder folder;
    const PluginLoader loader({folder.path()});
    const std::string library = readFile(kBroken / "viable_filter_liar.so");
    ASSERT_GT(library.size(), 4096u);
    std::vector<std::size_t> sizes = {5, 16, 63, 64, 65, 120, 400, 4095, 4096, 4097};
    for (std::size_t percent = 2; percent < 100; percent += 2) sizes.push_back(library.size() * percent / 100);
    sizes.push_back(library.size() - 1);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        const std::string name = "cut_" + std::to_string(i);
        writeBytes(folder.path() / ("viable_filter_" + name + ".so"), library.substr(0, sizes[i]));
        EXPECT_CONTAINS(findMessage(loader, name),
                        "it is cut off: it ends after " + std::to_string(sizes[i]) + " bytes");
    }
    writeBytes(folder.path() / "viable_filter_cut_x.so", library.substr(0, 20));
    EXPECT_CONTAINS(findMessage(loader, "cut_x"), "file too short");
}

TEST(PluginLoader, Fault39_UnreadableHeaderFieldsDoNotCrash) {
    // Each byte of the ELF header set to extreme values: refused or harmless, never a crash.
    const TemporaryFolder folder;
    const std::string library = readFile(kBroken / "viable_filter_liar.so");
    int refused = 0;
    for (std::size_t byte : {32u, 33u, 34u, 39u, 40u, 44u, 47u, 54u, 55u, 56u, 57u, 58u, 60u, 61u}) {
        std::string damaged = library;
        damaged[byte] = char(0xff);
        const std::string name = "byte_" + std::to_string(byte);
        writeBytes(folder.path() / ("viable_filter_" + name + ".so"), damaged);
        refused += findMessage(PluginLoader({folder.path()}), name) != "(accepted)" ? 1 : 0;
    }
    EXPECT_EQ(refused, 14);
}

TEST(PluginLoader, Fault40_MissingPluginSymbol) {
    expectContains(findBroken("no_symbol"),
                   {"it has no function viable_plugin_library(), so it is not a viable plugin", "VIABLE_PLUGIN"});
}

TEST(PluginLoader, Fault40_UnresolvedSymbolIsRefusedWhenLoadedNotInMidMotion) {
    expectContains(findBroken("unresolved_symbol"),
                   {"the dynamic linker says: ", "undefined symbol", "functionThatNobodyDefines"});
}

// --- Tables that are not viable's ---------------------------------------------------------------

TEST(PluginLoader, Fault41_WrongMagic) {
    expectContains(findBroken("wrong_magic"),
                   {"does not begin with viable's magic number", "instead of 766961626c652031"});
}

TEST(PluginLoader, Fault41_TableOfAnotherSize) {
    const std::string ours = std::to_string(sizeof(PluginLibrary));
    EXPECT_CONTAINS(findBroken("short_table"),
                    "its table has " + std::to_string(sizeof(PluginLibrary) - 8) + " bytes, viable's " + ours);
    EXPECT_CONTAINS(findBroken("long_table"),
                    "its table has " + std::to_string(sizeof(PluginLibrary) + 8) + " bytes, viable's " + ours);
    EXPECT_CONTAINS(findBroken("tiny_table"), "its table has 12 bytes, viable's " + ours + ". Build it again");
    EXPECT_CONTAINS(findBroken("other_entry_size"), "an entry of its table has " +
                                                        std::to_string(sizeof(PluginEntry) + 8) + " bytes, viable's " +
                                                        std::to_string(sizeof(PluginEntry)));
}

TEST(PluginLoader, Fault41_OtherInterfaceVersion) {
    EXPECT_CONTAINS(findBroken("other_version"),
                    "its plugin interface version is " + std::to_string(kPluginInterfaceVersion + 1) + ", viable's " +
                        std::to_string(kPluginInterfaceVersion) + ". Build it again with the headers of this viable");
}

TEST(PluginLoader, APluginOfVersionFiveIsRefusedInOneSentence) {
    EXPECT_CONTAINS(findBroken("version_five"),
                    "viable_filter_version_five.so cannot be used: its plugin interface version is 5, viable's " +
                        std::to_string(kPluginInterfaceVersion) + ". Build it again with the headers of this viable");
    // Most cannot even be linked: what they ask for is not there any more.
    EXPECT_CONTAINS(findBroken("misses_symbol"),
                    "it was built for another viable: this one, of plugin interface version " +
                        std::to_string(kPluginInterfaceVersion) +
                        ", has no viable::functionOfAnOlderVersion(int). Build it again");
}

TEST(PluginLoader, Fault41_OtherNdebug) {
    EXPECT_CONTAINS(findBroken("other_ndebug"),
                    "it was built with NDEBUG, viable without: link the plugin to viable::viable, which sets -UNDEBUG");
}

TEST(PluginLoader, Fault41_OtherEigenAlignment) {
    expectContains(findBroken("other_alignment"), {"its Eigen alignment (EIGEN_MAX_ALIGN_BYTES) is 64, viable's " +
                                                       std::to_string(EIGEN_MAX_ALIGN_BYTES),
                                                   "without -march=native"});
}

TEST(PluginLoader, Fault41_EveryDifferingFieldIsNamed) {
    const std::string message = findBroken("other_everything");
    const AbiStamp ours = makeAbiStamp();
    const auto pair = [](std::uint32_t value) {
        return " is " + std::to_string(value + 1) + ", viable's " + std::to_string(value) + ": ";
    };
    expectContains(
        message,
        {"pointer size in bytes" + pair(ours.pointerSize), "(EIGEN_MAX_ALIGN_BYTES)" + pair(ours.eigenMaxAlignBytes),
         "minor)" + pair(ours.eigenVersion),
         ours.compiler == 1 ? "it was built with clang, viable with gcc: "
                            : "it was built with an unknown compiler, viable with clang: ",
         "compiler's major version" + pair(ours.compilerMajor), "(__GXX_ABI_VERSION)" + pair(ours.cxxAbi),
         "(_GLIBCXX_USE_CXX11_ABI)" + pair(ours.libstdcxxNewAbi), "(__cplusplus / 100)" + pair(ours.cxxStandard),
         "it was built with NDEBUG, viable without: ", "it was built with -ffast-math, viable without: ",
         "with the same -fsanitize option", "hash over the layout of shared types" + pair(ours.layout)});
    // One clause per field of the stamp but the version: a field that is added must be described, too.
    EXPECT_EQ(std::count(message.begin(), message.end(), ';') + 2,
              std::ptrdiff_t(sizeof(AbiStamp) / sizeof(std::uint32_t)));
}

TEST(PluginLoader, Fault41_TablesWithHoles) {
    EXPECT_CONTAINS(findBroken("null_table"), "viable_plugin_library() returned no table");
    EXPECT_CONTAINS(findBroken("null_entries"), "its table has no entries");
    EXPECT_CONTAINS(findBroken("no_entries"), "its table has no entries");
    EXPECT_CONTAINS(findBroken("many_entries"), "has 4000000000 entries (at most 64)");
    EXPECT_CONTAINS(findBroken("no_name"), "entry 1 of its table has no name");
    EXPECT_CONTAINS(findBroken("no_create"), "entry 1 of its table ('no_create') has no create function");
    EXPECT_CONTAINS(findBroken("no_destroy"), "entry 1 of its table ('no_destroy') has no destroy function");
    EXPECT_CONTAINS(findBroken("unknown_kind"), "entry 1 of its table is of the unknown kind 5");
}

TEST(PluginLoader, Fault41_InvalidParameterTables) {
    EXPECT_CONTAINS(findBroken("null_parameters"),
                    "the parameter table of 'null_parameters' is missing although it is said to have 2 entries");
    EXPECT_CONTAINS(findBroken("nameless_parameter"),
                    "the parameter table of 'nameless_parameter' (entry 2) has a parameter without a name");
    EXPECT_CONTAINS(findBroken("twin_parameters"), "declares 'gain' twice (entries 1 and 2)");
    for (int k = 0; k < 2; ++k)
        EXPECT_CONTAINS(findBroken("empty_range"), "declares 'gain' with the empty range [2, 1]");
}

TEST(PluginLoader, ALibraryIsOpenedOnceItsStampIsRightAndItsThrowRefusesIt) {
    const std::string text =
        "viable_filter_open_throws.so cannot be used: the function that describes its options and "
        "adds its kinds of limits threw: no options today. Leave only describe() and addLimit() there";
    for (int k = 0; k < 2; ++k) EXPECT_CONTAINS(findBroken("open_throws"), text);
    EXPECT_CONTAINS(findBroken("opens_another_build"), "hash over the layout of shared types");
    EXPECT_CONTAINS(findBroken("limit_of_taken_name"), "kind of limit 'motor': that is the name of ");
    const std::string taken = findBroken("limit_of_taken_name");
    EXPECT_CONTAINS(taken, "Choose another name.");
    EXPECT_EQ(taken.find("Leave only"), std::string::npos);
}

TEST(PluginLoader, KindAndNameMustBeThoseOfTheFile) {
    EXPECT_CONTAINS(findBroken("wrong_kind"),
                    "by its file name it is the filter 'wrong_kind', by its table the controller "
                    "'wrong_kind'. Rename the file to viable_controller_wrong_kind.so");
    EXPECT_CONTAINS(findBroken("wrong_name"),
                    "by its file name it is the filter 'wrong_name', by its table the filter "
                    "'right_name'. Rename the file to viable_filter_right_name.so");
    const TemporaryFolder folder;
    fs::copy_file(kBroken / "viable_filter_liar.so", folder.path() / "liar.so");
    EXPECT_CONTAINS(findMessage(PluginLoader({}), (folder.path() / "liar.so").string()),
                    "its file name is not viable_<kind>_<name>.so");
}

TEST(PluginLoader, ALibraryOfAnotherKindIsRefused) {
    EXPECT_CONTAINS(findMessage(PluginLoader({}), (kBroken / "viable_controller_nan_torque.so").string()),
                    "a filter is asked for and this is a controller");
}

// --- Two libraries, one class -------------------------------------------------------------------

TEST(PluginLoader, Fault42_SameClassInTwoLibrariesStaysApart) {
    const PluginLoader loader({kBroken});
    const auto make = [&](const char* name) {
        return PluginLoader::create<SafetyFilter>(loader.find(PluginKind::SafetyFilter, name, kWhere, {}));
    };
    const PluginPtr<SafetyFilter> one = make("same_class_one");
    const PluginPtr<SafetyFilter> two = make("same_class_two");
    const auto ask = [](SafetyFilter& filter) {
        FilterDecision decision;
        filter.filter({{}, {}, {}}, decision);
        return decision.value;
    };
    for (int round = 0; round < 2; ++round) {
        EXPECT_EQ(ask(*one), JointVector::Constant(2, 1.0));
        EXPECT_EQ(ask(*two), JointVector::Constant(2, 2.0));
    }
}

// --- Making plugins -----------------------------------------------------------------------------

TEST(PluginLoader, Fault44_ThrowingInitIsAnErrorWithTheLibrarysWords) {
    makeMessage("constructor_throws");  // asked again it says the same
    expectContains(makeMessage("constructor_throws"),
                   {"the filter 'constructor_throws' could not be made: its constructor threw: no device at port 7",
                    "viable_filter_constructor_throws.so: "});
    EXPECT_CONTAINS(makeMessage("constructor_throws_int"),
                    "its constructor threw something other than a std::exception");
    EXPECT_CONTAINS(makeMessage("create_throws"), "its create function threw: thrown across the border");
    EXPECT_CONTAINS(makeMessage("create_throws_int"),
                    "its create function threw something other than a std::exception");
    EXPECT_CONTAINS(makeMessage("null_create"),
                    "the filter 'null_create' could not be made: the device is not plugged in");
    EXPECT_CONTAINS(makeMessage("silent_create"), "could not be made: it gives no reason");
    EXPECT_CONTAINS(findBroken("table_throws"), "viable_plugin_library() threw: no table today");
    // The language itself keeps exceptions out of destructors.
    static_assert(std::is_nothrow_destructible_v<Plugin>);
}

TEST(PluginLoader, Fault45_TheMessageIsACopyThatOutlivesTheExceptionAndTheLoader) {
    std::exception_ptr kept;
    {
        const PluginLoader loader({kBroken});
        const PluginInfo info = loader.find(PluginKind::SafetyFilter, "constructor_throws", kWhere, {});
        try {
            PluginLoader::create<SafetyFilter>(info);
        } catch (...) {
            kept = std::current_exception();
        }
    }
    ASSERT_TRUE(kept);
    std::string text;
    try {
        std::rethrow_exception(kept);
    } catch (const Error& error) {  // viable's own type, not DeviceMissing, which the library owns
        EXPECT_EQ(typeid(error), typeid(Error));
        text = error.what();
    }
    kept = nullptr;
    EXPECT_CONTAINS(text, "no device at port 7");
}

TEST(PluginLoader, Fault46_LibraryStaysAsLongAsTheProcess) {
    PluginPtr<SafetyFilter> filter(nullptr, nullptr);
    const TemporaryFolder folder;
    {
        fs::copy_file(kBroken / "viable_filter_liar.so", folder.path() / "viable_filter_liar.so");
        const PluginLoader loader({folder.path()});
        filter = PluginLoader::create<SafetyFilter>(loader.find(PluginKind::SafetyFilter, "liar", kWhere, {}));
        fs::remove(folder.path() / "viable_filter_liar.so");
    }
    const std::string path = (folder.path() / "viable_filter_liar.so").string();
    const auto isMapped = [&] { return readFile("/proc/self/maps").find(path) != std::string::npos; };
    ASSERT_TRUE(isMapped());
    // Even somebody who closes it once too often does not pull it away.
    for (int i = 0; i < 5; ++i) {
        void* handle = dlopen(path.c_str(), RTLD_NOW | RTLD_NOLOAD);
        ASSERT_NE(handle, nullptr);
        dlclose(handle);
        dlclose(handle);
    }
    EXPECT_TRUE(isMapped());
    EXPECT_TRUE(filter->traits().guarantees.hasJoints());
    filter.reset();
    EXPECT_TRUE(isMapped());
}

// --- What all of the program shares --------------------------------------------------------------

TEST(PluginLoader, Fault50_ALibraryThatChangesTheProcessIsUndoneAndTold) {
    const fs::path folder = fs::current_path();
    const std::locale locale;
    const std::string name = std::setlocale(LC_ALL, nullptr);
    struct sigaction before {
    }, after{};
    // Twice: its start-up code runs only the first time, what is told must stay the same.
    for (int i = 0; i < 2; ++i) {
        sigaction(SIGINT, nullptr, &before);
        const PluginWatch library(
            PluginLoader({kBroken}).find(PluginKind::SafetyFilter, "changes_process_when_loaded", kWhere, {}));
        EXPECT_CONTAINS(library.sharedChange,
                        "when it was loaded: the global locale of C++, the locale (C.UTF-8 instead of " + name +
                            "), the working folder (to /), what is done at signal 2 (Interrupt), what is done at "
                            "signal 11 (Segmentation fault)");
        EXPECT_EQ(fs::current_path(), folder);
        EXPECT_EQ(std::locale(), locale);
        EXPECT_EQ(std::setlocale(LC_ALL, nullptr), name);
        sigaction(SIGINT, nullptr, &after);
        EXPECT_EQ(after.sa_handler, before.sa_handler);
    }
}

TEST(ProcessGuard, Fault50_OfSeveralAtOnceTheFirstThatEndsTellsAndAllSetBack) {
    const fs::path folder = fs::current_path();
    ProcessGuard outer;
    {
        ProcessGuard inner;
        fs::current_path("/");
        ProcessGuard late;  // does not take what it finds for what is right
        EXPECT_EQ(inner.undo(), "the working folder (to /)");
        EXPECT_EQ(late.undo(), "");
        fs::current_path("/");
    }
    EXPECT_EQ(fs::current_path(), folder);
    EXPECT_EQ(outer.undo(), "");
}

TEST(ProcessGuard, Fault50_SetsBackTheLocaleOfTheThread) {
    const locale_t own = ::uselocale(locale_t{});
    const locale_t other = ::newlocale(LC_ALL_MASK, "C.UTF-8", locale_t{});
    {
        ProcessGuard guard;
        ::uselocale(other);
        EXPECT_EQ(guard.undo(), "the locale of the thread");
        ::uselocale(other);
    }
    EXPECT_EQ(::uselocale(locale_t{}), own);
    ::freelocale(other);
}

// --- Arithmetic ---------------------------------------------------------------------------------

double halveSmallest() {  // a denormal number: zero when the thread flushes
    volatile double smallest = std::numeric_limits<double>::min();
    return smallest / 2;
}

TEST(PluginLoader, Fault50_LibraryThatChangesTheArithmeticIsRefusedAndUndone) {
#if defined(__SSE__)
    const unsigned before = _mm_getcsr() & ~0x3fu;
#endif
    ASSERT_GT(halveSmallest(), 0.0);
    // Twice: its start-up code runs only the first time, the answer must stay the same.
    for (int i = 0; i < 2; ++i) {
        const std::string message = findBroken("flushes_to_zero");
        EXPECT_CONTAINS(message, "changed the floating point arithmetic of the whole thread");
#if defined(__SSE__)
        EXPECT_CONTAINS(message, "flush-to-zero switched on, denormals-are-zero switched on");
        EXPECT_EQ(_mm_getcsr() & ~0x3fu, before);
#endif
        EXPECT_CONTAINS(message, "without -ffast-math");
        EXPECT_GT(halveSmallest(), 0.0);
    }
}

TEST(PluginLoader, Fault50_RealFastMathBuildIsRefused) {
    for (int i = 0; i < 2; ++i) {
        expectContains(findBroken("fast_math"), {"viable_filter_fast_math.so cannot be used: ", "without -ffast-math"});
        EXPECT_GT(halveSmallest(), 0.0);
    }
}

TEST(PluginLoader, Fault50_ConstructorThatChangesRoundingIsRefusedAndUndone) {
    ASSERT_EQ(std::fegetround(), FE_TONEAREST);
    EXPECT_CONTAINS(makeMessage("changes_rounding"),
                    "changed the floating point arithmetic of the whole thread when it was made "
                    "(rounding upward instead of to nearest; set back)");
    EXPECT_EQ(std::fegetround(), FE_TONEAREST);
}

}  // namespace
}  // namespace viable::test
