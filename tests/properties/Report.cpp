#include "Report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace viable {

namespace {

constexpr std::int64_t kEnoughArms = 30, kEnoughCases = 40;

double getSize(double limit) {
    return std::isfinite(limit) ? std::abs(limit) : 1.0;
}

}  // namespace

bool Run::nextArm() {
    if (options_.arm > 0) {
        const bool first = arm_ == 0;
        arm_ = options_.arm;
        return first;
    }
    ++arm_;
    if (done_ < options_.steps) return true;
    --arm_;
    return false;
}

void Run::printRepeat() const {
    std::printf("  repeat: viable_properties %s --seed %llu --arm %lld\n", property_,
                static_cast<unsigned long long>(options_.seed), static_cast<long long>(arm_));
}

void Run::fail(const char* what, double excess, int joint, const AxisState& s, const AxisLimits& l, double tick_s) {
    if (++violations_ > 1) return;
    std::printf("VIOLATION: %s by %.6g, arm %lld, joint %d, tick %g s\n", what, excess, static_cast<long long>(arm_),
                joint, tick_s);
    std::printf("  state p %.17g v %.17g a %.17g\n", s.p, s.v, s.a);
    std::printf("  limits p [%.17g, %.17g] v [%.17g, %.17g] a [%.17g, %.17g] j [%.17g, %.17g]\n", l.positionLower,
                l.positionUpper, l.velocityLower, l.velocityUpper, l.accelerationLower, l.accelerationUpper,
                l.jerkLower, l.jerkUpper);
    printRepeat();
}

void Run::fail(const char* what, double excess) {
    if (++violations_ > 1) return;
    std::printf("VIOLATION: %s by %.6g, arm %lld\n", what, excess, static_cast<long long>(arm_));
    printRepeat();
}

void Run::expectShare(const char* name, std::int64_t count, std::int64_t of, double least) {
    const double share = of > 0 ? static_cast<double>(count) / static_cast<double>(of) : 0.0;
    const bool judged = options_.arm == 0 && arm_ >= kEnoughArms && of >= kEnoughCases;
    std::printf("  %-52s %.3g %% of %lld%s\n", name, 100.0 * share, static_cast<long long>(of),
                judged ? "" : " (too few to judge)");
    if (!judged || share >= least) return;
    ++shortfalls_;
    std::printf("TOO FEW: %s: %.3g %%, expected at least %.3g %%\n", name, 100.0 * share, 100.0 * least);
}

void Run::print() const {
    std::printf("%s: seed %llu, %lld joint steps on %lld arms, %lld violations\n", property_,
                static_cast<unsigned long long>(options_.seed), static_cast<long long>(done_),
                static_cast<long long>(options_.arm > 0 ? 1 : arm_), static_cast<long long>(violations_));
}

void Figures::print(const char* name) {
    if (all_.empty()) return;
    std::sort(all_.begin(), all_.end());
    const auto at = [&](double p) { return all_[static_cast<std::size_t>(p * static_cast<double>(all_.size() - 1))]; };
    std::printf("  %-52s median %.4g, 99 %% %.4g, worst %.4g\n", name, at(0.5), at(0.99), at(1.0));
}

double Figures::worst() const {
    return all_.empty() ? 0.0 : *std::max_element(all_.begin(), all_.end());
}

double calcSize(double lower, double upper, double seen) {
    return std::max({getSize(lower), getSize(upper), std::abs(seen)});
}

}  // namespace viable
