#include "live/PlacedObstacles.h"

#include <nlohmann/json.hpp>

#include "environment/ArmSurroundings.h"
#include "log/Recorder.h"

namespace viable {

namespace {

using nlohmann::json;

constexpr char kName[] = "placed ";

std::string namePlace(int place) {
    return kName + std::to_string(place + 1);
}

/** Numbers within [-most, most]. */
bool readNumbers(const json& list, std::size_t count, double most, double* numbers) {
    if (!list.is_array() || list.size() != count) return false;
    for (std::size_t i = 0; i < count; ++i) {
        if (!list[i].is_number()) return false;
        numbers[i] = list[i].get<double>();
        if (!(std::abs(numbers[i]) <= most)) return false;
    }
    return true;
}

bool isSize(double size_m) {
    return size_m >= PlacedObstacles::kSmallest_m && size_m <= PlacedObstacles::kLargest_m;
}

std::optional<PlacedObstacles::One> readOne(const json& message) {
    if (!message.is_object()) return {};
    const auto place = message.find("place");
    if (place == message.end() || !place->is_number_integer()) return {};
    const auto number = place->get<std::int64_t>();
    if (number < 1 || number > PlacedObstacles::kMost) return {};
    PlacedObstacles::One one;
    one.place = static_cast<int>(number) - 1;
    json kept = {{"place", number}};
    if (message.size() > 1) {
        Solid solid;
        solid.name = namePlace(one.place);
        std::size_t keys = 3;  // place, shape, at
        double at[3], size[3], turn[4] = {1.0, 0.0, 0.0, 0.0};
        if (const auto box = message.find("box"); box != message.end()) {
            solid.kind = Solid::Kind::Box;
            if (!readNumbers(*box, 3, PlacedObstacles::kLargest_m, size) || !std::all_of(size, size + 3, isSize))
                return {};
            solid.size = {size[0], size[1], size[2]};
            kept["box"] = size;
            if (const auto turned = message.find("turn"); turned != message.end()) {
                if (!readNumbers(*turned, 4, 2.0, turn)) return {};
                kept["turn"] = turn;
                ++keys;
            }
        } else if (const auto ball = message.find("ball"); ball != message.end()) {
            solid.kind = Solid::Kind::Sphere;
            if (!ball->is_number()) return {};
            solid.radius = ball->get<double>();
            if (!isSize(solid.radius)) return {};
            kept["ball"] = solid.radius;
        } else {
            return {};
        }
        const auto where = message.find("at");
        if (where == message.end() || !readNumbers(*where, 3, PlacedObstacles::kFarthest_m, at)) return {};
        if (message.size() != keys) return {};
        kept["at"] = at;
        const Eigen::Quaterniond orientation(turn[0], turn[1], turn[2], turn[3]);
        if (!(std::abs(orientation.norm() - 1.0) < 0.01)) return {};
        solid.pose.linear() = orientation.normalized().toRotationMatrix();
        solid.pose.translation() = Eigen::Vector3d(at[0], at[1], at[2]);
        one.solid = solid;
    }
    one.message = kept.dump();
    return one;
}

}  // namespace

std::optional<PlacedObstacles::One> PlacedObstacles::read(const std::string& message) {
    if (message.size() > kLongestMessage) return {};
    return readOne(json::parse(message, nullptr, false));
}

std::vector<std::string> PlacedObstacles::listNames() {
    std::vector<std::string> names;
    for (int place = 0; place < kMost; ++place) names.push_back(namePlace(place));
    return names;
}

std::string PlacedObstacles::write(const Version& version) {
    json text = {{"stamp_s", version.stamp_s}, {"placed", json::array()}};
    for (const One& one : version.all) text["placed"].push_back(json::parse(one.message));
    return text.dump();
}

PlacedObstacles::Version PlacedObstacles::readVersion(const std::string& text, const std::string& place) {
    const json parsed = json::parse(text, nullptr, false);
    Version version;
    bool isSound = parsed.is_object() && parsed.contains("stamp_s") && parsed["stamp_s"].is_number() &&
                   parsed.contains("placed") && parsed["placed"].is_array();
    if (isSound) {
        version.stamp_s = parsed["stamp_s"].get<double>();
        for (const json& message : parsed["placed"]) {
            const std::optional<One> one = readOne(message);
            isSound &= one && one->solid;
            if (isSound) version.all.push_back(*one);
        }
    }
    if (!isSound)
        throw badInput(place, "this attachment does not tell obstacles as viable writes them",
                       "Name a log that this version of viable has written.");
    return version;
}

std::shared_ptr<const Surroundings> PlacedObstacles::surround(const ConfiguredCase& configured,
                                                              const std::vector<One>& all) {
    const CasePlan& plan = configured.plan;
    Environment environment = *plan.environment;
    for (const One& one : all) environment.solids.push_back(*one.solid);
    return makeSurroundings(environment, plan.robot, *plan.geometry, configured.setup.limits);
}

void PlacedObstacles::renumber(const Surroundings& now, const Environment& own, LimitReport& nearest) noexcept {
    const auto& solids = now.environment().solids;
    const auto ownSolids = static_cast<int>(own.solids.size());
    const int placed = static_cast<int>(solids.size()) - ownSolids;
    if (nearest.other < ownSolids || placed == 0) return;
    if (nearest.other >= ownSolids + placed) {
        nearest.other -= placed;
        return;
    }
    const char number = solids[nearest.other].name.back();
    nearest.other = ownSolids + static_cast<int>(own.spheres.size()) + (own.map ? 1 : 0) + (number - '1');
}

PlacedObstacles::PlacedObstacles(const ConfiguredCase& configured, SurroundingsFeed& feed, Recorder* recorder)
    : configured_(configured), feed_(feed), recorder_(recorder) {}

bool PlacedObstacles::request(const std::string& message) {
    std::optional<One> one = read(message);
    if (!one) return false;
    const std::lock_guard guard(lock_);
    auto& place = wished_[one->place];
    place = one->solid ? std::move(one) : std::nullopt;
    isNew_ = true;
    return true;
}

bool PlacedObstacles::look(double time_s) {
    // Known by the tick before: an age that a filter tells is then never 0, and each version has a stamp of its own.
    const double stamp_s = time_s - configured_.plan.tick_s;
    if (!(stamp_s > version_.stamp_s)) return false;
    {
        const std::lock_guard guard(lock_);
        if (!isNew_) return false;
        isNew_ = false;
        version_.all.clear();
        for (const std::optional<One>& one : wished_)
            if (one) version_.all.push_back(*one);
    }
    version_.stamp_s = stamp_s;
    auto next = surround(configured_, version_.all);
    if (recorder_)
        recorder_->attach({kAttachment + std::to_string(++count_) + ".json", "application/json", write(version_)});
    feed_.put(std::move(next), stamp_s);
    return true;
}

std::string PlacedObstacles::describe() const {
    json all = json::array();
    for (const One& one : version_.all) all.push_back(json::parse(one.message));
    return json{{"placed", all}}.dump();
}

}  // namespace viable
