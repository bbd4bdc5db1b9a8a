// Property tests of certified braking: random limits, random arms, adversarial input, millions of joint steps.
//
//     viable_properties limits|recovery|changing_limits|stops|monitor|obstacles|freezing|swinging|trembling|speeds|people|people_runs|references|any_arm|
//                       dynamics|tracking|tracking_poses|bound|link [--steps N] [--seed S] [--arm K]
//
// --steps counts joint steps (joints times ticks), 20,000,000 by default; the long mode is --steps 1e9. For `stops` it
// counts random viable states, for `dynamics` states of random arms, for `bound` joints, for `link` strangers' packets, for `people_runs` runs. A run is a function of its seed,
// an arm of seed and its number.
// Exit code 0: no violation; 1: at least one, the first is printed in full; others: wrong arguments.

#include "Properties.h"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>

namespace viable {

namespace {

/** A whole number from `least` on, also as 1e6. */
template <class Integer>
bool readNumber(const std::string& text, Integer least, Integer& number) {
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data(), end, number);
    if (error == std::errc() && rest == end) return number >= least;
    double value = 0.0;
    const auto [realRest, realError] = std::from_chars(text.data(), end, value);
    if (realError != std::errc() || realRest != end || value != std::floor(value)) return false;
    const double beyond = std::ldexp(1.0, std::numeric_limits<Integer>::digits);
    if (!(value >= static_cast<double>(least) && value < beyond)) return false;
    number = static_cast<Integer>(value);
    return true;
}

template <class Integer>
void addNumber(CLI::App& app, const char* name, Integer least, Integer& number, const char* help, const char* allowed) {
    app.add_option_function<std::string>(
           name,
           [=, &number](const std::string& text) {
               if (!readNumber(text, least, number))
                   throw CLI::ValidationError(name, "\"" + text + "\" is not " + allowed);
           },
           help)
        ->type_name("NUMBER");
}

}  // namespace

}  // namespace viable

int main(int argc, char** argv) {
    using namespace viable;
    CLI::App app{"Property tests of certified braking"};
    const std::pair<const char*, bool (*)(const Options&)> properties[] = {{"limits", checkLimits},
                                                                           {"recovery", checkRecovery},
                                                                           {"changing_limits", checkChangingLimits},
                                                                           {"stops", checkStops},
                                                                           {"monitor", checkMonitor},
                                                                           {"obstacles", checkObstacles},
                                                                           {"freezing", checkFreezing},
                                                                           {"swinging", checkSwinging},
                                                                           {"trembling", checkTrembling},
                                                                           {"speeds", checkSpeeds},
                                                                           {"people", checkPeople},
                                                                           {"people_runs", checkPeopleRuns},
                                                                           {"references", checkReferences},
                                                                           {"any_arm", checkAnyArm},
                                                                           {"dynamics", checkDynamics},
                                                                           {"tracking", checkTracking},
                                                                           {"tracking_poses", checkTrackingPoses},
                                                                           {"bound", checkBound},
                                                                           {"link", checkLink}};
    std::vector<std::string> names;
    for (const auto& property : properties) names.push_back(property.first);
    std::string name;
    Options options;
    app.add_option("property", name)->required()->check(CLI::IsMember(names));
    addNumber<std::int64_t>(app, "--steps", 1, options.steps, "Joint steps (joints times ticks)",
                            "a whole number of joint steps from 1 to 9223372036854775807, such as 5000000 or 5e6");
    addNumber<std::uint64_t>(app, "--seed", 0, options.seed, "Seed of everything random",
                             "a whole number from 0 to 18446744073709551615");
    addNumber<std::int64_t>(app, "--arm", 1, options.arm, "This arm alone, as a violation names it",
                            "the number of an arm, from 1 on");
    const std::map<std::string, Objective> objectives = {{"torque", Objective::Torque},
                                                         {"tool", Objective::Tool},
                                                         {"joint", Objective::Joint},
                                                         {"path", Objective::Path}};
    app.add_option("--objective", options.objective, "What changes are measured in (limits)")
        ->transform(CLI::CheckedTransformer(objectives));
    CLI11_PARSE(app, argc, argv);
    for (const auto& [known, check] : properties)
        if (name == known) return check(options) ? 0 : 1;
    return 1;
}
