#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <random>

#include "analysis/records/MotionRecord.h"

namespace viable::test {

/** A motion of which everything is known: jerk is constant in each piece. */
class JerkLimitedMotion {
public:
    explicit JerkLimitedMotion(double start) : end_{start, 0.0, 0.0} {}

    void add(double duration_s, double jerk) {
        if (duration_s <= 0.0) return;
        pieces_.push_back({end_s_, jerk, end_});
        end_ = advance(pieces_.back(), duration_s);
        end_s_ += duration_s;
    }
    /** The next piece begins at rest: what rounding has left is dropped. */
    void stop() { end_[1] = end_[2] = 0.0; }

    /** Position, velocity, acceleration, jerk. */
    std::array<double, 4> at(double time_s) const {
        auto next = std::upper_bound(pieces_.begin() + 1, pieces_.end(), time_s,
                                     [](double t, const Piece& piece) { return t < piece.begin_s; });
        const Piece& piece = *(next - 1);
        const auto x = advance(piece, time_s - piece.begin_s);
        return {x[0], x[1], x[2], piece.jerk};
    }
    double position() const { return end_[0]; }
    double end_s() const { return end_s_; }

    /** The same motion with `factor` times the jerk for `duration_s` somewhere within a piece that lasts longer; false
    where there is none between the times. */
    bool exceed(double factor, double duration_s, double from_s, double to_s, std::mt19937_64& random) {
        std::vector<std::size_t> places;
        for (std::size_t i = 0; i + 1 < pieces_.size(); ++i)
            if (pieces_[i].jerk != 0.0 && pieces_[i].begin_s > from_s && pieces_[i + 1].begin_s < to_s &&
                pieces_[i + 1].begin_s - pieces_[i].begin_s > duration_s)
                places.push_back(i);
        if (places.empty()) return false;
        const std::size_t place = places[random() % places.size()];
        JerkLimitedMotion other(pieces_.front().start[0]);
        for (std::size_t i = 0; i < pieces_.size(); ++i) {
            const double length_s = (i + 1 < pieces_.size() ? pieces_[i + 1].begin_s : end_s_) - pieces_[i].begin_s;
            if (i != place) {
                other.add(length_s, pieces_[i].jerk);
                continue;
            }
            const double before_s = std::uniform_real_distribution<double>(0.0, length_s - duration_s)(random);
            other.add(before_s, pieces_[i].jerk);
            other.add(duration_s, factor * pieces_[i].jerk);
            other.add(length_s - duration_s - before_s, pieces_[i].jerk);
        }
        *this = other;
        return true;
    }

private:
    struct Piece {
        double begin_s, jerk;
        std::array<double, 3> start;
    };
    static std::array<double, 3> advance(const Piece& piece, double u) {
        const auto& x = piece.start;
        return {x[0] + u * (x[1] + u * (x[2] / 2.0 + u * piece.jerk / 6.0)), x[1] + u * (x[2] + u * piece.jerk / 2.0),
                x[2] + u * piece.jerk};
    }

    std::vector<Piece> pieces_;
    std::array<double, 3> end_;
    double end_s_ = 0.0;
};

/** Moves from rest to rest with pauses, every move at the jerk limit. */
inline JerkLimitedMotion makeMotion(std::mt19937_64& random, double duration_s, double jerk, double acceleration,
                                    double velocity) {
    const auto draw = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
    JerkLimitedMotion motion(draw(-2.0, 2.0));
    while (motion.end_s() < duration_s) {
        if (draw(0.0, 1.0) < 0.5) motion.add(draw(0.02, 1.0), 0.0);
        double sign = draw(0.0, 1.0) < 0.5 ? 1.0 : -1.0;
        if (std::abs(motion.position()) > 2.0) sign = motion.position() > 0.0 ? -1.0 : 1.0;
        const double a = acceleration * std::exp(draw(-1.5, 0.0)), v = velocity * std::exp(draw(-1.5, 0.0));
        const double ramp_s = a * a / jerk > v ? std::sqrt(v / jerk) : a / jerk;
        const double hold_s = std::max(0.0, v / (jerk * ramp_s) - ramp_s);
        const double cruise_s = draw(0.0, 1.0) < 0.5 ? 0.0 : draw(0.0, 0.5);
        for (const double side : {sign, -sign}) {
            motion.add(ramp_s, side * jerk);
            motion.add(hold_s, 0.0);
            motion.add(ramp_s, -side * jerk);
            if (side == sign) motion.add(cruise_s, 0.0);
        }
        motion.stop();
    }
    return motion;
}

/** A sensor: noise, rounding, outliers, jitter of the stamps, gaps. */
struct Sensor {
    double rate_Hz = 1000.0;
    double count = 0.0;        ///< step that readings are rounded to [rad]
    double noise = 0.0;        ///< standard deviation before rounding [rad]
    double jitter = 0.0;       ///< of the stamps, uniform [sampling intervals]
    double gapRate = 0.0;      ///< probability of a gap of up to 30 readings behind a reading
    double outlierRate = 0.0;  ///< probability of an outlier of 20 to 200 times noise or count
    double duration_s = 5.0;

    MotionRecord sample(const JerkLimitedMotion& motion, std::mt19937_64& random) const {
        const auto draw = [&](double from, double to) {
            return std::uniform_real_distribution<double>(from, to)(random);
        };
        std::normal_distribution<double> normal;
        MotionRecord record;
        record.source = "synthetic";
        record.joints.push_back({"joint", false, {}, {}});
        const double interval_s = 1.0 / rate_Hz;
        for (double s = 0.3 * interval_s; s < duration_s; s += interval_s) {
            const double time_s = s + (jitter > 0.0 ? draw(-jitter, jitter) * interval_s : 0.0);
            double reading = motion.at(time_s)[0] + noise * normal(random);
            if (outlierRate > 0.0 && draw(0.0, 1.0) < outlierRate)
                reading += (draw(0.0, 1.0) < 0.5 ? -1.0 : 1.0) * draw(20.0, 200.0) * std::max(noise, count);
            if (count > 0.0) reading = std::round(reading / count) * count;
            record.times_s.push_back(time_s);
            record.joints[0].positions.push_back(reading);
            if (gapRate > 0.0 && draw(0.0, 1.0) < gapRate) s += draw(1.0, 30.0) * interval_s;
        }
        return record;
    }
};

/** Record `seed` of a population: 12 to 20 bit, noise from 0.1 to 10 counts, 100 Hz to 4 kHz, half of them each with
jitter, gaps and outliers. */
struct SyntheticRecord {
    std::mt19937_64 random;
    double jerk;
    Sensor sensor;
    JerkLimitedMotion motion;
    MotionRecord record;

    explicit SyntheticRecord(std::uint64_t seed) : random(seed), motion(0.0) {
        const auto draw = [&](double from, double to) {
            return std::uniform_real_distribution<double>(from, to)(random);
        };
        const auto drawLog = [&](double from, double to) { return std::exp(draw(std::log(from), std::log(to))); };
        jerk = drawLog(5.0, 200.0);
        const double acceleration = drawLog(2.0, 20.0), velocity = draw(0.5, 3.0);
        sensor.count = 2.0 * M_PI / std::pow(2.0, std::floor(draw(12.0, 21.0)));
        sensor.noise = sensor.count * drawLog(0.1, 10.0);
        sensor.rate_Hz = drawLog(100.0, 4000.0);
        sensor.duration_s = std::min(20.0, draw(3000.0, 12000.0) / sensor.rate_Hz);
        if (draw(0.0, 1.0) < 0.5) sensor.jitter = 0.2;
        if (draw(0.0, 1.0) < 0.5) sensor.gapRate = 0.0005;
        if (draw(0.0, 1.0) < 0.5) sensor.outlierRate = 0.002;
        motion = makeMotion(random, sensor.duration_s + 0.1, jerk, acceleration, velocity);
        record = sensor.sample(motion, random);
    }
};

}  // namespace viable::test
