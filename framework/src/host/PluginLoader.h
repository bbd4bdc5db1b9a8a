#pragma once

#include "viable/plugin/PluginExport.h"

namespace viable {

/** In the order of their numbers. */
inline constexpr std::array kPluginKinds = {PluginKind::CommandSource, PluginKind::NominalController,
                                            PluginKind::SafetyFilter, PluginKind::RobustLoop, PluginKind::RealPlant};

/** "command", "controller", "filter", "robust_loop", "plant": the words of file names and messages. */
const char* getName(PluginKind kind);

/** A plugin library that has passed every check. The library is never unloaded. */
struct PluginInfo {
    PluginKind kind;
    std::string name;
    std::string summary;
    std::filesystem::path library;  ///< for a class in Python its .py file; `name` is that of the class
    const PluginEntry* entry;
};

/** A plugin of kind `Interface`; destroying it calls the library's own destroy function. */
template <class Interface>
using PluginPtr = std::unique_ptr<Interface, void (*)(void*)>;

/** A library that was found by its name and refused. */
struct RefusedLibrary {
    std::filesystem::path library;
    std::string reason;
};

/** Finds plugin libraries by kind and name, checks them, makes plugins.

A library's file is called viable_<kind>_<name>.so. Search: a path if the request is one, else every folder of the
search path. A path contains a slash or ends in .so, and is relative to the folder of the file that asks.
FILE.py:CLASS is a class in Python, by way of viable_python.so, which is installed beside the folders of the search
path. Python itself starts when such a class is configured. Two files for one name are an error that names both; so
is a file whose descriptor says another kind or name. Libraries are loaded with RTLD_NOW | RTLD_LOCAL |
RTLD_NODELETE. The descriptor's magic, size and ABI stamp are compared before any C++ object crosses, and a
difference is named. Start-up code of a library (static objects) runs when it is found. */
class PluginLoader {
public:
    /** @param trial_s  above 0: each library is opened in a process of its own first. One that crashes, ends the
    process or takes longer than that there is refused (Error, PluginFailed), and this process goes on. Start-up code
    that survives there runs here a second time. Find plugins while the program has one thread then. */
    explicit PluginLoader(std::vector<std::filesystem::path> searchPath, double trial_s = 0.0);

    /** VIABLE_PLUGIN_PATH (colon-separated, absolute), then beside the program (`plugins` in its
    folder), then the install folder (../lib/viable/plugins from the program). Folders that do not
    exist are kept: messages name every place tried. */
    static std::vector<std::filesystem::path> makeDefaultSearchPath();

    /** @param request  name or path, as written
        @param where    who asks (`file:line:column: key`), for the message
        @param folder   a relative path is relative to this */
    PluginInfo find(PluginKind kind, const std::string& request, const std::string& where,
                    const std::filesystem::path& folder) const;

    /** A new, unconfigured plugin. Throws Error when its create function fails. */
    template <class Interface>
    static PluginPtr<Interface> create(const PluginInfo& info) {
        VIABLE_CHECK(info.kind == detail::kindOf<Interface>(), "plugin asked for as another kind");
        return PluginPtr<Interface>(static_cast<Interface*>(createObject(info)), info.entry->destroy);
    }

    /** Everything in the search path, sorted by kind and name; files that were refused go to
     * `refused`. */
    std::vector<PluginInfo> list(std::vector<RefusedLibrary>& refused) const;

    const std::vector<std::filesystem::path>& searchPath() const { return searchPath_; }

private:
    static void* createObject(const PluginInfo& info);

    std::vector<std::filesystem::path> searchPath_;
    double trial_s_;
};

}  // namespace viable
