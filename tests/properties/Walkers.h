#pragma once

#include "Random.h"
#include "viable/environment/People.h"

namespace viable {

/** People who wander about an arm, none faster than stated, and what a sensor with latency and error sees of them. */
class Walkers {
public:
    struct Habits {
        int least = 1, most = 4;                   ///< people
        double slowestOf = 0.2;                    ///< smallest of their largest speeds [m/s]
        double fastest = 2.0;                      ///< largest of their largest speeds [m/s]
        double contactChance = 0.3;                ///< that one may be touched at some speed
        double targetChance = 0.5;                 ///< that one goes for the arm
        double farthest_m = 3.0;                   ///< from there they turn back to the arm
        double slowest = 0.0;                      ///< share of their largest speed
        double jumpChance = 0.0;                   ///< in a tick: somebody is somewhere else at once
        double loseChance = 0.0;                   ///< in a tick: somebody is not seen for a while
        double shortest_s = 0.1, longest_s = 2.0;  ///< until one changes its direction
        double leaves_s =
            0.0;  ///< > 0: all stand where they are until then, and leave straight and as fast as they can
    };

    Walkers(Random& random, const Habits& habits, double tick_s);

    const std::vector<Person>& people() const { return people_; }

    /** What is seen at the present tick. */
    void observe(PeopleObservation& seen);
    /** Where they truly are `t_s` after it. */
    void place(double t_s, PeopleObservation& places) const;
    /** On to the next tick. @param target  where those go who go for the arm [m] */
    void walk(const Eigen::Vector3d& target);
    /** Straight to the target from where they are, as fast as they can. */
    void run(const Eigen::Vector3d& target);

    double time_s() const { return static_cast<double>(tick_) * tick_s_; }
    /** Somebody jumped since, and no observation has told it yet, or the arm has not been told to be clear of him again. */
    bool hasUnseenJump() const { return unseenJump_; }
    bool hasSeenJump() const { return seenJump_; }
    /** The arm keeps apart again from those who jumped and were seen. */
    void forgive() {
        if (!unseenJump_) seenJump_ = false;
    }

    std::int64_t jumps = 0, losses = 0;

private:
    struct Walker {
        Eigen::Vector3d place, velocity;
        std::vector<Eigen::Vector3d> past;  ///< places of the last ticks, the newest last
        bool isAfterArm = false;
        double left_s = 0.0, lost_s = 0.0, period_s = 0.0, next_s = 0.0;
        double jumped_s = -1.0;
        PersonObservation seen;
    };
    void turn(Walker& walker, double speed, const Eigen::Vector3d& target);

    Random& random_;
    Habits habits_;
    double tick_s_;
    std::int64_t tick_ = 0;
    std::vector<Person> people_;
    std::vector<Walker> walkers_;
    bool unseenJump_ = false, seenJump_ = false;
};

}  // namespace viable
