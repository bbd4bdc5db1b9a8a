#pragma once

#include "viable/plugin/PluginExport.h"

/** Healthy plugins to spoil: each fixture derives from one and does one thing wrong. */
namespace broken {

/** Passes the desired torque through, as the filter `pass_through` does. */
class Filter : public viable::SafetyFilter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters&) override { tick_s_ = setup.tick_s; }
    void reset(const viable::MotionState&) override { ticks_ = 0; }
    viable::FilterTraits traits() const override { return {}; }
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override;

protected:
    double tick_s_ = 0.0;
    std::int64_t ticks_ = 0;  ///< filter() calls since reset, the present one included
};

/** When a fault begins. */
struct LateOptions {
    std::int64_t afterTicks = 0;

    template <class V>
    void describe(V& v) {
        v(afterTicks, "after_ticks", "Ticks that pass before the fault.").atLeast(0);
    }
};

/** Misbehaves in every tick after the first `after_ticks`. */
class LateFilter : public Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        afterTicks_ = parameters.get<LateOptions>().afterTicks;
    }
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override {
        const viable::FilterStatus status = Filter::filter(input, decision);
        if (ticks_ > afterTicks_) misbehave(decision);
        return status;
    }

private:
    /** @param decision  a healthy one */
    virtual void misbehave(viable::FilterDecision& decision) = 0;

    std::int64_t afterTicks_ = 0;
};

/** Asks for the torque at which the nominal arm does not accelerate. */
class Controller : public viable::NominalController {
public:
    void configure(const viable::RunSetup&, const viable::Parameters&) override {}
    void reset(const viable::MotionState&) override { ticks_ = 0; }
    viable::ControllerTraits traits() const override { return {true, true}; }
    viable::TickStatus compute(const viable::ControllerInput& input, viable::ControllerOutput& output) override {
        ++ticks_;
        output.torque = input.dynamics.b;
        return viable::TickStatus::Ok;
    }

protected:
    std::int64_t ticks_ = 0;  ///< compute() calls since reset, the present one included
};

/** Set-points of the joints about where the arm starts. */
class Command : public viable::CommandSource {
public:
    void reset(const viable::MotionState& start) override { start_ = start.q; }
    viable::CommandTraits traits() const override { return {viable::MotionCommand::Space::Joint}; }

protected:
    /** To rest so far from the start [rad]. */
    viable::TickStatus setPoint(double offset, viable::MotionCommand& out) const {
        out.space = viable::MotionCommand::Space::Joint;
        out.q = start_.array() + offset;
        out.qd.setZero(start_.size());
        return viable::TickStatus::Ok;
    }

private:
    viable::JointVector start_;
};

/** When a fault begins and how long it lasts. */
struct FaultWindow {
    LateOptions begin;
    std::int64_t ticks = 1;

    template <class V>
    void describe(V& v) {
        begin.describe(v);
        v(ticks, "ticks", "Ticks that the fault lasts.").atLeast(0);
    }
    /** @param tick  1 in the first tick */
    bool contains(std::int64_t tick) const { return tick > begin.afterTicks && tick - begin.afterTicks <= ticks; }
};

}  // namespace broken
