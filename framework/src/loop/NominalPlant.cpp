#include "viable/loop/NominalPlant.h"

namespace viable {

void advanceNominal(const FilterDecision& decision, double tick_s, MotionState& nominal) {
    for (int i = 0; i < nominal.q.size(); ++i) {
        if (decision.held == HeldQuantity::Jerk) {
            const AxisState next = advance({nominal.q[i], nominal.qd[i], nominal.qdd[i]}, decision.value[i], tick_s);
            nominal.q[i] = next.p;
            nominal.qd[i] = next.v;
            nominal.qdd[i] = next.a;
        } else {
            const double x = decision.value[i];
            nominal.q[i] += tick_s * (nominal.qd[i] + tick_s * x / 2.0);
            nominal.qd[i] += tick_s * x;
            nominal.qdd[i] = x;
        }
    }
}

}  // namespace viable
