#pragma once

#include "environment/EnvironmentSettings.h"
#include "experiment/CasePlan.h"
#include "simulation/CommandStream.h"
#include "tracking/TrackingBound.h"

namespace viable::detail {

/** More filters in a row than anyone needs. */
inline constexpr std::size_t kMaxFilters = 16;

struct PayloadSettings {
    double mass_kg = 0.0;
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();

    template <class V>
    void describe(V& v) {
        v(mass_kg, "payload_kg", "kg",
          "A point mass fixed to the tool that the nominal arm knows: model, filter and real arm have it. A plant's "
          "own payload_kg comes on top of it.")
            .atLeast(0)
            .upTo(1000);
        v(offset, "payload_offset_m", "m", "Where that is, in the tool frame: x, y, z.").atLeast(-10).upTo(10);
    }
};

struct LimitSettings {
    JointLimits limits;
    bool allowsLargeAngles = false, holdsOnReal = false;

    template <class V>
    void describe(V& v) {
        limits.describe(v);
        v(allowsLargeAngles, "allow_large_angles", "Position limits beyond 4 pi are intended, not degrees.");
        v(holdsOnReal, "hold_on", "nominal|real",
          "real: position and velocity limits are those of the real arm; the nominal one gets them tighter by the "
          "tracking bound of the disturbance_set.");
    }
};

struct StartSettings {
    std::optional<PerJoint> position;
    PerJoint velocity = 0.0, acceleration = 0.0;

    template <class V>
    void describe(V& v) {
        v(position, "position_rad", "rad", "Default: the robot's home pose.");
        v(velocity, "velocity_radps", "rad/s", "Of every joint.");
        v(acceleration, "acceleration_radps2", "rad/s^2", "Of every joint.");
    }
};

struct GapSettings {
    double at_s = 0.0;
    std::int64_t count = 0;

    template <class V>
    void describe(V& v) {
        v(at_s, "at_s", "s", "Time of the first missed tick, within the run.").atLeast(0).required();
        // Beyond what the loop bears in a row, so that its answer to that can be tried.
        v(count, "count", "How many ticks are missed.").atLeast(1).upTo(1e6).required();
    }
};

/** What stands at a key of an experiment file. */
enum class KeyForm {
    Setting,  ///< as `spec` says
    Cases,    ///< a map of names to blocks with the keys that differ
    Plugin,   ///< `{plugin: NAME, parameters}`
    Plugins,  ///< the same, or a list of up to kMaxFilters such blocks or names, the first one first
};

/** One key of an experiment file. A required one (without default) must stand at the top or in every case. */
struct ExperimentKey {
    ParameterSpec spec;
    KeyForm form = KeyForm::Setting;
    PluginKind kind = PluginKind::CommandSource;  ///< of Plugin and Plugins
    bool isTopOnly = false;                       ///< must not stand in a case
};

const std::vector<ExperimentKey>& experimentKeys();

std::vector<std::string> listNames(const std::vector<ExperimentKey>& keys);
/** The key called `name`; it must be there. */
const ParameterSpec& getKey(const std::string& name);

}  // namespace viable::detail
