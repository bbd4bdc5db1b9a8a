#include "robot/CollisionFile.h"

#include <algorithm>

#include "viable/config/Settings.h"

namespace viable::detail {

namespace {

constexpr double kFarthest_m = 1e3;  ///< no arm is larger

struct Capsule {
    LinkShape shape;

    template <class V>
    void describe(V& v) {
        v(shape.from, "from", "m", "One end of its axis, in the link's frame.")
            .atLeast(-kFarthest_m)
            .upTo(kFarthest_m)
            .required();
        v(shape.to, "to", "m", "The other end.").atLeast(-kFarthest_m).upTo(kFarthest_m).required();
        v(shape.radius, "radius", "m", "Around the axis.").above(0).upTo(kFarthest_m).required();
    }
};

class CollisionFileReader {
public:
    CollisionFileReader(const UrdfRobot& urdf, Blanks blanks) : urdf_(urdf), blanks_(blanks) {}

    CollisionFile read(const ConfigNode& root) {
        CollisionFile file;
        ConfigMap map(root);
        toInteger(map.require("schema"), 1, 1);
        readLinks(map.require("links"), file);
        if (const ConfigNode* pairs = map.find("may_touch")) readPairs(*pairs, file);
        map.finish();
        return file;
    }

private:
    void readLinks(const ConfigNode& node, CollisionFile& file) const {
        if (skipsBlank(node)) return;
        if (node.kind != ConfigNode::Kind::Map || node.entries.empty())
            throw badInput(
                node.place(), "there is no link with a capsule",
                "Write `LINK: [{from: [x, y, z], to: [x, y, z], radius: r}]` for each link that can hit something.");
        std::size_t count = 0;
        for (const auto& [name, capsules] : node.entries) {
            const UrdfRobot::LinkPlace& place = findLink(name, capsules);
            if (skipsBlank(capsules)) continue;
            if (capsules.kind != ConfigNode::Kind::List || capsules.items.empty())
                throw badInput(capsules.place(), "the capsules of a link are a list",
                               "Write a list of {from, to, radius}; leave out a link that has none.");
            LinkShapes& link = file.links.emplace_back(LinkShapes{name, place.carrier, place.placement, {}, {}});
            for (const ConfigNode& item : capsules.items) {
                Capsule capsule;
                readSettings(item, capsule);
                link.shapes.push_back(std::move(capsule.shape));
            }
            count += link.shapes.size();
            if (count > kMaxCapsules)
                throw badInput(capsules.place(),
                               "the robot has more than " + std::to_string(kMaxCapsules) + " capsules",
                               "All pairs of them are looked at in every tick: use fewer and larger ones.");
        }
    }

    void readPairs(const ConfigNode& node, CollisionFile& file) const {
        if (node.kind != ConfigNode::Kind::List)
            throw badInput(node.place(), "the pairs of links are a list", "Write a list of [link, link], or [].");
        for (const ConfigNode& item : node.items) {
            if (item.kind != ConfigNode::Kind::List || item.items.size() != 2)
                throw badInput(item.place(), "this is not a pair of links", "Write [link, link].");
            std::pair<std::string, std::string> pair{toText(item.items[0]), toText(item.items[1])};
            findLink(pair.first, item.items[0]);
            findLink(pair.second, item.items[1]);
            if (pair.first == pair.second)
                throw badInput(item.place(), "this pairs the link `" + pair.first + "` with itself",
                               "A link may touch itself anyway: remove the pair.");
            if (pair.second < pair.first) std::swap(pair.first, pair.second);
            if (std::find(file.mayTouch.begin(), file.mayTouch.end(), pair) != file.mayTouch.end())
                throw badInput(item.place(),
                               "the links `" + pair.first + "` and `" + pair.second + "` are paired twice",
                               "Remove one of the two.");
            file.mayTouch.push_back(std::move(pair));
        }
    }

    const UrdfRobot::LinkPlace& findLink(const std::string& name, const ConfigNode& node) const {
        const auto found = urdf_.links.find(name);
        if (found != urdf_.links.end()) return found->second;
        std::vector<std::string> names;
        for (const auto& link : urdf_.links) names.push_back(link.first);
        const std::string closest = findClosestName(name, names);
        throw badInput(node.place(), "the robot has no link `" + name + "`",
                       closest.empty() ? "Name a link of the URDF." : "Did you mean `" + closest + "`?");
    }

    bool skipsBlank(const ConfigNode& node) const {
        if (blanks_ == Blanks::Refuse) refuseBlank(node);
        return node.kind == ConfigNode::Kind::Scalar && !node.quoted && node.text == kBlank;
    }

    const UrdfRobot& urdf_;
    Blanks blanks_;
};

}  // namespace

CollisionFile readCollisionFile(const std::filesystem::path& file, const UrdfRobot& urdf, Blanks blanks) {
    const ConfigNode root = readConfigFile(file);
    return CollisionFileReader(urdf, blanks).read(root);
}

}  // namespace viable::detail
