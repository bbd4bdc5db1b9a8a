// A kind of limit of somebody else's, "the tool stays upright within 20 degrees": one class and one row. And a filter that
// guarantees it and does not keep it.
#include <algorithm>
#include <cfenv>
#include <cmath>
#include <cstdlib>

#include "BrokenPlugin.h"
#include "viable/robot/RobotModel.h"

namespace {

constexpr double kMostTilt_deg = 20.0;

struct Options {
    std::string judge = "healthy";

    template <class V>
    void describe(V& v) {
        v(judge, "judge", "healthy|throws|rounds|is_null|crashes|loses_words|cannot_say",
          "What the limit's judge does in the run.");
    }
};
std::string judge;

/** How far the tool's x axis points away from where it points at home. */
class Upright : public viable::ArmLimit {
public:
    explicit Upright(const viable::RobotDescription& robot)
        : model_(robot), still_(viable::JointVector::Zero(robot.size())), upright_(findAxis(robot.home)) {}

    double findTilt_deg(const viable::JointVector& q) {
        return std::acos(std::clamp(findAxis(q).dot(upright_), -1.0, 1.0)) * 180.0 / viable::kPi;
    }
    viable::LimitSample sample(const viable::ArmSample& arm) override {
        if (judge == "throws" && arm.time_s > 0.2) throw 7;
        if (judge == "rounds" && arm.time_s > 0.2) std::fesetround(FE_UPWARD);
        if (judge == "crashes" && arm.time_s > 0.2) std::abort();
        viable::LimitSample found;
        found.value = findTilt_deg(arm.q);
        found.isBroken = found.value > kMostTilt_deg;
        found.part = "tool";
        return found;
    }
    std::optional<double> limit() const override { return kMostTilt_deg; }

private:
    Eigen::Vector3d findAxis(const viable::JointVector& q) {
        model_.calcDynamics(q, still_, dynamics_);
        return dynamics_.tool.orientation * Eigen::Vector3d::UnitX();
    }

    viable::RobotModel model_;
    viable::JointVector still_;
    viable::Dynamics dynamics_;
    Eigen::Vector3d upright_;
};

viable::LimitRow makeRow() {
    viable::LimitRow row;
    row.make = [](const viable::LimitScene& scene) -> std::unique_ptr<viable::ArmLimit> {
        return judge == "is_null" ? nullptr : std::make_unique<Upright>(scene.robot);
    };
    row.exists = [](const viable::LimitScene&) { return judge == "cannot_say" ? throw 7 : true; };
    row.tellWorst = [](const viable::ArmLimitRecord& r) {
        if (judge == "loses_words") throw 7;
        return "worst " + std::to_string(r.worst).substr(0, 4) + " (" + r.part + ")";
    };
    row.tellInVerdict = [](const viable::LimitAccount&) -> std::string {
        if (judge == "loses_words") std::fesetround(FE_UPWARD);
        return "";
    };
    using R = viable::LimitReport;
    row.columns = {{"known", &R::isKnown}, {"tilt_deg", &R::value}, {"limit_deg", &R::limit}, {"link", &R::link}};
    return row;
}

viable::LimitKind upright = viable::LimitKind::None;

void addLimits() {
    upright = viable::addLimit("upright", "deg", makeRow());
}

/** Passes everything on, and tells how far the tool is tilted. */
class UprightFilter : public broken::Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        upright_ = std::make_unique<Upright>(setup.robot);
        judge = parameters.get<Options>().judge;
    }
    viable::FilterTraits traits() const override { return {{upright}}; }
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override {
        const viable::FilterStatus status = Filter::filter(input, decision);
        viable::LimitReport& report = decision.reports[upright];
        report.isKnown = true;
        report.value = upright_->findTilt_deg(input.nominal.q);
        report.limit = kMostTilt_deg;
        if (report.value <= report.limit) return status;
        decision.joints[0] = {upright, viable::LimitSide::Upper};
        return viable::FilterStatus::Modified;
    }

private:
    std::unique_ptr<Upright> upright_;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, UprightFilter, "upright", "Guarantees that the tool stays upright, and lies.",
              Options, addLimits)
