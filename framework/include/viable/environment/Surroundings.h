#pragma once

#include <algorithm>

#include "viable/environment/Environment.h"

namespace viable {

class DistanceField;
class OccupancyMap;

/** The surroundings of an arm, prepared for queries in a tick. Solids are in closed form, the map is a distance
field, and moving spheres have their paths. Immutable, so that one thread may query while another prepares the next
one. */
class Surroundings {
public:
    /** @param lower, upper  box that the arm can reach, base frame [m]: covered by the distance field
    @param reach_m       larger distances need not be distinguished [m] Reads the map file and makes its distance
    field. It shares those of earlier Surroundings of this process when file, pose and box are the same. At most two
    maps stay in memory until the process ends. Throws Error (BadInput). */
    Surroundings(const Environment& environment, const Eigen::Vector3d& lower, const Eigen::Vector3d& upper,
                 double reach_m);
    ~Surroundings();
    Surroundings(const Surroundings&) = delete;
    Surroundings& operator=(const Surroundings&) = delete;

    /** The obstacles by index: solids, then spheres, then the map. */
    int size() const { return static_cast<int>(names_.size()); }
    const std::string& name(int obstacle) const { return names_[static_cast<std::size_t>(obstacle)]; }
    const Environment& environment() const { return environment_; }
    /** Null without one. */
    const OccupancyMap* map() const;

    /** The nearest obstacle to a point. */
    struct Nearest {
        double distance = std::numeric_limits<double>::infinity();  ///< a lower bound [m]; negative inside
        int obstacle = -1;
        Eigen::Vector3d gradient = Eigen::Vector3d::Zero();  ///< unit vector away from it
    };

    /** A lower bound of the distance of p (base frame) from all obstacles at time t of the run and at any later time
    [m]. A moving sphere counts with the whole rest of its path, so that it never hits an arm at rest there. When t
    is NaN it counts with its whole path. Solids and spheres: exact outside; inside a box or a cylinder minus the
    distance to the nearest face. The map: see DistanceField; -infinity outside of the box [lower, upper]. -infinity,
    of no obstacle, when p is NaN. Infinity without obstacles. Real time. */
    double calcDistance(const Eigen::Vector3d& p, double t) const;
    /** The same, with the obstacle and the gradient. */
    Nearest findNearest(const Eigen::Vector3d& p, double t) const;

    /** Obstacles that a query leaves out. */
    struct LeftOut {
        std::array<int, 8> obstacles{};
        int count = 0;
        bool has(int obstacle) const {
            return std::find(obstacles.begin(), obstacles.begin() + count, obstacle) != obstacles.begin() + count;
        }
        /** False where no more can be left out. */
        bool add(int obstacle);
    };
    Nearest findNearest(const Eigen::Vector3d& p, double t, const LeftOut& without) const;
    /** The same for one obstacle alone. */
    Nearest findNearest(const Eigen::Vector3d& p, double t, int obstacle) const;

private:
    struct Shapes;
    struct MapField;
    static std::shared_ptr<const MapField> shareMapField(const MapChoice& choice, const Eigen::Vector3d& lower,
                                                         const Eigen::Vector3d& upper, double cell_m, double reach_m);
    template <bool kWithGradient, typename IsLeftOut>
    Nearest findIn(const Eigen::Vector3d& p, double t, const IsLeftOut& isLeftOut) const;

    Environment environment_;
    std::vector<std::string> names_;
    std::unique_ptr<const Shapes> shapes_;
    std::shared_ptr<const MapField> mapField_;
    const DistanceField* field_ = nullptr;  ///< part of mapField_
};

/** Hands complete Surroundings from the thread that makes them to the thread that uses them. Neither side locks or
waits. The maker puts, the user takes the newest. One thread each.

It is a triple buffer. The maker owns one slot and the user one. The third, ready, lies between them under its index
in one atomic. A put() fills the maker's slot and exchanges it for the ready one. A take() exchanges the user's slot
for the ready one when that is new. Each exchange releases what its side wrote and acquires what the other did. The
maker empties a returned slot in a later put(). So only put() and the destructor destroy Surroundings, up to one
put() after the user left them. */
class SurroundingsFeed {
public:
    /** @param first  not null */
    explicit SurroundingsFeed(std::shared_ptr<const Surroundings> first, double stamp_s = 0.0);
    SurroundingsFeed(const SurroundingsFeed&) = delete;
    SurroundingsFeed& operator=(const SurroundingsFeed&) = delete;

    /** The maker's thread: the user's next take() returns these. Old ones that are no longer used are
    destroyed here, never in the user's thread.
    @param next     not null
    @param stamp_s  time of the observation, in the time of the run */
    void put(std::shared_ptr<const Surroundings> next, double stamp_s);

    /** Reserves take() for the caller; false when it is reserved already. */
    bool claim() { return !isClaimed_.exchange(true); }
    /** Ends the caller's reservation. */
    void release() { isClaimed_ = false; }

    /** The view of the user's thread until its next take(). */
    struct View {
        const Surroundings* surroundings = nullptr;  ///< never null
        double stamp_s = 0.0;
        std::int64_t version = 0;  ///< 0: the first; rises by one with each put()
    };
    /** The user's thread; real time. */
    View take();
    /** The result of the last take(), or before it the first surroundings. For others in the user's thread, who
    follow the one that takes. Real time. */
    View view() const;

private:
    struct Slot {
        std::shared_ptr<const Surroundings> surroundings;
        double stamp_s = 0.0;
        std::int64_t version = 0;
    };
    static constexpr unsigned kNew = 4;  ///< added to the index of a ready slot that the user has not seen

    std::array<Slot, 3> slots_;
    std::atomic<unsigned> ready_{0};
    std::atomic<bool> isClaimed_{false};
    unsigned written_ = 1;           ///< the maker's
    std::int64_t version_ = 0;       ///< the maker's
    alignas(64) unsigned used_ = 2;  ///< the user's
};

}  // namespace viable
