#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

// Prints a table of ratios: the time of every benchmark (its fastest repetition) over that of one
// Cholesky solve of the same size, measured in the same run. A benchmark takes part by setting the
// counter "n", its number of joints; other counters are printed as they are.
// --benchmark_out=FILE writes every single repetition as well.

namespace {

struct Measurement {
    int n = 0;
    std::vector<double> times_ns;
    std::map<std::string, double> counters;

    /** Other load on the machine only ever adds, so the fastest repetition is what repeats. */
    double findFastest() const { return *std::min_element(times_ns.begin(), times_ns.end()); }
};

class RatioReporter : public benchmark::BenchmarkReporter {
public:
    bool ReportContext(const Context& context) override {
        PrintBasicContext(&GetErrorStream(), context);
        return true;
    }

    void ReportRuns(const std::vector<Run>& runs) override {
        for (const Run& run : runs) {
            const auto n = run.counters.find("n");
            if (run.error_occurred) GetErrorStream() << run.benchmark_name() << ": " << run.error_message << "\n";
            if (run.run_type != Run::RT_Iteration || run.error_occurred || n == run.counters.end()) continue;
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
        std::printf(
            "\nFastest repetition, and as multiples of one n x n Cholesky solve of the same run\n"
            "(Eigen::LLT with sizes known when compiling / with JointMatrix):\n\n"
            "%-44s %10s %8s %8s\n",
            "", "ns", "x fixed", "x joint");
        for (const auto& [index, name] : order_) {
            const Measurement& m = measurements_.at(name);
            std::printf("%-44s %10.1f", name.c_str(), m.findFastest());
            for (const char* reference : {"cholesky_fixed/n:", "cholesky_joint_matrix/n:"})
                printRatio(m, reference + std::to_string(m.n));
            for (const auto& counter : m.counters) std::printf("  %s=%.4g", counter.first.c_str(), counter.second);
            std::printf("\n");
        }
    }

private:
    void printRatio(const Measurement& m, const std::string& reference) const {
        const auto found = measurements_.find(reference);
        if (found == measurements_.end())
            std::printf(" %8s", "-");  // left out by a filter
        else
            std::printf(" %8.2f", m.findFastest() / found->second.findFastest());
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
