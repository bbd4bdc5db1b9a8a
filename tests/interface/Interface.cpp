// The plugin interface in one library: everything that crosses the border between host and plugin hangs on these types.
// Its debug information is what abidw describes (tools/scripts/record_interface.sh).
#include "viable/environment/Surroundings.h"
#include "viable/filter/BrakingPolicyFilter.h"
#include "viable/plugin/PluginExport.h"
#include "viable/robot/ArmGeometry.h"
#include "viable/simulation/ArmHardware.h"

extern "C" VIABLE_PLUGIN_VISIBLE void viable_interface(
    const viable::PluginLibrary*, viable::CommandSource*, viable::NominalController*, viable::SafetyFilter*,
    viable::RobustLoop*, viable::RealPlant*, viable::JerkIntervalFilter*, viable::BrakingPolicyFilter*,
    viable::ArmHardware*, viable::SurroundingsFeed*, const viable::Surroundings*, viable::PeopleFeed*,
    const viable::ArmGeometry*, viable::ArmLimit*, const viable::LimitRow*, const viable::SettingList*,
    const viable::SettingValue*);

void viable_interface(const viable::PluginLibrary*, viable::CommandSource*, viable::NominalController*,
                      viable::SafetyFilter*, viable::RobustLoop*, viable::RealPlant*, viable::JerkIntervalFilter*,
                      viable::BrakingPolicyFilter*, viable::ArmHardware*, viable::SurroundingsFeed*,
                      const viable::Surroundings*, viable::PeopleFeed*, const viable::ArmGeometry*, viable::ArmLimit*,
                      const viable::LimitRow*, const viable::SettingList*, const viable::SettingValue*) {}
