#include "experiment/ExperimentSchema.h"

#include <algorithm>

#include "config/ParameterJson.h"
#include "experiment/ExperimentKeys.h"

namespace viable {

namespace {

using detail::ExperimentKey;
using detail::Json;
using detail::KeyForm;

Json makeReference(const std::string& name) {
    return {{"$ref", "#/definitions/" + name}};
}

/** A plugin's parameters, and `plugin` itself, which the block has judged. */
Json makeParameters(const PluginInfo& plugin) {
    Json properties = {{"plugin", Json::object()}};
    if (plugin.kind == PluginKind::RobustLoop)
        for (const ParameterSpec& spec : settingsOf<RobustLoopSettings>())
            properties[spec.name] = detail::makeSchema(spec);
    for (std::uint64_t i = 0; i < plugin.entry->parameterCount; ++i) {
        const ParameterSpec& spec = plugin.entry->parameters[i];
        if (spec.name) properties[spec.name] = detail::makeSchema(spec);
    }
    return {{"properties", properties}, {"additionalProperties", false}};
}

/** `{plugin: NAME, parameters}`. Without `plugin` it completes the block at the top, whose plugin may be any. */
Json makePluginBlock(PluginKind kind, const std::vector<PluginInfo>& plugins) {
    Json names = Json::array(), rules = Json::array();
    Json anyones = Json::object();
    for (const PluginInfo& plugin : plugins) {
        if (plugin.kind != kind) continue;
        const Json parameters = makeParameters(plugin);
        names.push_back({{"const", plugin.name}, {"description", plugin.summary}});
        const Json isIt = {{"properties", {{"plugin", {{"const", plugin.name}}}}}, {"required", {"plugin"}}};
        rules.push_back({{"if", isIt}, {"then", parameters}});
        for (const auto& [name, schema] : parameters["properties"].items()) {
            if (name == "plugin") continue;
            Json& variants = anyones[name];
            if (std::find(variants.begin(), variants.end(), schema) == variants.end()) variants.push_back(schema);
        }
    }
    names.push_back({{"type", "string"},
                     {"pattern", R"(/|\.so$)"},
                     {"description", "Path of a plugin library, relative to this file."}});
    if (kind != PluginKind::RobustLoop && kind != PluginKind::RealPlant)
        names.push_back(
            {{"type", "string"},
             {"pattern", R"(\.py:[^0-9\W]\w*$)"},
             {"description", "FILE.py:CLASS, a class in Python, relative to this file; not for viable live."}});
    for (auto& [name, variants] : anyones.items())
        variants = variants.size() == 1 ? Json(variants.front()) : Json{{"anyOf", Json(variants)}};
    rules.push_back({{"if", {{"not", {{"required", {"plugin"}}}}}},
                     {"then", {{"properties", anyones}, {"additionalProperties", false}}}});
    return {{"type", "object"}, {"properties", {{"plugin", {{"anyOf", names}}}}}, {"allOf", rules}};
}

Json makeKey(const ExperimentKey& key) {
    const std::string name = key.spec.name;
    Json schema = {{"description", key.spec.help}};
    switch (key.form) {
        case KeyForm::Setting:
            return detail::makeSchema(key.spec);
        case KeyForm::Plugin:
            schema["allOf"] = Json::array({makeReference(name)});
            return schema;
        case KeyForm::Plugins: {
            const Json block = {{"allOf", Json::array({makeReference(name), {{"required", {"plugin"}}}})}};
            const Json justName = makeReference(name + "/properties/plugin");
            const Json list = {{"type", "array"},
                               {"items", {{"anyOf", Json::array({block, justName})}}},
                               {"minItems", 1},
                               {"maxItems", detail::kMaxFilters}};
            schema["anyOf"] = Json::array({makeReference(name), list});
            return schema;
        }
        case KeyForm::Cases:
            schema.update({{"type", "object"},
                           {"minProperties", 1},
                           {"propertyNames", {{"pattern", "^[A-Za-z0-9_+-]{1,64}$"}}},
                           {"additionalProperties", makeReference("case")}});
            return schema;
    }
    return schema;
}

Json makeKeys(const std::vector<ExperimentKey>& keys) {
    Json properties = Json::object();
    for (const ExperimentKey& key : keys) properties[key.spec.name] = makeKey(key);
    return properties;
}

/** A required key that may stand in the cases instead: at the top, or in every one of them. */
Json makePresence(const std::string& name) {
    const Json here = {{"required", {name}}};
    Json inCases = {{"type", "object"}, {"required", {name}}};
    return {{"anyOf", Json::array({here, {{"properties", {{"cases", {{"additionalProperties", inCases}}}}}}})}};
}

}  // namespace

std::string makeExperimentSchema(const std::vector<PluginInfo>& plugins) {
    Json definitions = Json::object(), required = Json::array(), presence = Json::array();
    std::vector<ExperimentKey> caseKeys;
    for (const ExperimentKey& key : detail::experimentKeys()) {
        const bool isRequired = !key.spec.defaultText;
        if (key.form == KeyForm::Plugin || key.form == KeyForm::Plugins)
            definitions[key.spec.name] = makePluginBlock(key.kind, plugins);
        if (!key.isTopOnly) caseKeys.push_back(key);
        if (isRequired && key.isTopOnly) required.push_back(key.spec.name);
        if (isRequired && !key.isTopOnly) presence.push_back(makePresence(key.spec.name));
    }
    Json ofCase = detail::makeObjectSchema(makeKeys(caseKeys));
    ofCase["type"] = {"object", "null"};
    definitions["case"] = ofCase;

    Json root = {{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", "Experiment file of viable"}};
    root.update(detail::makeObjectSchema(makeKeys(detail::experimentKeys())));
    root["required"] = required;
    root["allOf"] = presence;
    root["definitions"] = definitions;
    return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace viable
