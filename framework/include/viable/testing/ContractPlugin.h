#pragma once

namespace viable::testing {

/** What the contract suite tests. The program that links the suite defines kContractPlugin; for plugins of your own,
viable_add_plugin_test() of CMake does. */
struct ContractPlugin {
    const char* folder;      ///< of the libraries
    const char* plugin;      ///< such as "filter my_filter"; empty: every plugin in the folder
    const char* parameters;  ///< values of those that have no default, a line "name: value" each, for two joints
};
extern const ContractPlugin kContractPlugin;

}  // namespace viable::testing
