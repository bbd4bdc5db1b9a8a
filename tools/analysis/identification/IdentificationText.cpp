#include <algorithm>

#include "analysis/identification/Identification.h"
#include "core/JsonNumber.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "experiment/ResolvedNodes.h"

namespace viable {

namespace {

using detail::format;

/** To two digits of its standard error, and to three of its own at least. */
std::string formatFigure(double value, double deviation) {
    if (!std::isfinite(value)) return "-";
    if (value == 0.0) return "0";
    constexpr int kMostDigits = 9;
    const int magnitude = static_cast<int>(std::floor(std::log10(std::abs(value))));
    int digits = 3;
    if (std::isfinite(deviation) && deviation > 0.0)
        digits = std::clamp(2 + magnitude - static_cast<int>(std::floor(std::log10(deviation))), digits, kMostDigits);
    if (magnitude < -4) return format("%.*e", digits - 1, value);
    return format("%.*f", std::max(0, digits - 1 - magnitude), value);
}

std::string formatError(double deviation) {
    return std::isfinite(deviation) ? format("%.2g", deviation) : "-";
}

std::string formatWithError(const IdentifiedFigure& f) {
    if (!f.isKnown) return std::isnan(f.value) ? "-" : "(" + format("%.3g", f.value) + ")";
    return formatFigure(f.value, f.deviation) + " +- " + formatError(f.deviation);
}

std::string joinSources(const std::vector<std::string>& sources, std::size_t most) {
    std::string text;
    for (std::size_t i = 0; i < sources.size() && i < most; ++i)
        text += (i == 0 ? "" : ", ") + makePrintable(sources[i]);
    if (sources.size() > most) text += " and " + std::to_string(sources.size() - most) + " more";
    return text;
}

std::string writeTable(const std::vector<std::vector<std::string>>& rows) {
    std::vector<std::size_t> widths(rows.front().size());
    for (const auto& row : rows)
        for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
    std::string text;
    for (const auto& row : rows) {
        for (std::size_t c = 0; c + 1 < row.size(); ++c)
            text += row[c] + std::string(widths[c] - row[c].size() + 2, ' ');
        text += row.back() + "\n";
    }
    return text;
}

const char* const kLegend =
    R"(+- standard error; (in brackets) not known well enough. was: what the robot has. residual: RMS of an equation, beside the
friction's RMS. saturating: all three figures are known; known_velocity: with the robot's viscous velocity; line: straight;
coulomb_only: with the robot's viscous figures; none: the robot's figures stay. verdict, on the residuals: adequate: noise,
or too small to matter; approximate: more than the law is there, and errors may be larger than they say; doubtful: much more.
)";

std::string describeCheck(const ResidualCheck& check) {
    return check.name + " (" + format("%.1f", 100.0 * check.share) + " % of the friction" +
           (check.t != 0.0 ? ", t " + format("%.0f", check.t) : "") + ")";
}

std::string writePayload(const PayloadIdentification& payload) {
    if (payload.model == PayloadModel::None) return "payload error  not identified: " + payload.reason + "\n";
    std::string text = "payload error  ";
    if (!payload.mass.isKnown) return text + "not identified: " + payload.mass.reason + "\n";
    text += formatWithError(payload.mass) + " kg at the tool";
    if (!payload.isFound())
        return text + ": none is seen, 95 % between " + format("%.3g", payload.mass.lower) + " and " +
               format("%.3g", payload.mass.upper) + " kg\n";
    std::string offset;
    for (std::size_t k = 0; k < 3; ++k) {
        const IdentifiedFigure& c = payload.centre[k];
        offset += (k == 0 ? "" : ", ") + (c.isKnown ? formatFigure(c.value, c.deviation) : "0");
        text += std::string(k == 0 ? ", centre [m] " : ", ") + (c.isKnown ? formatWithError(c) : "not known");
    }
    text += "\n";
    const std::string mass = formatFigure(payload.mass.value, payload.mass.deviation);
    if (payload.mass.value > 0.0)
        text += "               tell an experiment: payload_kg: " + mass + ", payload_offset_m: [" + offset +
                "], on top of what it says now; or add it to the tool's <inertial> in the URDF\n";
    else
        text +=
            "               the model carries too much: take it from the payload of the experiment or from the masses "
            "in the URDF\n";
    return text;
}

// -------------------------------------------------------------------------------- actuation.yaml

std::string writeList(const std::vector<std::string>& values) {
    return "[" + detail::join(values) + "]";
}

/** The friction block, lines with "\n". */
std::string writeFriction(const Identification& found, const std::string& oldSource) {
    std::vector<std::string> figures[3], errors[3];
    for (const JointIdentification& joint : found.joints) {
        const bool isNew[3] = {joint.form != FrictionForm::None,
                               joint.form != FrictionForm::None && joint.form != FrictionForm::CoulombOnly,
                               joint.form == FrictionForm::Saturating || joint.written[2] != joint.old[2]};
        const IdentifiedFigure* const known[3] = {&joint.coulomb, &joint.viscous, &joint.viscousVelocity};
        for (std::size_t k = 0; k < 3; ++k) {
            double deviation = isNew[k] ? known[k]->deviation : 0.0;
            if (k == 1 && joint.form == FrictionForm::Line) deviation = joint.written[2] * joint.slope.deviation;
            const bool isStraight = k == 2 && joint.form == FrictionForm::Line && isNew[2];
            figures[k].push_back(isNew[k] ? formatFigure(joint.written[k], isStraight ? 0.0 : deviation)
                                          : detail::formatNumber(joint.written[k]));
            errors[k].push_back(!isNew[k] ? "kept" : isStraight ? "straight" : formatError(deviation));
        }
    }
    const char* const keys[3] = {"coulomb_Nm", "viscous_Nm", "viscous_velocity_radps"};
    std::string text = "friction:\n";
    for (std::size_t k = 0; k < 3; ++k)
        text += std::string("  ") + keys[k] + ": " + writeList(figures[k]) +
                "  # standard errors: " + detail::join(errors[k]) + "\n";
    for (const JointIdentification& joint : found.joints) {
        std::string note = joint.reason;
        for (const ResidualCheck& check : joint.checks)
            if (check.isFound) note += (note.empty() ? "" : "; ") + ("also seen: " + describeCheck(check));
        if (!note.empty() || joint.form != FrictionForm::Saturating)
            text += "  # " + makePrintable(joint.name) + ": " + getName(joint.form) + "; " + makePrintable(note) + "\n";
        else if (joint.explained < 0.5 && joint.verdict == ModelVerdict::Doubtful)
            text += "  # " + makePrintable(joint.name) + ": explains only " + format("%.0f", 100.0 * joint.explained) +
                    " % of what the rigid arm leaves open\n";
    }
    if (!oldSource.empty()) text += "  # what is kept comes from: " + makePrintable(oldSource) + "\n";
    constexpr std::size_t kMostSources = 8;
    const std::string source = std::string("identified by viable ") + VIABLE_VERSION + " from " +
                               format("%.0f", found.duration_s) + " s of motion in " +
                               joinSources(found.sources, kMostSources);
    return text + "  " + writeConfig(detail::makeMap({{"source", detail::makeScalar(source, true)}}));
}

std::vector<std::string> splitLines(const std::string& text) {
    std::vector<std::string> lines;
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = text.find('\n', at);
        const std::size_t next = end == std::string::npos ? text.size() : end + 1;
        lines.push_back(text.substr(at, next - at));
        at = next;
    }
    return lines;
}

/** The text with the lines of the root's `friction` replaced; empty where they cannot be told. */
std::string replaceFriction(const std::string& text, const std::string& block) {
    const std::vector<std::string> lines = splitLines(text);
    const auto isBlank = [](const std::string& line) { return line.find_first_not_of(" \t\r\n") == std::string::npos; };
    const auto begin = std::find_if(lines.begin(), lines.end(),
                                    [](const std::string& line) { return line.rfind("friction:", 0) == 0; });
    if (begin == lines.end()) return {};
    auto end = std::find_if(begin + 1, lines.end(), [&](const std::string& line) {
        return !isBlank(line) && std::string(" \t#}]").find(line[0]) == std::string::npos;
    });
    while (end - 1 != begin && (isBlank(*(end - 1)) || (*(end - 1))[0] == '#')) --end;
    std::string result;
    for (auto line = lines.begin(); line != begin; ++line) result += *line;
    result += text.find("\r\n") == std::string::npos ? block : detail::replaceAll(block, "\n", "\r\n");
    for (auto line = end; line != lines.end(); ++line) result += *line;
    return result;
}

nlohmann::json toJson(double x) {
    return detail::makeNumberOrNull(x);
}

nlohmann::json toJson(const IdentifiedFigure& f) {
    nlohmann::json figure{{"value", toJson(f.value)},
                          {"standard_error", toJson(f.deviation)},
                          {"lower_95", toJson(f.lower)},
                          {"upper_95", toJson(f.upper)},
                          {"is_known", f.isKnown}};
    if (!f.reason.empty()) figure["reason"] = f.reason;
    return figure;
}

const char* getName(PayloadModel model) {
    return detail::enumName<PayloadModel::MassAndCentre>(model, {"none", "mass", "mass_and_centre"}, "none");
}

}  // namespace

std::string writeText(const Identification& found) {
    std::string text = makePrintable(found.robot) + ": " + format("%.3g", found.duration_s) + " s of motion, " +
                       std::to_string(found.equations) + " equations over windows of " +
                       format("%.3g", found.window_s) + " s, errors from " + std::to_string(found.blocks) +
                       " segments of " + format("%.3g", found.block_s) + " s\n\n";
    std::vector<std::vector<std::string>> rows{{"joint", "friction", "coulomb [Nm]", "was", "viscous [Nm]", "was",
                                                "velocity [rad/s]", "was", "residual [Nm]", "explained",
                                                "speeds [rad/s]", "verdict"}};
    for (const JointIdentification& joint : found.joints) {
        const auto was = [&](std::size_t k) { return format("%.4g", joint.old[k]); };
        const bool isFitted = joint.form != FrictionForm::None;
        rows.push_back({makePrintable(joint.name), getName(joint.form), formatWithError(joint.coulomb), was(0),
                        joint.form == FrictionForm::Line ? formatWithError(joint.slope) + " Nm s/rad"
                                                         : formatWithError(joint.viscous),
                        was(1), formatWithError(joint.viscousVelocity), was(2),
                        isFitted ? format("%.2g of %.3g", joint.residualRms, joint.frictionRms) : "-",
                        isFitted ? format("%.2f %%", 100.0 * joint.explained) : "-",
                        format("%.2g to %.3g", joint.slowest, joint.fastest), getName(joint.verdict)});
    }
    text += writeTable(rows) + "\n";
    const bool hasPrismatic = std::any_of(found.joints.begin(), found.joints.end(),
                                          [](const JointIdentification& joint) { return joint.isPrismatic; });
    for (const JointIdentification& joint : found.joints) {
        if (!joint.reason.empty()) text += makePrintable(joint.name) + ": " + joint.reason + "\n";
        if (joint.form == FrictionForm::None) continue;
        if (joint.explained < 0.5 && joint.verdict == ModelVerdict::Doubtful)
            text += makePrintable(joint.name) + ": explains only " + format("%.0f", 100.0 * joint.explained) +
                    " % of the torque that the rigid arm leaves open\n";
        std::string seen;
        for (const ResidualCheck& check : joint.checks)
            if (check.isFound) detail::addItem(seen, describeCheck(check));
        if (!seen.empty()) text += makePrintable(joint.name) + ": the residuals also show " + seen + "\n";
        if (joint.rotorInertia.isKnown)
            text += makePrintable(joint.name) + ": inertia error " + formatWithError(joint.rotorInertia) +
                    " kg m^2, reflected; over the gear ratio squared it belongs to rotor_inertia_kgm2\n";
        if (joint.torqueOffset.isKnown)
            text += makePrintable(joint.name) + ": torque offset " + formatWithError(joint.torqueOffset) + " Nm\n";
    }
    const auto writeDelay = [&](const char* name, const IdentifiedFigure& delay) {
        if (delay.isKnown)
            text += name + format("%.3g", 1e3 * delay.value) + " +- " + formatError(1e3 * delay.deviation) + " ms\n";
    };
    writeDelay("torque delay   ", found.torqueDelay);
    writeDelay("friction lag   ", found.frictionDelay);
    text += writePayload(found.payload);
    for (std::size_t i = 0; i < found.bodyMasses.size(); ++i)
        text += "mass factor of the body behind " + makePrintable(found.joints[i].name) + "  " +
                formatWithError(found.bodyMasses[i]) + "\n";
    text += "\n";
    text += kLegend;
    if (hasPrismatic) text += "Prismatic joints: N, m/s and kg in place of Nm, rad/s and kg m^2.\n";
    return text;
}

std::string writeJson(const Identification& found) {
    using nlohmann::json;
    json joints = json::object();
    for (const JointIdentification& joint : found.joints) {
        json checks = json::object();
        for (const ResidualCheck& check : joint.checks)
            checks[check.name] = {
                {"share_of_friction", toJson(check.share)}, {"t", toJson(check.t)}, {"is_found", check.isFound}};
        json covariance = json::array();
        for (int r = 0; r < 3; ++r)
            covariance.push_back(
                {toJson(joint.covariance(r, 0)), toJson(joint.covariance(r, 1)), toJson(joint.covariance(r, 2))});
        const auto figures = [](const std::array<double, 3>& f) {
            return json{
                {"coulomb_Nm", toJson(f[0])}, {"viscous_Nm", toJson(f[1])}, {"viscous_velocity_radps", toJson(f[2])}};
        };
        joints[joint.name] = {{"form", getName(joint.form)},
                              {"reason", joint.reason},
                              {"prismatic", joint.isPrismatic},
                              {"coulomb_Nm", toJson(joint.coulomb)},
                              {"viscous_Nm", toJson(joint.viscous)},
                              {"viscous_velocity_radps", toJson(joint.viscousVelocity)},
                              {"slope_Nms", toJson(joint.slope)},
                              {"covariance_coulomb_slope_inverse_velocity", covariance},
                              {"rotor_inertia_error_kgm2", toJson(joint.rotorInertia)},
                              {"torque_offset_Nm", toJson(joint.torqueOffset)},
                              {"old", figures(joint.old)},
                              {"written", figures(joint.written)},
                              {"equations", joint.equations},
                              {"blocks", joint.blocks},
                              {"moving_s", toJson(joint.moving_s)},
                              {"slowest_radps", toJson(joint.slowest)},
                              {"fastest_radps", toJson(joint.fastest)},
                              {"friction_rms_Nm", toJson(joint.frictionRms)},
                              {"residual_rms_Nm", toJson(joint.residualRms)},
                              {"explained", toJson(joint.explained)},
                              {"residual_correlation", toJson(joint.correlation)},
                              {"checks", checks},
                              {"verdict", getName(joint.verdict)}};
    }
    json moment = json::array(), centre = json::array(), bodies = json::array();
    for (std::size_t k = 0; k < 3; ++k) {
        moment.push_back(toJson(found.payload.moment[k]));
        centre.push_back(toJson(found.payload.centre[k]));
    }
    for (const IdentifiedFigure& body : found.bodyMasses) bodies.push_back(toJson(body));
    const json all{{"robot", found.robot},
                   {"version", VIABLE_VERSION},
                   {"sources", found.sources},
                   {"duration_s", toJson(found.duration_s)},
                   {"window_s", toJson(found.window_s)},
                   {"block_s", toJson(found.block_s)},
                   {"blocks", found.blocks},
                   {"equations", found.equations},
                   {"joints", joints},
                   {"torque_delay_s", toJson(found.torqueDelay)},
                   {"friction_delay_s", toJson(found.frictionDelay)},
                   {"payload",
                    {{"model", getName(found.payload.model)},
                     {"reason", found.payload.reason},
                     {"is_found", found.payload.isFound()},
                     {"mass_kg", toJson(found.payload.mass)},
                     {"moment_kgm", moment},
                     {"centre_m", centre}}},
                   {"mass_factors", bodies}};
    return all.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

std::string writeActuation(const RobotDescription& nominal, const Identification& found) {
    VIABLE_CHECK(static_cast<int>(found.joints.size()) == nominal.size(), "figures of this robot's joints");
    const std::filesystem::path file = nominal.folder / "actuation.yaml";
    const std::optional<std::string> text = readWhole(file);
    if (!text) throw badInput(file.string(), "the file cannot be read", "It is part of the robot's folder.");
    ConfigNode root = parseConfig(*text, file.string());
    const ConfigNode* const old = root.find("friction");
    const ConfigNode* const source = old && old->kind == ConfigNode::Kind::Map ? old->find("source") : nullptr;
    const bool keepsSome = std::any_of(found.joints.begin(), found.joints.end(), [](const JointIdentification& joint) {
        return joint.form != FrictionForm::Saturating && joint.form != FrictionForm::Line;
    });
    const std::string block =
        writeFriction(found, keepsSome && source && source->kind == ConfigNode::Kind::Scalar ? source->text : "");

    const std::string edited = replaceFriction(*text, block);
    if (!edited.empty()) {
        try {
            const auto writeRest = [](const ConfigNode& node) {
                return writeConfig(detail::dropEntry(node, "friction"));
            };
            if (writeRest(parseConfig(edited, file.string())) == writeRest(root)) return edited;
        } catch (const Error&) {
            // Laid out in a way that lines do not show; below it loses its comments, but nothing else.
        }
    }
    const ConfigNode fresh = parseConfig(block, file.string());
    ConfigNode* const place = root.find("friction");
    if (place)
        *place = *fresh.find("friction");
    else
        root.entries.emplace_back("friction", *fresh.find("friction"));
    return writeConfig(root);
}

}  // namespace viable
