#pragma once

#include <nlohmann/json.hpp>

#include "live/LiveSession.h"

namespace viable {

/** The numbers of a frame as a page finds them, in their order: [name, count], ... All are doubles, little-endian. */
nlohmann::json describeFrame(int joints);

/** A live arm just now.
@param now_s  of the server's clock, by which it knows how late a viewer is
@param hand   of the operator; null: another command */
std::string encodeFrame(double now_s, const LiveStatus& status, const TeleoperationFeed::Status* hand);

/** What a viewer needs to know of a case once: {"format", "title", "robot", "scene", "environments", "links",
"obstacles", "moves": "tool", "joints" or "", "places": how many obstacles a hand may add, "has_real", "has_contact":
the plant tells what the arm touches, "tick_s", "limits": kinds by their code, "fields", "binary"}, as in the data of a
report. */
std::string describeLive(const CasePlan& plan, const std::string& title, bool hasHand, bool movesJoints,
                         bool takesObstacles, bool hasContact);

}  // namespace viable
