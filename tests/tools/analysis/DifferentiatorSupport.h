#pragma once

#include <Eigen/Dense>
#include <cmath>

#include "analysis/records/MotionRecord.h"

namespace viable::test {

/** Settings that are tried of a differentiator. */
inline constexpr std::size_t kSettings = 24;

inline double getSetting(std::size_t k, double from, double to) {
    return from * std::pow(to / from, static_cast<double>(k) / (kSettings - 1));
}

/** Usual ways to a jerk, all for equally spaced samples: readings are put on such a grid by straight lines. */
class Grid {
public:
    Grid(const MotionRecord& record, double rate_Hz) : interval_s_(1.0 / rate_Hz), begin_s_(record.times_s.front()) {
        const auto& times = record.times_s;
        const auto& readings = record.joints[0].positions;
        std::size_t i = 0;
        for (double t = begin_s_; t <= times.back(); t += interval_s_) {
            while (i + 2 < times.size() && times[i + 1] < t) ++i;
            const double share = (t - times[i]) / (times[i + 1] - times[i]);
            values_.push_back(readings[i] + share * (readings[i + 1] - readings[i]));
        }
    }
    std::size_t size() const { return values_.size(); }
    double time(std::size_t i) const { return begin_s_ + interval_s_ * static_cast<double>(i); }
    double begin_s() const { return begin_s_; }
    double end_s() const { return time(size() - 1); }

    /** Central third differences. */
    std::vector<double> calcFiniteDifferences() const { return differentiate(values_); }

    /** Third derivative of the polynomial of degree 5 fitted to a window about each sample (Savitzky and Golay 1964). */
    std::vector<double> calcSavitzkyGolay(double window_s) const {
        const int half = std::max(3, static_cast<int>(std::lround(0.5 * window_s / interval_s_)));
        const int n = 2 * half + 1;
        Eigen::MatrixXd powers(n, 6);
        for (int row = 0; row < n; ++row)
            for (int column = 0; column < 6; ++column)
                powers(row, column) = std::pow(static_cast<double>(row - half) / half, column);
        const Eigen::MatrixXd solved = powers.householderQr().solve(Eigen::MatrixXd::Identity(n, n));
        const double unit = 6.0 / std::pow(half * interval_s_, 3.0);
        std::vector<double> jerk(size(), 0.0);
        for (std::size_t i = static_cast<std::size_t>(half); i + static_cast<std::size_t>(half) < size(); ++i)
            for (int k = 0; k < n; ++k)
                jerk[i] += unit * solved(3, k) * values_[i + std::size_t(k) - std::size_t(half)];
        return jerk;
    }

    /** Butterworth of order 4 forwards and backwards, then central differences. */
    std::vector<double> calcButterworth(double cutoff_Hz) const {
        const double k = std::tan(M_PI * std::min(cutoff_Hz * interval_s_, 0.45));
        std::vector<double> x = values_;
        for (double& v : x) v -= values_.front();
        for (int pass = 0; pass < 2; ++pass) {
            for (const double q : {0.54119610014619698, 1.3065629648763766}) {
                const double norm = 1.0 / (1.0 + k / q + k * k);
                const double b = k * k * norm, a1 = 2.0 * (k * k - 1.0) * norm, a2 = (1.0 - k / q + k * k) * norm;
                double x1 = x[0], x2 = x[0], y1 = x[0], y2 = x[0];
                for (double& v : x) {
                    const double y = b * (v + 2.0 * x1 + x2) - a1 * y1 - a2 * y2;
                    x2 = x1;
                    x1 = v;
                    y2 = y1;
                    y1 = y;
                    v = y;
                }
            }
            std::reverse(x.begin(), x.end());
        }
        return differentiate(x);
    }

private:
    std::vector<double> differentiate(const std::vector<double>& x) const {
        std::vector<double> jerk(x.size(), 0.0);
        for (std::size_t i = 2; i + 2 < x.size(); ++i)
            jerk[i] = (x[i + 2] - 2.0 * x[i + 1] + 2.0 * x[i - 1] - x[i - 2]) / (2.0 * std::pow(interval_s_, 3.0));
        return jerk;
    }

    double interval_s_, begin_s_;
    std::vector<double> values_;
};

}  // namespace viable::test
