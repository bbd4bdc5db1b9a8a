#include "plugin/RehearsedCommand.h"

namespace viable {

RehearsedCommand::~RehearsedCommand() = default;

}  // namespace viable
