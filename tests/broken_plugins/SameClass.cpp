#include "BrokenPlugin.h"

// Built twice, with other values: two libraries that define the same classes. The static variable
// in an inline function is the hard part: were it visible, the dynamic linker would give both
// libraries one variable, RTLD_LOCAL or not.
struct SameHelper {
    double getValue() const;
    static double& updShared() {
        static double shared = VIABLE_SAME_CLASS_VALUE;
        return shared;
    }
};

double SameHelper::getValue() const {
    return VIABLE_SAME_CLASS_VALUE;
}

struct SameFilter : broken::Filter {
    viable::FilterStatus filter(const viable::FilterInput&, viable::FilterDecision& decision) override {
        decision.value.resize(2);
        decision.value[0] = SameHelper().getValue();
        decision.value[1] = SameHelper::updShared();
        return viable::FilterStatus::Passed;
    }
};

VIABLE_PLUGIN(viable::SafetyFilter, SameFilter, VIABLE_SAME_CLASS_NAME, "Has a twin class.", viable::NoOptions)
