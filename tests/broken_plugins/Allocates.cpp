#include <memory>
#include <vector>

#include "BrokenPlugin.h"

namespace {

class Allocates : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override { kept_.emplace_back(new double(1.0)); }
    std::vector<std::unique_ptr<double>> kept_;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Allocates, "allocates",
              "Takes memory from the heap in every tick after the first after_ticks.", broken::LateOptions)
