#pragma once

#include "host/PluginCall.h"

namespace viable::detail {

/** Calls a plugin's tick function before any run: whatever it throws becomes an Error that names the plugin.
@param function  "sample" */
template <class Call>
TickStatus tryTick(PluginKind kind, PluginWatch* watch, const char* function, const Call& call) {
    const std::string who = watch ? watch->title : std::string("the ") + getName(kind) + " plugin";
    const std::string threw = std::string("threw in ") + function + "(): ";
    const PluginCall marked(watch, kBeforeFirstTick);
    try {
        return call();
    } catch (const PluginFault& e) {
        throw Error(ErrorKind::PluginFailed, who, e.what(), e.remedy());
    } catch (const std::exception& e) {
        throw Error(ErrorKind::PluginFailed, who, threw + e.what(), kOnThrow);
    } catch (...) {
        throw Error(ErrorKind::PluginFailed, who, threw + "something other than a std::exception", kOnThrow);
    }
}

}  // namespace viable::detail
