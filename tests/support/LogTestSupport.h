#pragma once

#include <atomic>
#include <cmath>
#include <cstring>
#include <random>
#include <thread>

#include "Complaint.h"
#include "TemporaryFolder.h"
#include "records/LogReader.h"

namespace viable::test {

/** A folder of its own for each test, gone afterwards. */
struct LogTestBase : ::testing::Test {
    std::filesystem::path path(const std::string& name) const { return folder_ / name; }
    /** The names in it, sorted. */
    std::vector<std::string> listFolder() const { return listNames(folder_); }

    const TemporaryFolder temporary_;
    const std::filesystem::path folder_ = temporary_.path();
};

inline std::string readBytes(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
}

inline void writeBytes(const std::filesystem::path& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
}

inline LogLayout makeLayout(int joints, MotionCommand::Space space, bool hasRealPlant) {
    LogLayout layout;
    for (int j = 0; j < joints; ++j) layout.jointNames.push_back("joint" + std::to_string(j));
    layout.commandSpace = space;
    layout.hasRealPlant = hasRealPlant;
    return layout;
}

/** Records whose numbers are any bit patterns, the special ones among them. */
class RecordMaker {
public:
    RecordMaker(const LogLayout& layout, unsigned seed) : layout_(layout), random_(seed) {}

    TickRecord make(double time_s) {
        TickRecord r;
        r.time_s = time_s;
        r.nominal = {joints(), joints(), joints(), joints()};
        for (int i = 0; i < 3; ++i) r.tool.position[i] = number();
        for (int i = 0; i < 4; ++i) r.tool.orientation.coeffs()[i] = number();
        r.command.space = layout_.commandSpace;
        if (layout_.commandSpace == MotionCommand::Space::Joint) {
            r.command.q = joints();
            r.command.qd = joints();
        } else {
            for (int i = 0; i < 3; ++i) r.command.tool.position[i] = number();
            for (int i = 0; i < 4; ++i) r.command.tool.orientation.coeffs()[i] = number();
            for (int i = 0; i < 6; ++i) r.command.toolTwist[i] = number();
        }
        r.desiredTorque = joints();
        r.filterTorque = joints();
        r.removedTorque = joints();
        for (JointBounds* bounds : {&r.limits.position, &r.limits.velocity, &r.limits.acceleration, &r.limits.jerk})
            *bounds = {joints(), joints()};
        if (layout_.hasRealPlant) {
            r.real = {joints(), joints()};
            r.actual = {joints(), joints()};
            r.robustTorque = joints();
            r.motorTorque = joints();
        }
        if (layout_.hasExternalTorque) r.externalTorque = joints();
        r.status = static_cast<FilterStatus>(random_() % 7);
        r.verdict = static_cast<StopVerdict>(random_() % 3);
        for (std::size_t j = 0; j < layout_.jointNames.size(); ++j) {
            r.joints[j].limit = static_cast<LimitKind>(random_() % 5);
            r.joints[j].side = r.joints[j].limit == LimitKind::None ? LimitSide::Neither
                               : random_() % 2 == 0                 ? LimitSide::Lower
                                                                    : LimitSide::Upper;
            r.stops[j] = {number(), number(), number()};
        }
        if (layout_.limits.has(LimitKind::Clearance)) {
            LimitReport& c = r.reports[LimitKind::Clearance];
            c.isKnown = random_() % 2 == 0;
            c.margin = number();
            for (int* index : {&c.link, &c.other, &c.otherLink}) *index = static_cast<int>(random_() % 9) - 1;
            for (int i = 0; i < 3; ++i) c.onArm[i] = number();
            for (int i = 0; i < 3; ++i) c.onOther[i] = number();
            c.age_s = number();
        }
        if (layout_.limits.has(LimitKind::Speed)) {
            LimitReport& s = r.reports[LimitKind::Speed];
            s.isKnown = random_() % 2 == 0;
            s.value = number();
            s.limit = number();
            s.link = static_cast<int>(random_() % 9) - 1;
        }
        if (layout_.limits.has(LimitKind::Separation)) {
            const auto index = [this] { return static_cast<int>(random_() % 9) - 1; };
            const auto count = [this] { return static_cast<std::int64_t>(random_() % 9); };
            LimitReport& s = r.reports[LimitKind::Separation];
            s.isKnown = random_() % 2 == 0;
            s.isKept = random_() % 2 == 0;
            s.margin = number();
            s.link = index();
            s.other = index();
            s.age_s = number();
            r.peopleFaults = {count(), count(), count(), count(), index()};
        }
        r.braking = random_() % 2 == 0;
        r.missed = random_() % 2 == 0;
        if (layout_.isLive) {
            r.paused = random_() % 2 == 0;
            r.take = static_cast<std::int64_t>(random_() % 4);
            r.interval_us = number();
        }
        r.substituted = static_cast<std::int64_t>(random_() >> 1);
        r.compute_us = number();
        for (double& us : r.stage_us) us = number();
        return r;
    }

private:
    double number() {
        using Limits = std::numeric_limits<double>;
        const double odd[] = {Limits::infinity(),   -Limits::infinity(), -0.0,
                              Limits::denorm_min(), Limits::max(),       Limits::quiet_NaN()};
        const auto kind = random_() % 12;
        if (kind < std::size(odd)) return odd[kind];
        const std::uint64_t bits = random_();
        double v;
        std::memcpy(&v, &bits, sizeof(v));
        return std::isnan(v) ? 0.1 : v;
    }
    JointVector joints() {
        JointVector v(static_cast<Eigen::Index>(layout_.jointNames.size()));
        for (Eigen::Index j = 0; j < v.size(); ++j) v[j] = number();
        return v;
    }

    LogLayout layout_;
    std::mt19937_64 random_;
};

inline std::vector<TickRecord> makeRecords(const LogLayout& layout, int count, double tick_s, unsigned seed) {
    RecordMaker maker(layout, seed);
    std::vector<TickRecord> records;
    for (int i = 0; i < count; ++i) records.push_back(maker.make(i * tick_s));
    return records;
}

/** All numbers of a record in a fixed order, as bits; the words as numbers. Written by hand, not
from the log's own table. */
inline std::vector<std::uint64_t> getBits(const TickRecord& r, const LogLayout& layout) {
    std::vector<std::uint64_t> bits;
    const auto add = [&](double v) {
        std::uint64_t b;
        std::memcpy(&b, &v, sizeof(b));
        bits.push_back(b);
    };
    const auto addVector = [&](const JointVector& v) {
        bits.push_back(static_cast<std::uint64_t>(v.size()));
        for (Eigen::Index j = 0; j < v.size(); ++j) add(v[j]);
    };
    const auto addPose = [&](const Pose& pose) {
        for (int i = 0; i < 3; ++i) add(pose.position[i]);
        add(pose.orientation.w());
        add(pose.orientation.x());
        add(pose.orientation.y());
        add(pose.orientation.z());
    };
    add(r.time_s);
    addVector(r.command.q);
    addVector(r.command.qd);
    addPose(r.command.tool);
    for (int i = 0; i < 6; ++i) add(r.command.toolTwist[i]);
    for (const JointVector* v : {&r.nominal.q,
                                 &r.nominal.qd,
                                 &r.nominal.qdd,
                                 &r.nominal.jerk,
                                 &r.real.q,
                                 &r.real.qd,
                                 &r.actual.q,
                                 &r.actual.qd,
                                 &r.desiredTorque,
                                 &r.filterTorque,
                                 &r.robustTorque,
                                 &r.motorTorque,
                                 &r.externalTorque,
                                 &r.removedTorque,
                                 &r.limits.position.lower,
                                 &r.limits.position.upper,
                                 &r.limits.velocity.lower,
                                 &r.limits.velocity.upper,
                                 &r.limits.acceleration.lower,
                                 &r.limits.acceleration.upper,
                                 &r.limits.jerk.lower,
                                 &r.limits.jerk.upper}) {
        addVector(*v);
    }
    addPose(r.tool);
    bits.push_back(static_cast<std::uint64_t>(r.status));
    for (std::size_t j = 0; j < layout.jointNames.size(); ++j) {
        bits.push_back(static_cast<std::uint64_t>(r.joints[j].limit));
        bits.push_back(static_cast<std::uint64_t>(static_cast<int>(r.joints[j].side) + 1));
        add(r.stops[j].margin);
        add(r.stops[j].duration_s);
        add(r.stops[j].rest);
    }
    for (int k = static_cast<int>(kFirstArmLimit); k < kMostLimitKinds; ++k) {
        const LimitReport& report = r.reports[static_cast<LimitKind>(k)];
        bits.push_back(report.isKnown ? 1 : 0);
        bits.push_back(report.isKept ? 1 : 0);
        for (const double x : {report.value, report.limit, report.margin, report.age_s}) add(x);
        for (const int index : {report.link, report.other, report.otherLink})
            bits.push_back(static_cast<std::uint64_t>(index + 1));
        for (int i = 0; i < 3; ++i) add(report.onArm[i]);
        for (int i = 0; i < 3; ++i) add(report.onOther[i]);
    }
    const PeopleFaults& faults = r.peopleFaults;
    for (const std::int64_t count : {faults.appeared, faults.faster, faults.lost, faults.refused})
        bits.push_back(static_cast<std::uint64_t>(count));
    bits.push_back(static_cast<std::uint64_t>(faults.last + 1));
    bits.push_back(static_cast<std::uint64_t>(r.verdict));
    bits.push_back(r.braking ? 1 : 0);
    bits.push_back(r.missed ? 1 : 0);
    bits.push_back(r.paused ? 1 : 0);
    bits.push_back(static_cast<std::uint64_t>(r.take));
    bits.push_back(static_cast<std::uint64_t>(r.substituted));
    add(r.interval_us);
    add(r.compute_us);
    for (const double us : r.stage_us) add(us);
    return bits;
}

inline LogOpening makeOpening(const LogLayout& layout) {
    LogOpening opening;
    opening.layout = layout;
    opening.metadata = {{"seed", "7"}, {"title", "a question"}};
    opening.attachments = {{"experiment.yaml", "application/yaml", "schema: 1\nrobot: indy7\n"}};
    return opening;
}

/** Keeps the bytes of a log and where each write began. */
struct WrittenLog {
    std::string bytes;
    std::vector<std::size_t> writes;
};

class MemorySink : public LogSink {
public:
    explicit MemorySink(WrittenLog& log) : log_(log) {}
    bool write(const void* data, std::size_t size, std::string&) override {
        log_.writes.push_back(log_.bytes.size());
        log_.bytes.append(static_cast<const char*>(data), size);
        return true;
    }
    bool close(std::string&) override { return true; }

private:
    WrittenLog& log_;
};

inline WrittenLog makeLog(const LogOpening& opening, const std::vector<TickRecord>& records) {
    WrittenLog log;
    LogWriter writer(std::make_unique<MemorySink>(log), opening);
    for (const TickRecord& record : records) writer.append(record);
    writer.finish();
    EXPECT_TRUE(writer.status().ok()) << writer.status().error;
    EXPECT_EQ(writer.status().rows, records.size());
    EXPECT_EQ(writer.status().bytes, log.bytes.size());
    return log;
}

inline std::vector<TickRecord> readAll(LogReader& reader) {
    std::vector<TickRecord> records;
    TickRecord record;
    while (reader.read(record)) records.push_back(record);
    return records;
}

/** The same rows, to the last bit. */
inline void expectSameRows(const std::vector<TickRecord>& rows, const std::vector<TickRecord>& expected,
                           const LogLayout& layout) {
    ASSERT_EQ(rows.size(), expected.size());
    for (std::size_t i = 0; i < rows.size(); ++i)
        ASSERT_EQ(getBits(rows[i], layout), getBits(expected[i], layout)) << "row " << i;
}

/** The text of the Error that `call` throws; its kind is checked, too. */
template <class Call>
std::string catchError(ErrorKind kind, const Call& call) {
    return catchError(call, kind);
}

/** What is wrong with a log, by a reader of all its rows. */
inline std::string complainReading(const std::filesystem::path& file) {
    return catchError(ErrorKind::BadInput, [&] {
        LogReader reader(file);
        readAll(reader);
    });
}

/** Two threads do the same at once: one succeeds, the other is refused. */
template <class Work>
void expectOneOfTwo(const Work& work) {
    std::atomic<int> ready{0}, made{0}, refused{0};
    const auto run = [&] {
        ready.fetch_add(1);
        while (ready.load() < 2) {
        }
        try {
            work();
            made.fetch_add(1);
        } catch (const Error& e) {
            refused.fetch_add(e.kind() == ErrorKind::BadInput ? 1 : 100);
        }
    };
    std::thread other(run);
    run();
    other.join();
    EXPECT_EQ(made.load(), 1);
    EXPECT_EQ(refused.load(), 1);
}

}  // namespace viable::test
