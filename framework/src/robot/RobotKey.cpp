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
        addAll(name, joints, toolParent, toolLink, toolPlacement.matrix(), gravity, limits, allowLargeAngles, home,
               speedLimits, actuation, assumed);
    }
    std::string take() { return hash_.take(); }

private:
    template <class... Members>
    void addAll(const Members&... members) {
        (add(members), ...);
    }
    // Its bytes are its value.
    template <class T, class = std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>>>
    void add(T value) {
        hash_.add({reinterpret_cast<const char*>(&value), sizeof value});
    }
    void add(const std::string& text) {
        add(text.size());
        hash_.add(text);
    }
    template <class Derived>
    void add(const Eigen::MatrixBase<Derived>& numbers) {
        addAll(numbers.rows(), numbers.cols());
        for (Eigen::Index j = 0; j < numbers.cols(); ++j)
            for (Eigen::Index i = 0; i < numbers.rows(); ++i) add(double(numbers(i, j)));
    }
    template <class T>
    void add(const std::vector<T>& items) {
        add(items.size());
        for (const T& item : items) add(item);
    }
    void add(const JointDescription& joint) {
        const auto& [name, childLink, type, parent, placement, axis, body] = joint;
        const auto& [mass, com, inertia] = body;
        addAll(name, childLink, type, parent, placement.matrix(), axis, mass, com, inertia);
    }
    void add(const JointLimits& limits) {
        const auto& [position, velocity, acceleration, jerk] = limits;
        for (const JointBounds* bounds : {&position, &velocity, &acceleration, &jerk}) {
            const auto& [lower, upper] = *bounds;
            addAll(lower, upper);
        }
    }
    void add(const SpeedLimits& limits) {
        const auto& [arm, tool, regions] = limits;
        addAll(arm, tool, regions);
    }
    void add(const SpeedLimits::Region& region) {
        const auto& [name, lower, upper, speed] = region;
        addAll(name, lower, upper, speed);
    }
    void add(const Actuation& actuation) {
        const auto& [gearRatio, rotorInertia, torqueLimit, encoderCounts, friction] = actuation;
        const auto& [coulomb, viscous, viscousVelocity] = friction;
        addAll(gearRatio, rotorInertia, torqueLimit, encoderCounts, coulomb, viscous, viscousVelocity);
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
