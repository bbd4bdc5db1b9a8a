#pragma once

#include "experiment/ConfiguredCase.h"

namespace viable {

/** What can be told of a case before its run. */
struct CaseForecast {
    std::string gains;   ///< of the robust loop, with their margins: one line; empty: none that tells its law
    std::string push;    ///< how much it may add to the motors, one line; empty: as much as they have
    std::string motors;  ///< shares of their torque limits, one line; empty: no limits are known
    std::vector<std::string> people;  ///< what is known of each before it is seen, a line each
    bool keepsApart = true;           ///< the filter knows them; or there are none
    std::string limits;               ///< which limits of the whole arm are guaranteed, one line; empty: there are none
    /** What will fail in a run, each in one line with its remedy: motors that cannot hold the arm or move it as fast as the
    limits allow, a command that starts far from the tool or out of its reach, an arm that starts in an obstacle or in
    itself, a controller and a filter that do not bring the nominal arm to rest. */
    std::vector<std::string> warnings;
};

/** Looks ahead: at the start, at a fixed sample of 1000 poses within the limits, and at the first command. Torques are those
of the nominal arm with the payload that it knows; what friction and disturbances take comes on top. Command and
controller are reset and asked; a command that hears somebody from outside hears nothing from then on
(RehearsedCommand), so the case is not for a run any more. Throws Error (PluginFailed) where they cannot be reset. Some 0.1 s. */
CaseForecast forecastCase(const ConfiguredCase& configured);

/** What the case's robust loop may add to the motors; none: there is none, or `accept_unstable` gives it all that they have. */
std::optional<detail::AuthoritySizes> findAuthority(const ConfiguredCase& configured);

}  // namespace viable
