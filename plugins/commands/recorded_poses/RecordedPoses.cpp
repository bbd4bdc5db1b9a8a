#include "RecordedPoses.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "viable/core/Error.h"
#include "viable/core/MinimumJerk.h"
#include "viable/core/RotationVector.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

// `axes` may be written with this few decimals; it is made an exact rotation.
constexpr double kAxesTolerance = 1e-3;
// Rotations nearer than this to a half turn have no unique rotation vector to scale. [rad]
constexpr double kHalfTurnMargin_rad = 0.1;

const ParameterSpec kParameters[] = {
    parameter::file("file", nullptr,
                    "Recording: TUM trajectory (`timestamp tx ty tz qx qy qz qw`), or CSV whose first line "
                    "names `time_s,x_m,y_m,z_m,qx,qy,qz,qw` in any order; `#` begins a comment line."),
    parameter::number("start_s", "s", "0", "The motion begins this far into the recording.").atLeast(0),
    parameter::number("scale", "", "1", "Displacements are multiplied by this.").atLeast(0).upTo(100),
    parameter::number("rotation_scale", "", "1", "Rotation vectors are multiplied by this.").atLeast(0).upTo(2),
    parameter::numbers("axes", "", 9, 9, "[1, 0, 0, 0, 1, 0, 0, 0, 1]",
                       "Rotation matrix, row by row, from the recording's to the base's axes."),
    parameter::number("clutch_s", "s", "1",
                      "Playing speeds up from standstill, and slows down at the end, within this "
                      "time.")
        .above(0),
    parameter::choice("at_end", "hold|reverse", "reverse", "At the end of the recording: stay, or run back and forth."),
    parameter::number("smoothing_s", "s", "0.02",
                      "Standard deviation of the zero-phase Gaussian that takes noise out; 0: none.")
        .atLeast(0)
        .upTo(0.5),
    parameter::number("max_gap_s", "s", "0.2", "Longest time between two samples.").above(0),
};

Eigen::Matrix3d readAxes(const Parameters& parameters) {
    const std::vector<double>& rows = parameters.numbers("axes");
    Eigen::Matrix3d axes;
    for (int i = 0; i < 9; ++i) axes(i / 3, i % 3) = rows[static_cast<std::size_t>(i)];
    const double deviation = (axes * axes.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    const double determinant = axes.determinant();
    if (!(deviation <= kAxesTolerance) || determinant < 0.0) {
        char message[200];
        std::snprintf(message, sizeof message,
                      "axes is not a rotation: its rows deviate by %.3g from unit length and right "
                      "angles (at most %g), and its determinant is %.6g instead of 1",
                      deviation, kAxesTolerance, determinant);
        throw badInput(parameters.place("axes"), message,
                       "Give the recording's axes seen from the robot's base, row by row");
    }
    return Eigen::Quaterniond(axes).normalized().toRotationMatrix();
}

// The used part, relative to its first pose, in base axes and scaled.
std::vector<TimedPose> makeRelative(const std::vector<TimedPose>& samples, std::size_t first,
                                    const Parameters& parameters) {
    const Eigen::Matrix3d axes = readAxes(parameters);
    const double scale = parameters.number("scale");
    const double rotationScale = parameters.number("rotation_scale");
    const TimedPose& origin = samples[first];
    std::vector<TimedPose> result;
    result.reserve(samples.size() - first);
    result.push_back({0.0, Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity()});
    for (std::size_t i = first + 1; i < samples.size(); ++i) {
        const TimedPose& now = samples[i];
        Eigen::Quaterniond turn = now.orientation * origin.orientation.conjugate();
        turn.vec() = axes * turn.vec();
        if (rotationScale != 1.0) {
            const Eigen::Vector3d r = calcRotationVector(turn);
            if (r.norm() > kPi - kHalfTurnMargin_rad) {
                char message[200];
                std::snprintf(message, sizeof message,
                              "rotation_scale cannot be %g: at %.3f s the recording has turned by "
                              "%.4g rad from "
                              "its beginning, and a half turn has no unique direction to scale",
                              rotationScale, now.time_s, r.norm());
                throw badInput(parameters.place("rotation_scale"), message,
                               "Set rotation_scale to 1 or use another part of the recording");
            }
            turn = calcRotation(rotationScale * r);
        }
        result.push_back({now.time_s - origin.time_s, scale * axes * (now.position - origin.position), turn});
    }
    return result;
}

}  // namespace

void RecordedPoses::configure(const RunSetup& setup, const Parameters& parameters) {
    start_ = setup.startTool;
    clutch_s_ = parameters.number("clutch_s");
    reverses_ = parameters.text("at_end") == "reverse";
    const std::filesystem::path& file = parameters.file("file");
    const std::vector<TimedPose> samples =
        smooth(readPoseRecording(file, {parameters.number("max_gap_s")}), parameters.number("smoothing_s"));

    const double start = parameters.number("start_s");
    const auto first =
        static_cast<std::size_t>(std::lower_bound(samples.begin(), samples.end(), start,
                                                  [](const TimedPose& s, double t) { return s.time_s < t; }) -
                                 samples.begin());
    char message[200];
    if (first + kFewestSamples > samples.size()) {
        std::snprintf(message, sizeof message,
                      "start_s = %g s leaves %zu samples of a recording of %.6g s, but at least "
                      "%zu are needed",
                      start, samples.size() - first, samples.back().time_s, kFewestSamples);
        throw badInput(parameters.place("start_s"), message, "Begin earlier in " + file.string());
    }
    spline_.fit(makeRelative(samples, first, parameters));
    if (clutch_s_ > spline_.duration()) {
        std::snprintf(message, sizeof message,
                      "clutch_s = %g s is longer than the part of the recording in use, %.6g s", clutch_s_,
                      spline_.duration());
        throw badInput(parameters.place("clutch_s"), message,
                       "Give a shorter time or a longer part of " + file.string());
    }
}

void RecordedPoses::reset(const MotionState&) {}  // sample() keeps no memory

RecordedPoses::Playing RecordedPoses::calcPlaying(double t) const {
    const double length = spline_.duration();
    const double pass = length + clutch_s_;
    bool backwards = false;
    if (reverses_) {
        t = std::fmod(t, 2.0 * pass);
        backwards = t > pass;
        if (backwards) t = 2.0 * pass - t;
    }
    Playing playing{length, 0.0};
    if (t < clutch_s_) {
        const double u = t / clutch_s_;
        playing = {clutch_s_ * calcMinimumJerkIntegral(u), calcMinimumJerk(u).value};
    } else if (t <= length) {
        playing = {t - 0.5 * clutch_s_, 1.0};
    } else if (t < pass) {
        const double u = (pass - t) / clutch_s_;
        playing = {length - clutch_s_ * calcMinimumJerkIntegral(u), calcMinimumJerk(u).value};
    }
    if (backwards) playing.rate = -playing.rate;
    return playing;
}

TickStatus RecordedPoses::sample(double t, MotionCommand& out) {
    if (!(t >= 0.0) || !std::isfinite(t)) return TickStatus::InvalidInput;
    const Playing playing = calcPlaying(t);
    Pose relative;
    Vector6 rate;
    spline_.calc(playing.time, relative, rate);
    out.space = MotionCommand::Space::Tool;
    out.tool.position = start_.position + relative.position;
    out.tool.orientation = relative.orientation * start_.orientation;
    out.toolTwist = playing.rate * rate;
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::CommandSource, viable::RecordedPoses, "recorded_poses",
              "A recorded motion of a hand or camera (TUM trajectory or CSV).", viable::kParameters)
