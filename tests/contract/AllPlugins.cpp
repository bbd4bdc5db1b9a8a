#include "Paths.h"
#include "viable/testing/ContractPlugin.h"

const viable::testing::ContractPlugin viable::testing::kContractPlugin = {VIABLE_PLUGIN_DIR, "", ""};
