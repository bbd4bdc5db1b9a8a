#include "environment/DistanceField.h"

#include <benchmark/benchmark.h>
#include <dynamicEDT3D/dynamicEDTOctomap.h>
#include <octomap/OcTree.h>
#include <unistd.h>

#include <random>

#include "viable/environment/Surroundings.h"

// A distance from a field of a million nodes (2 m at 2 cm), against what one would ask else: OctoMap's search(), which only
// says occupied or free, and the distance of dynamicEDT3D's map, which is that of the cell and no lower bound; and the
// building of both.

namespace viable {
namespace {

constexpr double kCell_m = 0.02;
constexpr double kHalf_m = 0.99;  // 100 cells on each edge
constexpr double kReach_m = 0.5;

/** A room: floor, wall, table and clutter of 2 cm cells; the rest known as free. */
struct Room {
    Room() : tree(kCell_m) {
        std::mt19937 random(1);
        std::uniform_real_distribution<double> place(-1.5, 1.5);
        for (double x = -1.51; x < 1.52; x += kCell_m)
            for (double y = -1.51; y < 1.52; y += kCell_m) {
                tree.updateNode(x, y, -0.8, true, true);
                tree.updateNode(1.0, x, y, true, true);
                if (x > 0.2 && x < 0.9 && y > -0.6 && y < 0.6) tree.updateNode(x, y, -0.1, true, true);
                for (double z = -0.78; z < 0.98; z += kCell_m)
                    if (!tree.search(x, y, z)) tree.updateNode(x, y, z, false, true);
            }
        for (int i = 0; i < 500; ++i) tree.updateNode(place(random), place(random), place(random), true, true);
        tree.updateInnerOccupancy();
        tree.prune();
        const std::filesystem::path file =
            std::filesystem::temp_directory_path() / ("viable-bench-" + std::to_string(getpid()) + ".bt");
        tree.writeBinary(file.string());
        choice.name = "map";
        choice.file = file;
        choice.unknown = UnknownSpace::Free;
        map = std::make_unique<OccupancyMap>(choice);

        Environment environment;
        environment.map = choice;
        for (int i = 0; i < 6; ++i) {
            Solid solid;
            solid.kind = i < 3 ? Solid::Kind::Box : i < 5 ? Solid::Kind::Cylinder : Solid::Kind::HalfSpace;
            solid.size << 0.3, 0.2, 0.4;
            solid.radius = 0.1;
            solid.length = 0.5;
            solid.pose.linear() = Eigen::AngleAxisd(0.3 * i, Eigen::Vector3d::UnitX()).toRotationMatrix();
            solid.pose.translation() << 0.7 * std::cos(i), 0.7 * std::sin(i), -0.1 * i;
            environment.solids.push_back(solid);
        }
        const Eigen::Vector3d corner = Eigen::Vector3d::Constant(kHalf_m);
        withMap = std::make_unique<Surroundings>(environment, -corner, corner, kReach_m);
        environment.map.reset();
        solidsOnly = std::make_unique<Surroundings>(environment, -corner, corner, kReach_m);
        std::filesystem::remove(file);

        // As an arm asks: places along walks, not jumps through the room.
        std::uniform_real_distribution<double> step(-0.01, 0.01);
        Eigen::Vector3d p = Eigen::Vector3d::Zero();
        for (int i = 0; i < 4096; ++i) {
            if (i % 32 == 0) p << 0.6 * place(random), 0.6 * place(random), 0.6 * place(random);
            p += Eigen::Vector3d(step(random), step(random), step(random));
            places.push_back(p);
        }
    }
    DistanceField makeField() const {
        const Eigen::Vector3d corner = Eigen::Vector3d::Constant(kHalf_m);
        return DistanceField(*map, UnknownSpace::Free, Eigen::Isometry3d::Identity(), -corner, corner, kCell_m,
                             kReach_m, "bench");
    }
    std::unique_ptr<DynamicEDTOctomap> makeOther() {
        const float half = static_cast<float>(kHalf_m);
        auto other = std::make_unique<DynamicEDTOctomap>(static_cast<float>(kReach_m), &tree,
                                                         octomap::point3d(-half, -half, -half),
                                                         octomap::point3d(half, half, half), false);
        other->update();
        return other;
    }
    octomap::OcTree tree;
    MapChoice choice;
    std::unique_ptr<OccupancyMap> map;
    std::unique_ptr<Surroundings> withMap, solidsOnly;
    std::vector<Eigen::Vector3d> places;
};

Room& getRoom() {
    static Room room;
    return room;
}

octomap::point3d toPoint(const Eigen::Vector3d& p) {
    return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
}

template <class Ask>
void runQueries(benchmark::State& state, const Ask& ask) {
    const Room& room = getRoom();
    std::size_t k = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(ask(room.places[k]));
        k = (k + 1) % room.places.size();
    }
    state.counters["n"] = 1;
}

bool registerAll() {
    benchmark::RegisterBenchmark("map_search_octomap", [](benchmark::State& state) {
        const octomap::OcTree& tree = getRoom().tree;
        runQueries(state, [&](const Eigen::Vector3d& p) { return tree.search(toPoint(p)); });
    });
    benchmark::RegisterBenchmark("map_distance_dynamic_edt", [](benchmark::State& state) {
        const auto other = getRoom().makeOther();
        runQueries(state, [&](const Eigen::Vector3d& p) { return other->getDistance(toPoint(p)); });
    });
    benchmark::RegisterBenchmark("map_distance_field", [](benchmark::State& state) {
        const DistanceField field = getRoom().makeField();
        runQueries(state, [&](const Eigen::Vector3d& p) { return field.calcDistance(p); });
        state.counters["nodes"] = static_cast<double>(field.nodes());
    });
    benchmark::RegisterBenchmark("map_distance_field_gradient", [](benchmark::State& state) {
        const DistanceField field = getRoom().makeField();
        runQueries(state, [&](const Eigen::Vector3d& p) {
            Eigen::Vector3d gradient;
            const double distance = field.calcDistance(p, gradient);
            benchmark::DoNotOptimize(gradient.data());
            return distance;
        });
    });
    benchmark::RegisterBenchmark("surroundings_six_solids", [](benchmark::State& state) {
        runQueries(state, [&](const Eigen::Vector3d& p) { return getRoom().solidsOnly->calcDistance(p, 0.0); });
    });
    benchmark::RegisterBenchmark("surroundings_six_solids_map", [](benchmark::State& state) {
        const Surroundings& surroundings = *getRoom().withMap;
        runQueries(state, [&](const Eigen::Vector3d& p) { return surroundings.calcDistance(p, 0.0); });
    });
    benchmark::RegisterBenchmark("surroundings_six_solids_map_nearest", [](benchmark::State& state) {
        const Surroundings& surroundings = *getRoom().withMap;
        runQueries(state, [&](const Eigen::Vector3d& p) { return surroundings.findNearest(p, 0.0).gradient.sum(); });
    });
    benchmark::RegisterBenchmark("map_build_field", [](benchmark::State& state) {
        for (auto _ : state) benchmark::DoNotOptimize(getRoom().makeField().nodes());
        state.counters["n"] = 1;
    })->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark("map_build_dynamic_edt", [](benchmark::State& state) {
        for (auto _ : state) benchmark::DoNotOptimize(getRoom().makeOther().get());
        state.counters["n"] = 1;
    })->Unit(benchmark::kMillisecond);
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
