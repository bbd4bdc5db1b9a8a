#include "analysis/smoothing/Smoothing.h"

#include "Complaint.h"
#include "DifferentiatorSupport.h"
#include "Effort.h"
#include "SyntheticRecord.h"
#include "analysis/smoothing/BandedLdl.h"
#include "analysis/smoothing/Readings.h"

// Is what the smoothing says true, and is its error what it says it is?

namespace viable::test {
namespace {

/** A record of one wide move, with the noise as told. */
struct Wave {
    std::vector<double> times_s, readings;
    static double position(double t) { return 0.8 * std::sin(2.0 * t) + 0.3 * std::sin(5.0 * t + 1.0); }
    static std::array<double, 4> truth(double t) {
        return {position(t), 1.6 * std::cos(2.0 * t) + 1.5 * std::cos(5.0 * t + 1.0),
                -3.2 * std::sin(2.0 * t) - 7.5 * std::sin(5.0 * t + 1.0),
                -6.4 * std::cos(2.0 * t) - 37.5 * std::cos(5.0 * t + 1.0)};
    }
    explicit Wave(double noise, std::size_t n = 3000, double interval_s = 1e-3) {
        std::mt19937_64 random(7);
        std::normal_distribution<double> normal;
        for (std::size_t i = 0; i < n; ++i) {
            times_s.push_back(interval_s * static_cast<double>(i));
            readings.push_back(position(times_s.back()) + noise * normal(random));
        }
    }
};

std::string refuse(const std::vector<double>& times_s, const std::vector<double>& readings) {
    return test::catchError([&] { smoothMotion(times_s, readings, "file.csv: joint a"); });
}

TEST(BandedLdl, AgreesWithDenseAlgebra) {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    for (const std::size_t blocks : {1u, 2u, 7u}) {
        detail::BandedLdl banded(blocks);
        const int n = static_cast<int>(4 * blocks);
        Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(n, n);
        if (blocks == 1)
            for (int i = 0; i < n; ++i) banded.upd(std::size_t(i), std::size_t(i)) = dense(i, i) = 1.0 + i;
        for (std::size_t k = 0; k + 1 < blocks; ++k) {
            Eigen::Matrix<double, 8, 8> root;
            for (int i = 0; i < 64; ++i) root(i) = normal(random);
            const Eigen::Matrix<double, 8, 8> part = root * root.transpose();
            banded.addPair(k, part);
            dense.block(static_cast<int>(4 * k), static_cast<int>(4 * k), 8, 8) += part;
        }
        ASSERT_TRUE(banded.factor());
        EXPECT_NEAR(banded.calcLogDeterminant(), std::log(dense.determinant()), 1e-9 * n);
        std::vector<double> x(static_cast<std::size_t>(n));
        Eigen::VectorXd right(n);
        for (int i = 0; i < n; ++i) right[i] = x[std::size_t(i)] = normal(random);
        banded.solve(x);
        const Eigen::VectorXd expected = dense.ldlt().solve(right);
        for (int i = 0; i < n; ++i) EXPECT_NEAR(x[std::size_t(i)], expected[i], 1e-8 * expected.norm());
        banded.calcInverseBand();
        const Eigen::MatrixXd inverse = dense.inverse();
        for (int j = 0; j < n; ++j)
            for (int i = j; i < std::min(n, 4 * (j / 4 + 2)); ++i)
                EXPECT_NEAR(banded.getInverse(std::size_t(i), std::size_t(j)), inverse(i, j), 1e-8 * inverse.norm());
    }
}

TEST(BandedLdl, RefusesWhatIsNotPositiveDefinite) {
    detail::BandedLdl banded(2);
    for (std::size_t i = 0; i < 8; ++i) banded.upd(i, i) = i == 5 ? -1.0 : 1.0;
    EXPECT_FALSE(banded.factor());
}

TEST(Smoothing, BandsAreAsWideAsTheErrorIs) {
    const int records = countOf(60);
    std::array<double, 4> inside{}, looks{};
    for (int seed = 1; seed <= records; ++seed) {
        const SyntheticRecord one(static_cast<std::uint64_t>(seed));
        const auto motion = smoothMotion(one.record.times_s, one.record.joints[0].positions, "synthetic");
        const double guard_s = 2.0 * motion.window_s();  // away from the ends
        for (const double t : one.record.times_s) {
            if (t < motion.begin_s() + guard_s || t > motion.end_s() - guard_s) continue;
            const MotionEstimate e = motion.evaluate(t);
            const auto truth = one.motion.at(t);
            for (std::size_t order = 0; order < 4; ++order) {
                ++looks[order];
                if (std::abs(e.mean[order] - truth[order]) < 1.96 * e.deviation[order]) ++inside[order];
            }
        }
    }
    const char* names[] = {"position", "velocity", "acceleration", "jerk"};
    for (std::size_t order = 0; order < 4; ++order) {
        const double share = inside[order] / looks[order];
        std::printf("%s: %.2f %% of %.0f samples of %d records (seeds 1 to %d) lie in the 95 %% band\n", names[order],
                    100.0 * share, looks[order], records, records);
        EXPECT_GE(share, 0.93) << names[order];
        EXPECT_LE(share, 0.97) << names[order];
    }
}

TEST(Smoothing, JerkIsNearerToTheTruthThanOfUsualDifferentiators) {
    const int records = countOf(40);
    // Root mean square errors of the jerk, over the jerk limit: one per record and method.
    std::vector<double> own, differences;
    std::vector<std::vector<double>> polynomials(kSettings), butterworths(kSettings);
    for (int seed = 1; seed <= records; ++seed) {
        const SyntheticRecord one(static_cast<std::uint64_t>(seed));
        const Grid grid(one.record, one.sensor.rate_Hz);
        const auto motion = smoothMotion(one.record.times_s, one.record.joints[0].positions, "synthetic");
        const double guard_s = std::max(2.0 * motion.window_s(), 0.1);
        if (grid.end_s() - grid.begin_s() < 4.0 * guard_s) continue;
        const auto rms = [&](const auto& estimate) {
            double sum = 0.0, n = 0.0;
            for (std::size_t i = 0; i < grid.size(); ++i) {
                const double t = grid.time(i);
                if (t < grid.begin_s() + guard_s || t > grid.end_s() - guard_s) continue;
                const double error = estimate(i) - one.motion.at(t)[3];
                sum += error * error;
                ++n;
            }
            return std::sqrt(sum / n) / one.jerk;
        };
        own.push_back(rms([&](std::size_t i) { return motion.evaluate(grid.time(i)).mean[3]; }));
        const auto take = [&](const std::vector<double>& jerk) { return rms([&](std::size_t i) { return jerk[i]; }); };
        differences.push_back(take(grid.calcFiniteDifferences()));
        for (std::size_t k = 0; k < kSettings; ++k) {
            polynomials[k].push_back(take(grid.calcSavitzkyGolay(getSetting(k, 0.01, 0.6))));
            butterworths[k].push_back(take(grid.calcButterworth(getSetting(k, 1.0, 120.0))));
        }
    }
    ASSERT_GT(2 * own.size(), static_cast<std::size_t>(records));
    const double n = static_cast<double>(own.size());
    const auto pool = [&](const std::vector<double>& errors) {  // root mean square over all records
        double sum = 0.0;
        for (const double e : errors) sum += e * e / n;
        return std::sqrt(sum);
    };
    const auto typical = [&](const std::vector<double>& errors) {  // geometric mean
        double sum = 0.0;
        for (const double e : errors) sum += std::log(e) / n;
        return std::exp(sum);
    };
    // Tuned by hand: one setting for all records, the best there is by a truth that nobody knows.
    const auto best = [](const std::vector<std::vector<double>>& settings, const auto& measure) {
        double least = kInfinity;
        for (const auto& one : settings) least = std::min(least, measure(one));
        return least;
    };
    // Tuned for each record by somebody who knows its truth: a bound for what tuning can give.
    const auto bestOfEach = [&](const std::vector<std::vector<double>>& settings) {
        std::vector<double> least(own.size(), kInfinity);
        for (const auto& one : settings)
            for (std::size_t i = 0; i < own.size(); ++i) least[i] = std::min(least[i], one[i]);
        return least;
    };
    std::printf("RMS error of the jerk over this smoothing's, %zu records\n", own.size());
    const auto print = [&](const char* name, double all, double geometric) {
        std::printf("  %-58s all records %8.3g, geometric mean %8.3g\n", name, all, geometric);
    };
    print("finite differences", pool(differences) / pool(own), typical(differences) / typical(own));
    print("Savitzky-Golay, one window for all", best(polynomials, pool) / pool(own),
          best(polynomials, typical) / typical(own));
    print("zero-phase Butterworth, one cut-off for all", best(butterworths, pool) / pool(own),
          best(butterworths, typical) / typical(own));
    const auto idealPolynomials = bestOfEach(polynomials), idealButterworths = bestOfEach(butterworths);
    // Tuned by hand on one record, by its truth, and used for the others: all pairs.
    const auto onAnother = [&](const std::vector<std::vector<double>>& settings) {
        double logarithms = 0.0, squares = 0.0;
        for (std::size_t tuned = 0; tuned < own.size(); ++tuned) {
            std::size_t setting = 0;
            for (std::size_t k = 1; k < settings.size(); ++k)
                if (settings[k][tuned] < settings[setting][tuned]) setting = k;
            for (std::size_t i = 0; i < own.size(); ++i)
                if (i != tuned) {
                    logarithms += std::log(settings[setting][i] / own[i]) / (n * (n - 1.0));
                    squares += settings[setting][i] * settings[setting][i] / (n * (n - 1.0));
                }
        }
        return std::pair(std::sqrt(squares) / pool(own), std::exp(logarithms));
    };
    const auto otherPolynomial = onAnother(polynomials), otherButterworth = onAnother(butterworths);
    print("Savitzky-Golay, tuned on another record", otherPolynomial.first, otherPolynomial.second);
    print("zero-phase Butterworth, tuned on another record", otherButterworth.first, otherButterworth.second);
    print("Savitzky-Golay, for each record by its truth", pool(idealPolynomials) / pool(own),
          typical(idealPolynomials) / typical(own));
    print("zero-phase Butterworth, for each record by its truth", pool(idealButterworths) / pool(own),
          typical(idealButterworths) / typical(own));
    EXPECT_GT(pool(differences), 3.0 * pool(own));
    EXPECT_GT(otherPolynomial.first, 3.0);
    EXPECT_GT(otherButterworth.first, 3.0);
    EXPECT_GT(otherPolynomial.second, 2.5);
    EXPECT_GT(otherButterworth.second, 2.5);
    EXPECT_GT(best(polynomials, pool), 1.5 * pool(own));
    EXPECT_GT(best(butterworths, pool), 1.5 * pool(own));
    EXPECT_GT(typical(idealPolynomials), typical(own));
    EXPECT_GT(typical(idealButterworths), typical(own));
}

TEST(Smoothing, TimeGrowsWithTheNumberOfSamples) {
    std::vector<double> seconds;
    for (const std::size_t n : {1000u, 10000u, 100000u, 1000000u}) {
        Wave wave(2.4e-5, n);
        for (double& q : wave.readings) q = std::round(q / 2.4e-5) * 2.4e-5;  // 18 bit
        const std::clock_t begin = std::clock();
        const auto motion = smoothMotion(wave.times_s, wave.readings, "wave");
        const std::clock_t smoothed = std::clock();
        double sum = 0.0;
        for (const double t : wave.times_s) sum += motion.evaluate(t).deviation[3];  // a band at each sample
        seconds.push_back(static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
        std::printf("%8zu samples: %.3f s of one core, of it %.3f s for the bands at all samples\n", n, seconds.back(),
                    static_cast<double>(std::clock() - smoothed) / CLOCKS_PER_SEC);
        EXPECT_GT(sum, 0.0);
    }
    EXPECT_LT(seconds[3], 30.0 * seconds[2]);  // 10 times where nothing else runs
    EXPECT_LT(seconds[3], 300.0 * seconds[1]);
}

TEST(Smoothing, FindsMotionAndNoiseOfAWave) {
    const Wave wave(1e-4);
    const auto motion = smoothMotion(wave.times_s, wave.readings, "wave");
    EXPECT_NEAR(motion.noise(), 1e-4, 4e-6);
    EXPECT_EQ(motion.quantum(), 0.0);
    EXPECT_TRUE(motion.outliers().empty());
    const double bounds[] = {5e-5, 4e-3, 0.2, 10.0};  // of 1, 3, 10 and 40
    for (double t = 0.3; t < 2.7; t += 0.01) {
        const MotionEstimate e = motion.evaluate(t);
        for (std::size_t order = 0; order < 4; ++order)
            EXPECT_NEAR(e.mean[order], Wave::truth(t)[order], bounds[order]) << "order " << order << " at " << t;
    }
}

TEST(Smoothing, ConstantJerkIsReproducedToRounding) {
    std::vector<double> times_s, readings;
    for (int i = 0; i < 500; ++i) {
        const double t = 1e-3 * i;
        times_s.push_back(t);
        readings.push_back(1.0 + t * (0.5 + t * (-1.0 + t * 7.0)));
    }
    const auto motion = smoothMotion(times_s, readings, "cubic");
    const MotionEstimate e = motion.evaluate(0.25);
    EXPECT_NEAR(e.mean[0], 1.0 + 0.25 * (0.5 + 0.25 * (-1.0 + 0.25 * 7.0)), 1e-12);
    EXPECT_NEAR(e.mean[1], 0.5 - 0.5 + 21.0 / 16.0, 1e-9);
    EXPECT_NEAR(e.mean[2], -2.0 + 10.5, 1e-6);
    EXPECT_NEAR(e.mean[3], 42.0, 1e-3);
}

TEST(Smoothing, UnitsAndOriginsDoNotMatter) {
    const Wave wave(1e-4, 2000);
    const auto plain = smoothMotion(wave.times_s, wave.readings, "wave");
    std::vector<double> times_s = wave.times_s, readings = wave.readings;
    for (double& t : times_s) t = 1000.0 * t + 5000.0;  // milliseconds, later
    for (double& q : readings) q = 3.0 - 40.0 * q;
    const auto other = smoothMotion(times_s, readings, "wave");
    EXPECT_NEAR(other.noise(), 40.0 * plain.noise(), 1e-6 * other.noise());
    EXPECT_NEAR(other.window_s(), 1000.0 * plain.window_s(), 1e-6 * other.window_s());
    for (double t = 0.1; t < 1.9; t += 0.1) {
        const MotionEstimate a = plain.evaluate(t), b = other.evaluate(1000.0 * t + 5000.0);
        EXPECT_NEAR(b.mean[0], 3.0 - 40.0 * a.mean[0], 1e-6);
        for (std::size_t order = 1; order < 4; ++order) {
            const double scale = 40.0 * std::pow(1e-3, double(order));
            EXPECT_NEAR(b.mean[order], -scale * a.mean[order], 1e-3 * scale * a.deviation[order]);
            EXPECT_NEAR(b.deviation[order], scale * a.deviation[order], 1e-3 * scale * a.deviation[order]);
        }
    }
}

TEST(Smoothing, MeansOfTheJerkAreKnownBetterThanTheJerk) {
    // The error of a mean, over its deviation, must be of size 1: over many records.
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    double squares = 0.0, n = 0.0, gain = 0.0;
    for (int record = 0; record < 30; ++record) {
        Wave wave(0.0, 2000);
        for (double& q : wave.readings) q += 3e-5 * normal(random);
        const auto motion = smoothMotion(wave.times_s, wave.readings, "wave");
        for (const MeanEstimate& m : motion.calcMeans(3, 0.15)) {
            if (m.begin_s < 0.3 || m.begin_s + m.duration_s > 1.7) continue;
            EXPECT_LE(m.duration_s, 0.15);
            const double truth = (Wave::truth(m.begin_s + m.duration_s)[2] - Wave::truth(m.begin_s)[2]) / m.duration_s;
            squares += std::pow((m.mean - truth) / m.deviation, 2.0);
            gain += motion.evaluate(m.begin_s).deviation[3] / m.deviation;
            ++n;
        }
    }
    ASSERT_GT(n, 100.0);
    EXPECT_GT(squares / n, 0.4);  // a wave is smoother than the model thinks
    EXPECT_LT(squares / n, 1.4);
    EXPECT_GT(gain / n, 1.5);
}

TEST(Smoothing, OutliersAreFoundAndHarmless) {
    const Wave clean(1e-4);
    Wave wave = clean;
    const std::vector<std::size_t> places = {100, 777, 778, 1500, 2222, 2990};  // two of them next to each other
    for (const std::size_t i : places) wave.readings[i] += i % 2 ? 0.01 : -0.5;
    const auto motion = smoothMotion(wave.times_s, wave.readings, "wave");
    EXPECT_EQ(motion.outliers(), places);
    ASSERT_EQ(motion.outlierRuns().size(), 5u);
    EXPECT_EQ(motion.outlierRuns()[1].count, 2);
    EXPECT_NEAR(motion.outlierRuns()[0].distance, 0.5, 1e-3);
    const auto without = smoothMotion(clean.times_s, clean.readings, "wave");
    for (double t = 0.0; t < 2.999; t += 0.01)
        EXPECT_NEAR(motion.evaluate(t).mean[3], without.evaluate(t).mean[3], 3.0 * without.evaluate(t).deviation[3])
            << t;
}

TEST(Smoothing, BandOpensInAGap) {
    Wave wave(1e-4);
    for (std::size_t i = 1000; i < 1240; ++i) wave.readings[i] = kNan;
    const auto motion = smoothMotion(wave.times_s, wave.readings, "wave");
    for (std::size_t order = 0; order < 4; ++order) {
        const double middle = motion.evaluate(1.12).deviation[order], elsewhere = motion.evaluate(0.7).deviation[order];
        EXPECT_GT(middle, 1.3 * elsewhere) << order;
        EXPECT_LT(std::abs(motion.evaluate(1.12).mean[order] - Wave::truth(1.12)[order]), 4.0 * middle) << order;
    }
}

TEST(Smoothing, LongGapsPartTheRecord) {
    Wave wave(1e-4, 2000);
    std::vector<double> times_s = wave.times_s;
    for (std::size_t i = 1000; i < times_s.size(); ++i) times_s[i] += 1e6;  // no knots in between: memory stays small
    const auto motion = smoothMotion(times_s, wave.readings, "wave");
    EXPECT_NEAR(motion.noise(), 1e-4, 6e-6);
    EXPECT_NEAR(motion.evaluate(1e6 + 1.5).mean[1], Wave::truth(1.5)[1], 4e-3);
    EXPECT_NEAR(motion.evaluate(0.5).mean[1], Wave::truth(0.5)[1], 4e-3);
}

TEST(Smoothing, StepOfRoundedReadingsIsFound) {
    for (const double count : {2.0 * M_PI / 4096.0, 2.0 * M_PI / 65536.0 / 121.0}) {
        Wave wave(2.0 * count);
        for (double& q : wave.readings) q = std::round(q / count) * count;
        EXPECT_NEAR(smoothMotion(wave.times_s, wave.readings, "wave").quantum(), count, 1e-3 * count);
    }
    // A quick joint: hardly two readings are alike.
    const double count = 1e-5;
    Wave wave(count, 200, 0.01);
    for (double& q : wave.readings) q = std::round(q / count) * count;
    EXPECT_NEAR(smoothMotion(wave.times_s, wave.readings, "wave").quantum(), count, 1e-3 * count);
}

// Between the values nearly every multiple of the step occurs.
TEST(Smoothing, TheStepOfALongFineRecordIsFoundInLinearTime) {
    for (const double frequency : {5.0, 6.0, 7.0, 8.0, 9.0, 10.0}) {
        std::vector<double> times_s, readings;
        for (int i = 0; i < 50000; ++i) {
            times_s.push_back(1e-3 * i);
            readings.push_back(std::round(std::sin(frequency * times_s.back()) * 1e8) / 1e8);
        }
        const std::clock_t begin = std::clock();
        const detail::Readings taken = detail::makeReadings(times_s, readings, "wave");
        EXPECT_LT(std::clock() - begin, 5 * CLOCKS_PER_SEC) << frequency;
        EXPECT_NEAR(taken.quantum, 1e-8, 1e-12) << frequency;
        EXPECT_EQ(taken.values.size(), readings.size());
    }
}

TEST(Smoothing, WildReadingsAndPiecesDoNotSpoilTheRest) {
    const double count = 2.0 * M_PI / 65536.0;
    Wave wave(count);
    for (double& q : wave.readings) q = std::round(q / count) * count;
    const auto clean = smoothMotion(wave.times_s, wave.readings, "wave");
    Wave first = wave, off = wave;
    first.readings[0] = 1e9;
    off.readings[500] += 7.3 * count;  // off the grid
    off.readings[900] += 1.0 + 0.4 * count;
    for (const Wave* one : {&first, &off}) {
        const auto motion = smoothMotion(one->times_s, one->readings, "wave");
        EXPECT_NEAR(motion.noise(), clean.noise(), 0.05 * clean.noise());
        EXPECT_NEAR(motion.evaluate(1.5).mean[2], clean.evaluate(1.5).mean[2], clean.evaluate(1.5).deviation[2]);
    }
    EXPECT_NEAR(smoothMotion(first.times_s, first.readings, "wave").quantum(), count, 1e-3 * count);
    // Far behind a gap, readings of nothing.
    std::mt19937_64 random(9);
    Wave behind = wave;
    for (int i = 0; i < 25; ++i) {
        behind.times_s.push_back(100.0 + 1e-3 * i);
        behind.readings.push_back(std::uniform_real_distribution<double>(-3.0, 3.0)(random));
    }
    EXPECT_NO_THROW(smoothMotion(behind.times_s, behind.readings, "wave"));
    // A burst, and groups that follow each other at quite another rate.
    std::vector<double> times_s, readings;
    for (int i = 0; i < 20; ++i) times_s.push_back(1e-6 * i);
    for (int group = 1; group < 4; ++group)
        for (int i = 0; i < 19; ++i) times_s.push_back(300.0 * group + i);
    for (const double t : times_s) readings.push_back(std::sin(t) + 1e-3 * std::sin(1e7 * t));
    EXPECT_NO_THROW(smoothMotion(times_s, readings, "wave"));
}

TEST(Smoothing, SaysWhatItCannotUse) {
    const Wave wave(1e-4, 100);
    EXPECT_EQ(refuse(wave.times_s, std::vector<double>(100, 0.25)),
              "file.csv: joint a: all readings are the same: the sensor is stuck, or the joint did not move. Leave the "
              "joint out, or give a record in which it moves.");
    std::vector<double> few(100, kNan);
    few[3] = 1.0;
    few[50] = 2.0;
    EXPECT_EQ(refuse(wave.times_s, few),
              "file.csv: joint a: 2 readings: at least 20 are needed to tell a jerk from noise");
    // Groups of 12 with long gaps between them.
    std::vector<double> apart;
    for (int i = 0; i < 100; ++i) apart.push_back(0.001 * i + 1000.0 * (i / 12));
    EXPECT_EQ(
        refuse(apart, wave.readings),
        "file.csv: joint a: 0 readings without a long gap between them: at least 20 are needed to tell a jerk from "
        "noise");
}

TEST(Smoothing, NoReadingIsLostInTryingAPulse) {
    const Wave wave(2e-5);
    const auto motion = smoothMotion(wave.times_s, wave.readings, "wave");
    MotionPulse pulse;
    pulse.order = 3;
    pulse.middle_s = 1.5;
    pulse.duration_s = 0.2;
    // Without height: the estimate itself.
    const auto none = motion.tryPulse(pulse);
    ASSERT_EQ(none.estimates.size(), none.times_s.size());
    ASSERT_FALSE(none.means.empty());
    for (std::size_t i = 0; i < none.times_s.size(); ++i) {
        const MotionEstimate e = motion.evaluate(none.times_s[i]);
        EXPECT_NEAR(none.estimates[i].mean[3], e.mean[3], e.deviation[3]);
    }
    // With it: the mean over the plateau rises by the height.
    pulse.height = 80.0;
    const auto high = motion.tryPulse(pulse);
    ASSERT_EQ(high.means.size(), none.means.size());
    for (std::size_t i = 0; i < high.means.size(); ++i)
        EXPECT_NEAR(high.means[i].mean - none.means[i].mean, 80.0, 4.0 * high.means[i].deviation);
    // What it adds to the position is its own integral.
    for (int order = 0; order < 4; ++order) {
        pulse.order = order;
        pulse.rise_s = order == 3 ? 0.0 : 0.05;
        const double h = 2e-3, t = 1.43;
        double value = 0.0;
        const double weights[4][4] = {{1, 0, 0, 0}, {-1, 1, 0, 0}, {1, -2, 1, 0}, {-1, 3, -3, 1}};
        for (int k = 0; k <= order; ++k) value += weights[order][k] * pulse.calcPosition(t + h * (k - 0.5 * order));
        EXPECT_NEAR(value / std::pow(h, order), 80.0, 1e-3) << order;
        EXPECT_EQ(pulse.calcPosition(1.5 - pulse.reach_s() - 1e-9), 0.0);
    }
}

}  // namespace
}  // namespace viable::test
