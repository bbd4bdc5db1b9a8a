// A shared library that is no plugin at all.
extern "C" int viable_plugin_libary() {
    return 0;
}  // the slip of the pen is the fault
