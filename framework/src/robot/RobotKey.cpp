#include "robot/RobotKey.h"

#include <type_traits>

#include "core/Sha256.h"

namespace viable::detail {

namespace {

// Every member is taken out by name: whoever adds one is told by the compiler.
class KeyHash {
public:
    void add(const RobotDescription& robot) {
        const auto& [name, folder, joints, toolParent, toolLink, toolPlacement, gravity, limits, allowLargeAngles, home,
                     speedLimits, actuation, assumed] = robot;
        static_cast<void>(folder);
        add(name);
        addAll(joints);
        addValue(toolParent);
        add(toolLink);
        add(toolPlacement.matrix());
        add(gravity);
        add(limits);
        addValue(allowLargeAngles);
        add(home);
        add(speedLimits);
        add(actuation);
        addAll(assumed);
    }
    std::string take() { return hash_.take(); }

private:
    template <class T>
    void addValue(T value) {
        static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>, "its bytes are its value");
        hash_.add({reinterpret_cast<const char*>(&value), sizeof value});
    }
    void add(const std::string& text) {
        addValue(text.size());
        hash_.add(text);
    }
    template <class Derived>
    void add(const Eigen::MatrixBase<Derived>& numbers) {
        addValue(numbers.rows());
        addValue(numbers.cols());
        for (Eigen::Index j = 0; j < numbers.cols(); ++j)
            for (Eigen::Index i = 0; i < numbers.rows(); ++i) addValue(double(numbers(i, j)));
    }
    template <class T>
    void addAll(const std::vector<T>& items) {
        addValue(items.size());
        for (const T& item : items) add(item);
    }
    void add(const JointDescription& joint) {
        const auto& [name, childLink, type, parent, placement, axis, body] = joint;
        add(name);
        add(childLink);
        addValue(type);
        addValue(parent);
        add(placement.matrix());
        add(axis);
        const auto& [mass, com, inertia] = body;
        addValue(mass);
        add(com);
        add(inertia);
    }
    void add(const JointLimits& limits) {
        const auto& [position, velocity, acceleration, jerk] = limits;
        for (const JointBounds* bounds : {&position, &velocity, &acceleration, &jerk}) {
            const auto& [lower, upper] = *bounds;
            add(lower);
            add(upper);
        }
    }
    void add(const SpeedLimits& limits) {
        const auto& [arm, tool, regions] = limits;
        addValue(arm);
        addValue(tool);
        addAll(regions);
    }
    void add(const SpeedLimits::Region& region) {
        const auto& [name, lower, upper, speed] = region;
        add(name);
        add(lower);
        add(upper);
        addValue(speed);
    }
    void add(const Actuation& actuation) {
        const auto& [gearRatio, rotorInertia, torqueLimit, encoderCounts, friction] = actuation;
        const auto& [coulomb, viscous, viscousVelocity] = friction;
        for (const JointVector* figures :
             {&gearRatio, &rotorInertia, &torqueLimit, &encoderCounts, &coulomb, &viscous, &viscousVelocity})
            add(*figures);
    }

    Sha256 hash_;
};

}  // namespace

std::string calcRobotKey(const RobotDescription& robot) {
    KeyHash hash;
    hash.add(robot);
    return hash.take();
}

}  // namespace viable::detail
