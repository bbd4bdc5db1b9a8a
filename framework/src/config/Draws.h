#pragma once

#include <map>

#include "viable/config/ConfigNode.h"

namespace viable {

/** One run of a sweep. With the text of the file and its overrides it says everything about the run. */
struct DrawIndex {
    std::uint64_t seed = 1;
    std::int64_t run = 0;
};

/** "7:123" -> seed 7, run 123. Throws Error (BadInput). @param where  who asks, for the message */
DrawIndex parseDrawIndex(const std::string& text, const std::string& where);

/** A value of a configuration that is drawn anew for every run:

    ~uniform(a, b)              evenly between a and b
    ~log_uniform(a, b)          its logarithm evenly; 0 < a
    ~normal(mean, sd)           with an optional cut: ~normal(mean, sd, min, max)
    ~integer(a, b)              a whole number, both ends included
    ~choice(a, b, ...)          one of them: numbers, or as written: words, true, false; one with commas in quotes

Numbers may be expressions of pi, as everywhere. Between brackets and braces the commas need quotes around it all. */
struct DrawnKey {
    std::string keyPath;            ///< "cases.C2.filter.gamma", "start.position_rad[1]"
    std::string distribution;       ///< as written, without the `~`
    std::string place;              ///< for messages
    std::vector<std::string> ends;  ///< values at the ends of its range, all of a choice; none: no ends
    bool isOfWords = false;         ///< a choice of which not all are numbers
};

/** All of a tree, in its order. Throws Error (BadInput) for one that is not written as above, and for one at a key
that must not change from run to run (schema, title, robot). */
std::vector<DrawnKey> listDraws(const ConfigNode& root);

/** Replaces every draw below `root` by its value in a run, as the shortest text that reads back to the same number.
The value depends on seed, run and key path alone: neither other keys nor the machine change it (splitmix64 from a
hash of the three; logarithm and exponential are written out; normal: Marsaglia's polar method, cut by drawing
again). Throws as listDraws() does.
@param held  values by key path that are taken in place of the draw
@return the values by key path */
std::map<std::string, std::string> resolveDraws(ConfigNode& root, const DrawIndex& index,
                                                const std::map<std::string, std::string>& held = {});

}  // namespace viable
