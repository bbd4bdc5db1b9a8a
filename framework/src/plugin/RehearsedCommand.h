#pragma once

#include "viable/plugin/CommandSource.h"

namespace viable {

/** A command source that others send to, who are to know whether the arm follows. Before a live session moves the arm, the same
case is run on the nominal arm alone, with a source of its own. */
class RehearsedCommand : public CommandSource {
public:
    ~RehearsedCommand() override;

    /** After configure(): what follows is that rehearsal. The command rests at the start; nobody is invited, heard or answered. */
    virtual void beginRehearsal() noexcept = 0;
};

}  // namespace viable
