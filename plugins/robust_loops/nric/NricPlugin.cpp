#include "viable/plugin/PluginExport.h"
#include "viable/tracking/Nric.h"

VIABLE_PLUGIN(viable::RobustLoop, viable::Nric, "nric",
              "Nonlinear robust internal-loop compensator: the real arm follows the nominal one.", viable::NricSettings)
