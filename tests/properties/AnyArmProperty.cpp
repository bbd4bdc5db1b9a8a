#include <sstream>

#include "Paths.h"
#include "Properties.h"
#include "Random.h"
#include "TemporaryFolder.h"
#include "experiment/CaseRun.h"
#include "experiment/ExperimentFile.h"

namespace viable {

namespace {

/** A run is good where the real arm is no farther than this from the nominal one, RMS of the worst joint [rad, m]. */
constexpr double kGoodTracking = 0.02;
/** And where the command error is at most so many times that of the same law without limits and friction, or this [m, rad]. */
constexpr double kGoodRatio = 1.5, kGoodError = 0.01;
/** A tool farther from its command than this share of how the command moves misses it: the verdict must say so. */
constexpr double kMissedShare = 0.4;

/** What the motors are made to carry at the tool; payload of the real arm, which the nominal one does not know [kg]. */
constexpr double kLoad_kg = 0.4, kPayload_kg = 0.2;

const double kTicks_s[] = {0.0005, 0.001, 0.002};
const char* const kControllers[] = {"tool_servo", "task_space_pd", "joint_servo", "joint_pd"};

std::string join(const Eigen::VectorXd& values, const char* between) {
    std::ostringstream text;
    text.precision(17);
    for (int i = 0; i < values.size(); ++i) text << (i ? between : "") << values[i];
    return text.str();
}
std::string list(const JointVector& values) {
    return "[" + join(values, ", ") + "]";
}

/** An arm that somebody might have built: a chain of rods with any axes, heavy ones near the base, with or without rotors,
motors that carry it with something to spare, dry friction of 1 % of their torque. */
class PlausibleArm {
public:
    PlausibleArm(Random& random, const std::filesystem::path& folder) : random_(random), folder_(folder) {
        n_ = random.integer(3, 9);
        length_ = random.logUniform(0.3, 2.5);
        for (JointVector* v : {&velocity_, &rotors_, &home_, &torque_}) v->setZero(n_);
        torque_.setConstant(1e6);
        drawRods();
        write(loadedUrdf_);
        setMotors();
        write(urdf_);
    }
    double length() const { return length_; }
    int size() const { return n_; }
    bool hasRotors() const { return rotors_.maxCoeff() > 0.0; }

private:
    static std::string vector(const Eigen::Vector3d& v) { return join(v, " "); }
    Eigen::Vector3d drawDirection() {
        if (random_.chance(0.8)) return Eigen::Vector3d::Unit(random_.integer(0, 2));
        Eigen::Vector3d v(random_.uniform(-1.0, 1.0), random_.uniform(-1.0, 1.0), random_.uniform(0.1, 1.0));
        return v.normalized();
    }

    void drawRods() {
        std::vector<double> masses, lengths;
        for (int i = 0; i < n_; ++i) {
            masses.push_back(random_.logUniform(0.03, 20.0));
            lengths.push_back(random_.uniform(0.3, 1.0));
        }
        std::sort(masses.rbegin(), masses.rend());
        double sum = 0.0;
        for (const double l : lengths) sum += l;
        std::ostringstream text;
        text.precision(17);
        text << "<robot name='arm'>\n<link name='base'/>\n";
        Eigen::Vector3d end(0.0, 0.0, 0.1);
        for (int i = 0; i < n_; ++i) {
            const auto at = static_cast<std::size_t>(i);
            const double l = length_ * lengths[at] / sum, m = masses[at];
            const double r = std::clamp(std::sqrt(m / (random_.logUniform(800.0, 4000.0) * kPi * l)), l / 30.0, l);
            const bool slides = i > 0 && random_.chance(0.12);
            const double range = slides ? random_.uniform(0.05, 0.2) * length_ : random_.uniform(1.2, 3.0);
            velocity_[i] = slides ? random_.uniform(0.2, 0.8) * length_ : random_.uniform(1.0, 4.0);
            home_[i] = random_.uniform(-0.5, 0.5) * range;
            const std::string parent = i == 0 ? "base" : "link" + std::to_string(i - 1);
            text << "<joint name='j" << i << "' type='" << (slides ? "prismatic" : "revolute") << "'><origin xyz='"
                 << vector(end) << "' rpy='0 0 0'/><parent link='" << parent << "'/><child link='link" << i
                 << "'/><axis xyz='" << vector(drawDirection()) << "'/><limit lower='" << -range << "' upper='" << range
                 << "' velocity='" << velocity_[i] << "' effort='1000000'/></joint>\n";
            // The rod lies along one of its frame's axes.
            const int along = random_.integer(0, 2);
            end = l * Eigen::Vector3d::Unit(along);
            const double across = m * (3.0 * r * r + l * l) / 12.0, axial = m * r * r / 2.0;
            Eigen::Vector3d inertia = Eigen::Vector3d::Constant(across);
            inertia[along] = axial;
            text << "<link name='link" << i << "'><inertial><origin xyz='" << vector(end / 2.0)
                 << "' rpy='0 0 0'/><mass value='" << m << "'/><inertia ixx='" << inertia.x() << "' iyy='"
                 << inertia.y() << "' izz='" << inertia.z() << "' ixy='0' ixz='0' iyz='0'/></inertial></link>\n";
        }
        const Eigen::Vector3d odd(random_.uniform(-0.1, 0.1), random_.uniform(-0.1, 0.1), random_.uniform(-0.1, 0.1));
        text << "<joint name='mount' type='fixed'><origin xyz='" << vector(end + length_ * odd) << "' rpy='"
             << vector(20.0 * odd) << "'/><parent link='link" << n_ - 1 << "'/><child link='tool'/></joint>\n"
             << "<link name='tool'/>\n</robot>\n";
        urdf_ = text.str();
        loadedUrdf_ = urdf_;
        const std::string tool = "<link name='tool'/>";
        loadedUrdf_.replace(
            urdf_.find(tool), tool.size(),
            "<link name='tool'><inertial><mass value='" + std::to_string(kLoad_kg) +
                "'/><inertia ixx='1e-5' iyy='1e-5' izz='1e-5' ixy='0' ixz='0' iyz='0'/></inertial></link>");
    }

    void setMotors() {
        RobotDescription robot = loadRobot(folder_);
        RobotModel model(robot);
        Dynamics dynamics;
        JointVector gravity = JointVector::Zero(n_), inertia = gravity, moving = gravity;
        for (int k = 0; k < 40; ++k) {
            JointVector q(n_);
            for (int i = 0; i < n_; ++i)
                q[i] = random_.uniform(robot.limits.position.lower[i], robot.limits.position.upper[i]);
            model.calcDynamics(q, JointVector::Zero(n_), dynamics);
            gravity = gravity.cwiseMax(dynamics.gravity.cwiseAbs());
            inertia = inertia.cwiseMax(dynamics.M.diagonal());
            moving = moving.cwiseMax(dynamics.M.cwiseAbs() * velocity_ / 0.2);
        }
        const bool hasRotors = random_.chance(0.5);
        for (int i = 0; i < n_; ++i) {
            if (hasRotors) rotors_[i] = inertia[i] * random_.logUniform(0.05, 1.0);
            torque_[i] = random_.uniform(1.5, 3.0) * gravity[i] +
                         random_.uniform(1.0, 1.5) * (moving[i] + rotors_[i] * velocity_[i] / 0.2);
        }
    }

    void write(const std::string& urdf) const {
        const auto put = [&](const char* name, const std::string& text) {
            std::ofstream(folder_ / name, std::ios::binary) << text;
        };
        std::filesystem::create_directories(folder_);
        put("arm.urdf", urdf);
        put("limits.yaml", "schema: 1\nacceleration_radps2: " + list(velocity_ / 0.2) + "\njerk_radps3: " +
                               list(velocity_ / 0.2 / 0.05) + "\nhome_rad: " + list(home_) + "\ntool_link: tool\n");
        put("actuation.yaml",
            "schema: 1\ngear_ratio: 1\nrotor_inertia_kgm2: " + list(rotors_) + "\ntorque_limit_Nm: " + list(torque_) +
                "\nfriction: {coulomb_Nm: " + list(0.01 * torque_) + ", viscous_Nm: 0, viscous_velocity_radps: 1}\n");
    }

    Random& random_;
    std::filesystem::path folder_;
    int n_ = 0;
    double length_ = 1.0;
    std::string urdf_, loadedUrdf_;
    JointVector velocity_, rotors_, home_, torque_;
};

double getError(const Summary& s) {
    return std::isnan(s.toolErrorRms()) ? s.commandErrorRms() : s.toolErrorRms();
}

double getTracking(const Summary& s) {
    double worst = 0.0;
    for (int i = 0; i < static_cast<int>(s.jointNames().size()); ++i) worst = std::max(worst, s.trackingRms(i));
    return worst;
}

std::string firstLine(const std::string& text) {
    return text.substr(0, std::min<std::size_t>(text.find('\n'), 260));
}

}  // namespace

bool checkAnyArm(const Options& options) {
    Run run("any_arm", options);
    const PluginLoader loader({VIABLE_PLUGIN_DIR});
    std::map<std::string, std::int64_t> outcomes;
    Figures tracking, ratio;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        const test::TemporaryFolder folder;
        const PlausibleArm arm(random, folder / "arm");
        const double tick_s = kTicks_s[random.integer(0, 2)];
        const std::string controller = kControllers[random.integer(0, 3)];
        const bool isTool = controller == "tool_servo" || controller == "task_space_pd";
        std::ostringstream text;
        text.precision(17);
        text << "schema: 1\ntitle: any arm\nrobot: " << (folder / "arm").string()
             << "\nduration_s: 6\ntick_s: " << tick_s << "\ncommand: ";
        if (isTool)
            text << "{plugin: generated_hand_motion, seed: " << run.arm() << ", reach_m: [" << 0.1 * arm.length()
                 << ", " << 0.1 * arm.length() << ", " << 0.1 * arm.length()
                 << "], rotation_rad: 0.3, top_speed_mps: " << 0.3 * arm.length() << "}\n";
        else
            text << "{plugin: random_steps, seed: " << run.arm() << "}\n";
        text << "controller: {plugin: " << controller << "}\nrobust_loop: {plugin: nric}\n"
             << "real_plant: {plugin: simbody, payload_kg: " << kPayload_kg << "}\n"
             << "cases:\n  real: {filter: {plugin: certified_braking}}\n";
        const std::string file = folder.write("any_arm.yaml", text.str());
        run.addSteps(static_cast<std::int64_t>(6.0 / tick_s) * arm.size());
        std::string outcome, why;
        double error = 0.0, drift = 0.0, freeError = 0.0;
        try {
            const CaseResult result = runCase(configureCase(readExperiment(file, {}, loader, {}).cases.front()), {});
            const Summary& s = result.summary;
            error = getError(s);
            drift = getTracking(s);
            if (result.stopReason != StopReason::None) {
                outcome = "tripped";
                why = result.stopMessage;
            } else {
                tracking.add(drift);
                if (isTool) {
                    std::vector<std::string> free = {
                        "limits={velocity_radps: .inf, acceleration_radps2: .inf, jerk_radps3: .inf}",
                        "cases={real: {filter: {plugin: pass_through}}}", "real_plant={plugin: ideal}",
                        // Motors that cannot follow a nominal arm without limits do not end its run.
                        "robust_loop={plugin: nric, accept_unstable: true}"};
                    if (controller == "tool_servo")  // which needs a jerk limit
                        free[0] = "limits={velocity_radps: 30, acceleration_radps2: 3e3, jerk_radps3: 3e5}";
                    freeError = getError(
                        runCase(configureCase(readExperiment(file, free, loader, {}).cases.front()), {}).summary);
                    if (freeError > 0.0) ratio.add(error / freeError);
                }
                const double spread = s.tool().spread();
                const bool isHeldBack = isTool && !(error <= std::max(kGoodRatio * freeError, kGoodError));
                const bool misses = isTool && error > std::max(kMissedShare * spread, kGoodError);
                const bool isTold = !findProblems(result).empty();
                why = formatVerdict(result);
                outcome = s.anyLimitBroken()                     ? "silent: limit"
                          : !isTold && !(drift <= kGoodTracking) ? "silent: far"
                          : !isTold && misses                    ? "silent: misses"
                          : isTold                               ? "told in the verdict"
                          : isHeldBack                           ? "held back by limits"
                                                                 : "good";
            }
        } catch (const Error& e) {
            outcome = "refused";
            why = e.what();
        }
        ++outcomes[outcome];
        if (outcome != "good")
            std::printf(
                "  arm %lld: %s; %d joints, %.2f m, tick %g s, %s, %s: drift %.4g, error %.4g (free %.4g); %s\n",
                static_cast<long long>(run.arm()), outcome.c_str(), arm.size(), arm.length(), tick_s,
                arm.hasRotors() ? "rotors" : "no rotors", controller.c_str(), drift, error, freeError,
                firstLine(why).c_str());
        // All gains are the arm's own: nothing is to be refused.
        if (outcome.rfind("silent", 0) == 0 || outcome == "refused") run.fail(outcome.c_str(), drift);
    }
    run.print();
    for (const auto& [outcome, count] : outcomes)
        std::printf("  %-16s %lld\n", outcome.c_str(), static_cast<long long>(count));
    std::int64_t all = 0;
    for (const auto& [outcome, count] : outcomes) all += count;
    run.expectShare("good runs, or good but for what limits leave", outcomes["good"] + outcomes["held back by limits"],
                    all, 0.4);
    run.expectShare("runs that were not stopped", all - outcomes["tripped"], all, 0.8);
    tracking.print("real - nominal, RMS of the worst joint [rad]");
    ratio.print("command error over that of the same law without limits and friction");
    return run.isGood();
}

}  // namespace viable
