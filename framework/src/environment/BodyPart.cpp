#include "viable/environment/People.h"

#include <cmath>

#include "config/ParameterText.h"

namespace viable {

namespace {

struct Tissue {
    double clamping_N;  // what it stands when it is clamped
    double stiffness_Npmm;
    double mass_kg;
};

/** ISO/TS 15066:2016, tables A.2 and A.3, in the order of BodyPart. */
constexpr std::array<Tissue, 9> kTissues = {{
    {210, 35, 40},
    {140, 25, 40},
    {110, 10, 40},
    {180, 25, 40},
    {150, 30, 3},
    {160, 40, 2},
    {140, 75, 0.6},
    {220, 50, 75},
    {130, 60, 75},
}};

/** What gives way stands so much more force than what is clamped. */
constexpr double kTransient = 2.0;

}  // namespace

const std::vector<std::string>& bodyPartNames() {
    static const std::vector<std::string> names = detail::splitChoices(kBodyPartWords);
    return names;
}

double calcContactSpeed(BodyPart part, double movingMass_kg) {
    const Tissue& tissue = kTissues[static_cast<std::size_t>(part)];
    const double reducedMass = tissue.mass_kg * movingMass_kg / (tissue.mass_kg + movingMass_kg);
    return kTransient * tissue.clamping_N / std::sqrt(reducedMass * 1000.0 * tissue.stiffness_Npmm);
}

}  // namespace viable
