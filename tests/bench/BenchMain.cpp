#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

// Beside Google Benchmark's own output, a table of ratios: the median time of every benchmark over
// that of one Cholesky solve of the same size, measured in the same run. A benchmark takes part by
// setting the counter "n" (number of joints); its other counters are printed as they are.

namespace {

struct Measurement {
    int n = 0;
    std::vector<double> times_ns;
    std::map<std::string, double> counters;

    double calcMedian() const {
        std::vector<double> sorted = times_ns;
        std::sort(sorted.begin(), sorted.end());
        return sorted[sorted.size() / 2];
    }
};

class RatioReporter : public benchmark::ConsoleReporter {
public:
    RatioReporter() : ConsoleReporter(OO_None) {}

    void ReportRuns(const std::vector<Run>& runs) override {
        ConsoleReporter::ReportRuns(runs);
        for (const Run& run : runs) {
            const auto n = run.counters.find("n");
            if (run.run_type != Run::RT_Iteration || run.error_occurred || n == run.counters.end())
                continue;
            const std::string name = run.run_name.function_name;
            order_[run.family_index] = name;
            Measurement& m = measurements_[name];
            m.n = static_cast<int>(n->second);
            m.times_ns.push_back(run.cpu_accumulated_time / run.iterations * 1e9);
            for (const auto& counter : run.counters)
                if (counter.first != "n") m.counters[counter.first] = counter.second;
        }
    }

    void Finalize() override {
        ConsoleReporter::Finalize();
        std::printf(
            "\nMedian time, and as multiples of one n x n Cholesky solve of the same run\n"
            "(Eigen::LLT with sizes known when compiling / with JointMatrix):\n\n"
            "%-44s %10s %8s %8s\n",
            "", "ns", "x fixed", "x joint");
        for (const auto& [index, name] : order_) {
            const Measurement& m = measurements_.at(name);
            std::printf("%-44s %10.1f", name.c_str(), m.calcMedian());
            for (const char* reference : {"cholesky_fixed/n:", "cholesky_joint_matrix/n:"})
                printRatio(m, reference + std::to_string(m.n));
            for (const auto& counter : m.counters)
                std::printf("  %s=%.4g", counter.first.c_str(), counter.second);
            std::printf("\n");
        }
    }

private:
    void printRatio(const Measurement& m, const std::string& reference) const {
        const auto found = measurements_.find(reference);
        if (found == measurements_.end())
            std::printf(" %8s", "-");  // left out by a filter
        else
            std::printf(" %8.2f", m.calcMedian() / found->second.calcMedian());
    }

    std::map<std::int64_t, std::string> order_;  // of registration, whatever the order of running
    std::map<std::string, Measurement> measurements_;
};

}  // namespace

int main(int argc, char** argv) {
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
    RatioReporter reporter;
    benchmark::RunSpecifiedBenchmarks(&reporter);
    benchmark::Shutdown();
    return 0;
}
