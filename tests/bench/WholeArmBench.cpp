#include <benchmark/benchmark.h>
#include <octomap/OcTree.h>
#include <unistd.h>

#include <random>

#include "Paths.h"
#include "TickTimes.h"
#include "filter/WholeArmBrakingFilter.h"
#include "robot/ArmReach.h"
#include "robot/ArmRecursion.h"
#include "viable/environment/Surroundings.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/RobotModel.h"

// The tick of the whole arm's filter on Indy7 (n = 6), in a workshop as a map with a distance field of a million nodes, stage by stage: the joints alone (certified braking), then with what each guarantee more costs. Random goals, most of
// them behind something. Times are those of single ticks: `p50`, `p99` and `max` of each tick's fastest of some replays, which
// is the filter's own, and `p99_measured` of all, with what the machine does in between [us].

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;
constexpr double kFieldCell_m = 0.027;  // a million nodes around Indy7
constexpr int kTicks = 8000, kTicksPerGoal = 500, kReplays = 5;

struct Stage {
    const char* name;
    bool wholeArm, hasSelf, hasSolids, hasMap, hasTorque, steers;
    int boxes = 0;   ///< more solids, in the arm's reach
    int people = 0;  ///< of four capsules each, who come near and leave again
};
const Stage kStages[] = {
    {"whole_arm_1_joints_only", false, false, false, false, false, false},
    {"whole_arm_2_and_torques", true, false, false, false, true, true},
    {"whole_arm_3_and_self_collision", true, true, false, false, true, true},
    {"whole_arm_4_and_solids", true, true, true, false, true, true},
    {"whole_arm_5_and_map", true, true, true, true, true, true},
    {"whole_arm_5_without_steering", true, true, true, true, true, false},
    {"whole_arm_6_and_people", true, true, true, true, true, true, 0, 4},
};

/** A table, a wall and a pillar of 2 cm cells, clutter behind the pillar; the rest unknown. */
std::filesystem::path writeWorkshop() {
    octomap::OcTree tree(0.02);
    const auto fill = [&](double x0, double x1, double y0, double y1, double z0, double z1) {
        for (double x = x0; x < x1; x += 0.02)
            for (double y = y0; y < y1; y += 0.02)
                for (double z = z0; z < z1; z += 0.02) tree.updateNode(x, y, z, true, true);
    };
    fill(-0.6, 1.0, -0.6, 0.6, -0.09, -0.05);
    fill(0.76, 0.8, -1.0, 1.0, -0.05, 1.2);
    fill(0.3, 0.4, 0.4, 0.5, -0.05, 1.5);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> place(0.0, 1.0);
    for (int i = 0; i < 300; ++i)
        tree.updateNode(-0.8 + 1.4 * place(random), 0.55 + 0.4 * place(random), place(random), true, true);
    tree.updateInnerOccupancy();
    tree.prune();
    const std::filesystem::path file =
        std::filesystem::temp_directory_path() / ("viable-workshop-" + std::to_string(getpid()) + ".bt");
    tree.writeBinary(file.string());
    return file;
}

/** Boxes of 5 to 15 cm anywhere in reach, but not where the arm begins: the first ones are the same for every count. */
void addBoxes(int count, const RobotDescription& robot, Environment& environment) {
    constexpr double kReach_m = 0.9, kLeastRoom_m = 0.3;
    const ArmRecursion recursion(robot);
    ArmRecursion::Frames frames;
    recursion.calcFrames(robot.home, frames);
    std::mt19937_64 random(11);
    std::uniform_real_distribution<> uniform(-1.0, 1.0);
    const auto isFree = [&](const Eigen::Vector3d& place) {
        for (int i = 0; i < robot.size(); ++i) {
            const std::size_t joint = static_cast<std::size_t>(i);
            const Eigen::Vector3d from = i == 0 ? Eigen::Vector3d::Zero() : frames.origin[joint - 1];
            for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0})
                if ((from + share * (frames.origin[joint] - from) - place).norm() < kLeastRoom_m) return false;
        }
        return true;
    };
    while (static_cast<int>(environment.solids.size()) < count) {
        Solid box;
        box.pose.translation() << kReach_m * uniform(random), kReach_m * uniform(random), 0.5 + 0.7 * uniform(random);
        box.size =
            Eigen::Vector3d(0.1, 0.1, 0.1) + 0.05 * Eigen::Vector3d(uniform(random), uniform(random), uniform(random));
        if (!isFree(box.pose.translation())) continue;
        box.name = "box" + std::to_string(environment.solids.size());
        environment.solids.push_back(box);
    }
}

Environment makeEnvironment(const Stage& stage, const RobotDescription& robot, const std::filesystem::path& file) {
    Environment environment;
    addBoxes(stage.boxes, robot, environment);
    if (stage.hasSolids) {
        MovingSphere ball;
        ball.name = "ball";
        ball.radius = 0.08;
        ball.repeats = true;
        ball.waypoints = {{0.0, {0.5, -0.65, 0.3}}, {3.0, {0.5, -0.4, 0.7}}, {6.0, {0.5, -0.65, 0.3}}};
        environment.spheres.push_back(ball);
        Solid beam;
        beam.name = "beam";
        beam.size << 1.5, 0.1, 0.1;
        beam.pose.translation() << 0.0, 0.0, 1.25;
        environment.solids.push_back(beam);
    }
    if (stage.hasMap) {
        environment.map.emplace();
        environment.map->name = "map";
        environment.map->file = file;
        environment.map->unknown = UnknownSpace::Free;
        environment.fieldCell_m = kFieldCell_m;
    }
    return environment;
}

/** From all sides to 1.2 m from the base and back, in 4 s. */
std::vector<Person> makePeople(int count) {
    std::vector<Person> people;
    for (int i = 0; i < count; ++i) {
        Person person;
        person.name = "person" + std::to_string(i);
        person.latency_s = 0.05;
        person.error_m = 0.02;
        const Eigen::AngleAxisd turn(2.0 * M_PI * i / count, Eigen::Vector3d::UnitZ());
        const auto add = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius) {
            person.capsules.push_back({turn * a, turn * b, radius});
        };
        add({0, 0, -0.6}, {0, 0, 0.5}, 0.2);
        add({0, 0, 0.75}, {0, 0, 0.75}, 0.13);
        for (const double side : {-0.25, 0.25}) add({0, side, 0.4}, {-0.35, side, 0.3}, 0.06);
        const Eigen::Vector3d far = turn * Eigen::Vector3d(2.5, 0, 0), near = turn * Eigen::Vector3d(1.2, 0, 0);
        person.walk = {{0.0, far}, {2.0 + 0.1 * i, near}, {4.0, far}};
        person.repeats = true;
        people.push_back(person);
    }
    return people;
}

/** The filter in a closed loop with the nominal arm, recorded, so that the same ticks can be asked again. */
class WholeArmLoop {
public:
    explicit WholeArmLoop(const Stage& stage)
        : robot_(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7")), geometry_(loadArmGeometry(robot_)) {
        if (!stage.hasSelf) geometry_.pairs.clear();
        RobotModel model(robot_);
        const int n = robot_.size();
        MotionState state{robot_.home, JointVector::Zero(n), JointVector::Zero(n)};
        Dynamics dynamics;
        model.calcDynamics(state.q, state.qd, dynamics);
        setup_.emplace(
            RunSetup{robot_, robot_.limits, kTick_s, kTicks * kTick_s, state, dynamics.tool, &geometry_, nullptr});
        WholeArmBrakingOptions options;
        options.joints.kAlpha = 20.0;
        options.steers = stage.steers;
        if (stage.hasTorque) options.torqueShare = 0.6;
        if (stage.hasSolids || stage.hasMap || stage.boxes > 0) {
            const std::filesystem::path file = writeWorkshop();
            const Eigen::AlignedBox3d reach = calcReach(robot_, geometry_, robot_.limits);
            const auto surroundings =
                std::make_shared<Surroundings>(makeEnvironment(stage, robot_, file), reach.min(), reach.max(), 1.0);
            std::filesystem::remove(file);
            nodes_ = (reach.sizes() / kFieldCell_m).prod();
            feed_ = std::make_unique<SurroundingsFeed>(surroundings);
            setup_->surroundings = feed_.get();
        }
        if (stage.people > 0) {
            people_ = std::make_unique<PeopleFeed>(makePeople(stage.people));
            setup_->people = people_.get();
        }
        if (stage.wholeArm) {
            auto filter = std::make_unique<WholeArmBrakingFilter>();
            filter->configure(*setup_, options);
            filter_ = std::move(filter);
        } else {
            auto filter = std::make_unique<CertifiedBrakingFilter>();
            filter->configure(*setup_, options.joints);
            filter_ = std::move(filter);
        }
        record(model);
    }

    void rewind() {
        tick_ = 0;
        filter_->reset(setup_->start);
    }
    /** With people their observation is made and handed over in it, too: under 1 us. */
    FilterStatus step() {
        if (tick_ == states_.size()) rewind();
        seePeople(tick_);
        const FilterStatus status = filter_->filter({states_[tick_], torques_[tick_], dynamics_[tick_]}, decision_);
        ++tick_;
        return status;
    }
    /** Share of ticks in which the stop that is known goes on. */
    double stoppedShare() const { return static_cast<double>(stopped_) / kTicks; }
    double nodes() const { return nodes_; }

private:
    void seePeople(std::size_t tick) {
        if (!people_) return;
        observeWalks(people_->people(), kTick_s * static_cast<double>(tick), seen_);
        people_->put(seen_);
    }

    void record(RobotModel& model) {
        std::mt19937 random(7);
        std::uniform_real_distribution<double> share(-1.0, 1.0);
        MotionState state = setup_->start;
        JointVector goal = robot_.home, torque;
        filter_->reset(state);
        for (int tick = 0; tick < kTicks; ++tick) {
            if (tick % kTicksPerGoal == 0)
                for (double& g : goal) g = 1.8 * share(random);
            dynamics_.emplace_back();
            model.calcDynamics(state.q, state.qd, dynamics_.back());
            const JointVector wanted = 200.0 * (goal - state.q) - 28.0 * state.qd;
            calcInverseDynamics(dynamics_.back(), wanted, torque);
            states_.push_back(state);
            torques_.push_back(torque);
            seePeople(static_cast<std::size_t>(tick));
            stopped_ += filter_->filter({state, torque, dynamics_.back()}, decision_) == FilterStatus::StoppedByPlan;
            advanceNominal(decision_, kTick_s, state);
        }
        rewind();
    }

    RobotDescription robot_;
    ArmGeometry geometry_;
    std::unique_ptr<SurroundingsFeed> feed_;
    std::unique_ptr<PeopleFeed> people_;
    PeopleObservation seen_;
    std::optional<RunSetup> setup_;
    std::unique_ptr<SafetyFilter> filter_;
    FilterDecision decision_;
    std::vector<MotionState> states_;
    std::vector<JointVector> torques_;
    std::vector<Dynamics> dynamics_;
    std::size_t tick_ = 0;
    int stopped_ = 0;
    double nodes_ = 0.0;
};

double findPercentile(std::vector<double> times, double share) {
    std::sort(times.begin(), times.end());
    return times[static_cast<std::size_t>(share * static_cast<double>(times.size() - 1))];
}

void runWholeArm(benchmark::State& state, const Stage& stage) {
    WholeArmLoop loop(stage);
    for (auto _ : state) benchmark::DoNotOptimize(loop.step());
    const TickTimes times = TickTimes::measure(loop, kTicks, kReplays);
    state.counters["n"] = 6;
    state.counters["p50"] = findPercentile(times.fastest, 0.5);
    state.counters["p99"] = findPercentile(times.fastest, 0.99);
    state.counters["max"] = findPercentile(times.fastest, 1.0);
    state.counters["p99_measured"] = findPercentile(times.all, 0.99);
    if (stage.boxes > 0) state.counters["boxes"] = stage.boxes;
    if (stage.people > 0) state.counters["people"] = stage.people;
    state.counters["stopped"] = loop.stoppedShare();
    if (loop.nodes() > 0.0 && stage.hasMap) state.counters["field_nodes"] = loop.nodes();
}

bool registerAll() {
    for (const Stage& stage : kStages)
        benchmark::RegisterBenchmark((std::string(stage.name) + "/n:6").c_str(), runWholeArm, stage)
            ->Iterations(kTicks);
    for (const int boxes : {1, 2, 5, 10, 20, 50, 100}) {
        const Stage stage{"whole_arm_boxes", true, true, false, false, true, true, boxes};
        benchmark::RegisterBenchmark(("whole_arm_boxes/n:6/boxes:" + std::to_string(boxes)).c_str(), runWholeArm, stage)
            ->Iterations(kTicks);
    }
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
