#include "viable/live/RehearsedCommand.h"

namespace viable {

RehearsedCommand::~RehearsedCommand() = default;

}  // namespace viable
