#pragma once

#include "PoseSpline.h"
#include "viable/plugin/CommandSource.h"

namespace viable {

/** Repeats a recorded motion of a hand or a camera, from wherever the tool is at the start.

Method: with (p_0, R_0) the first sample used, (p, R) the recorded pose at playing time s(t), A
`axes` and dR = R R_0^T,
    position = start position + scale A (p - p_0)
    orientation = A dR^rotation_scale A^T start orientation
(dR^x: the rotation vector times x). The clutch: s' = ds/dt rises from 0 to 1 within `clutch_s` as a
minimum-jerk curve and falls to 0 likewise at the end of the recording, so that the path stays what
was recorded and pose and twist are continuous from the first tick to the last. One pass takes the
recording's length + clutch_s.
With `gaps: hold` each part between gaps is played so, at its time or as soon as the part before it has
ended; in between the tool rests, and the next part begins where it is.
Guarantees: at t = 0 exactly the start pose with zero twist; `toolTwist` is the analytic derivative.
Real time: no allocation, lock or throw after configure(); O(log samples) per call. */
class RecordedPoses : public CommandSource {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override {}  // sample() keeps no memory
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    TickStatus sample(double t, MotionCommand& out) override;

private:
    struct Playing {
        double time, rate;  // s [s] and s'
    };
    /** Of a recording between gaps. */
    struct Part {
        double begin_s;     // when its playing begins, in a pass
        PoseSpline spline;  // relative to the start, base axes, scaled
        double end(double clutch_s) const { return begin_s + spline.duration() + clutch_s; }
    };
    const Part& findPart(double t) const;
    /** @param t  of the pass, in a part or after it */
    Playing calcPlaying(const Part& part, double t) const;

    Pose start_;
    std::vector<Part> parts_;
    double clutch_s_ = 0.0;
    bool reverses_ = false;
};

}  // namespace viable
