#include <CLI/CLI.hpp>

#include "Commands.h"
#include "ExperimentArguments.h"
#include "core/JsonNumber.h"
#include "core/Text.h"
#include "experiment/CaseForecast.h"
#include "records/WorkShare.h"
#include "summary/Sliding.h"

namespace viable {

namespace {

struct BoundArguments {
    std::string file, caseName;
    std::vector<std::string> overrides;
    bool json = false;
};

constexpr int kNameWidth = 40, kLeastNumberWidth = 11;

void printRow(const std::string& name, const JointVector& values, int width, double factor = 1.0) {
    std::printf("  %-*s", kNameWidth, name.c_str());
    for (double value : values) {
        std::printf("%*s", width, (std::isfinite(value) ? detail::format("%.3g", factor * value) : "-").c_str());
    }
    std::printf("\n");
}

void print(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    const TrackingBound& bound = *configured.bound;
    const int n = plan.robot.size();
    const Sliding sliding = findSliding(plan.robot);
    const std::string position = choose(sliding, "mrad", "mrad; mm", "mm"),
                      velocity = choose(sliding, "rad/s", "rad/s; m/s", "m/s"),
                      torque = choose(sliding, "torque", "torque or force", "force"),
                      Nm = choose(sliding, "Nm", "Nm; N", "N");
    std::printf("%s: how far the real arm can be from the nominal one, within the disturbance_set\n",
                plan.name.c_str());
    int width = kLeastNumberWidth;  // of a column
    for (const JointDescription& joint : plan.robot.joints)
        width = std::max(width, static_cast<int>(joint.name.size()) + 1);
    std::printf("  %-*s", kNameWidth, "");
    for (const JointDescription& joint : plan.robot.joints) std::printf("%*s", width, joint.name.c_str());
    std::printf("\n");
    if (sliding == Sliding::Some) {
        std::printf("  %-*s", kNameWidth, "in");
        for (int i = 0; i < n; ++i) std::printf("%*s", width, plan.robot.slides(i) ? "mm, N" : "mrad, Nm");
        std::printf("\n");
    }
    printRow("position [" + position + "]", bound.position, width, 1e3);
    printRow("velocity [" + velocity + "]", bound.velocity, width);
    const auto share = [](const JointBounds& limits, const JointVector& size) -> JointVector {
        return (2.0 * size).cwiseQuotient(limits.upper - limits.lower);
    };
    printRow("share of the position range [%]", share(plan.limits.position, bound.position), width, 1e2);
    printRow("share of the velocity range [%]", share(plan.limits.velocity, bound.velocity), width, 1e2);
    std::printf("where the position bound comes from, largest first [%s]\n", position.c_str());
    std::vector<TrackingBound::Part> parts = bound.parts;
    std::stable_sort(parts.begin(), parts.end(),
                     [](const auto& a, const auto& b) { return a.position.sum() > b.position.sum(); });
    for (const TrackingBound::Part& part : parts)
        if (part.position.maxCoeff() > 0.0) printRow(part.source, part.position, width, 1e3);
    std::printf("the same for the velocity [%s]\n", velocity.c_str());
    for (const TrackingBound::Part& part : parts)
        if (part.velocity.maxCoeff() > 0.0) printRow(part.source, part.velocity, width);
    std::printf("and how much %s that is [%s]\n", torque.c_str(), Nm.c_str());
    for (const TrackingBound::Part& part : parts)
        if (part.torque.maxCoeff() > 0.0) printRow(part.source, part.torque, width);
    std::printf("%s that it takes [%s]\n", torque.c_str(), Nm.c_str());
    printRow("lasting", bound.lastingTorque, width);
    printRow("for moments, at most", bound.torque, width);
    printRow("the motors give", bound.motorTorque, width);
    printRow("robust torque, change per tick", bound.torqueStep, width);
    printRow("of its integral", bound.integralTorque, width);
    if (const auto sizes = findAuthority(configured)) printRow("robust torque, cut beyond", sizes->reach, width);
    std::string tight;
    for (int i = 0; i < n; ++i)
        if (bound.torque[i] > bound.motorTorque[i]) detail::addItem(tight, plan.robot.joints[i].name);
    if (!tight.empty())
        std::printf(
            "The bound is for motors that are never at their limit. For moments the worst of all disturbances asks "
            "more of them (%s): runs count the ticks in which that happened.\n",
            tight.c_str());
    std::printf("\n");
}

nlohmann::json makeJson(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    const TrackingBound& b = *configured.bound;
    using nlohmann::json;
    const auto list = [](const JointVector& values) {
        json array = json::array();
        for (double x : values) array.push_back(detail::makeNumberOrWord(x));
        return array;
    };
    json parts = json::array();
    for (const TrackingBound::Part& part : b.parts)
        parts.push_back({{"source", part.source},
                         {"torque_Nm", list(part.torque)},
                         {"position_rad", list(part.position)},
                         {"velocity_radps", list(part.velocity)}});
    nlohmann::json result = {{"case", plan.name},
                             {"joints", plan.robot.jointNames()},
                             {"position_rad", list(b.position)},
                             {"velocity_radps", list(b.velocity)},
                             {"trip_rad", list(b.measured)},
                             {"lasting_torque_Nm", list(b.lastingTorque)},
                             {"momentary_torque_Nm", list(b.torque)},
                             {"motor_torque_Nm", list(b.motorTorque)},
                             {"robust_torque_step_Nm", list(b.torqueStep)},
                             {"integral_torque_Nm", list(b.integralTorque)},
                             {"parts", parts}};
    if (const auto sizes = findAuthority(configured)) result["largest_robust_torque_Nm"] = list(sizes->reach);
    return result;
}

int run(const BoundArguments& arguments) {
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
    Experiment experiment =
        readExperiment(arguments.file, arguments.overrides, loader, makeRobotSearchPath(arguments.file));
    if (!arguments.caseName.empty()) selectCases(experiment, {arguments.caseName});
    nlohmann::json all = nlohmann::json::array();
    std::exception_ptr refusal;  // of the first case that no run would begin with
    bool any = false;
    for (const CasePlan& plan : experiment.cases) {
        if (!plan.disturbances) continue;
        if (arguments.json)  // among the lines of others there is no place for a bar
            WorkShare::tell("bounding", static_cast<double>(&plan - experiment.cases.data()) /
                                            static_cast<double>(experiment.cases.size()));
        const auto configured = configureTracking(plan);
        if (!configured->bound) continue;
        any = true;
        if (arguments.json)
            all.push_back(makeJson(*configured));
        else
            print(*configured);
        try {
            applyBound(plan, *configured);
        } catch (const Error&) {  // told after what it is about
            if (!refusal) refusal = std::current_exception();
        }
    }
    if (arguments.json) WorkShare::tell("bounding", 1.0);
    if (!any)
        throw badInput(arguments.file,
                       "no case has a tracking bound: it needs a disturbance_set and the robust loop nric",
                       "Add for example `disturbance_set: {friction_scale: 2, payload_kg: 3}`.");
    if (arguments.json) std::printf("%s\n", all.dump(1).c_str());
    std::fflush(stdout);
    if (refusal) std::rethrow_exception(refusal);
    return 0;
}

}  // namespace

void addBoundCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<BoundArguments>();
    CLI::App* command =
        app.add_subcommand("bound", "How far the real arm can be from the nominal one, and what that consists of");
    command->add_option("FILE", arguments->file, "Experiment file with a disturbance_set")->required();
    command->add_option("--case", arguments->caseName, "Only this case");
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command->add_flag("--json", arguments->json, "For programs");
    command->callback([arguments, &exitCode] { exitCode = run(*arguments); });
}

}  // namespace viable
