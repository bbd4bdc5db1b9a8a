#pragma once

#include <mutex>

#include "experiment/ConfiguredCase.h"

namespace viable {

class Recorder;

/** Boxes and balls around an arm that a hand adds, moves and removes while the arm moves. There are kMost places, "placed 1" to
"placed 8", each with an obstacle or without. */
class PlacedObstacles {
public:
    static constexpr int kMost = 8;
    static constexpr double kFarthest_m = 10.0;                     ///< from the base, each coordinate
    static constexpr double kSmallest_m = 0.005, kLargest_m = 5.0;  ///< edges, radius
    static constexpr std::size_t kLongestMessage = 512;
    static constexpr char kAttachment[] = "placed_obstacles.";  ///< and a number, as the log carries them

    /** A place with what a message says of it. */
    struct One {
        int place = 0;               ///< from 0
        std::optional<Solid> solid;  ///< none: it is taken away
        std::string message;         ///< JSON of the same, in this program's form
    };
    /** {"place": 1 to 8, "box": [x, y, z] or "ball": radius, "at": [x, y, z], "turn": [w, x, y, z]}, metres, base frame;
    `turn` (of a box) may be missing; without a shape: the place is empty. Nothing: it is not such a message, as a whole. */
    static std::optional<One> read(const std::string& message);

    static std::vector<std::string> listNames();

    /** What one version of the surroundings has beside those of the file, as in a log. */
    struct Version {
        double stamp_s = 0.0;
        std::vector<One> all;
    };
    static std::string write(const Version& version);
    /** Throws Error (BadInput) where this is no such text. */
    static Version readVersion(const std::string& text, const std::string& place);

    /** The case's surroundings and these. */
    static std::shared_ptr<const Surroundings> surround(const ConfiguredCase& configured, const std::vector<One>& all);

    /** What a filter says of the nearest obstacle, in terms of the file's obstacles and, after them, the places. Real time. */
    static void renumber(const Surroundings& now, const Environment& own, LimitReport& nearest) noexcept;

    /** @param recorder  null: no log. All outlive this. */
    PlacedObstacles(const ConfiguredCase& configured, SurroundingsFeed& feed, Recorder* recorder);

    /** Takes a message. False: it is none (see read()), and nothing changes. Any thread. */
    bool request(const std::string& message);
    /** Once in a while, by one thread: hands what has been asked for to the arm.
    @param time_s  of the last tick known; while that stands still, nothing is handed over
    @return  something was */
    bool look(double time_s);
    /** {"placed": [what is there, as in a message]}. By that thread. */
    std::string describe() const;

private:
    const ConfiguredCase& configured_;
    SurroundingsFeed& feed_;
    Recorder* const recorder_;
    std::mutex lock_;
    std::array<std::optional<One>, kMost> wished_;  // with lock_
    bool isNew_ = false;                            // with lock_
    Version version_;                               // of look()'s thread
    int count_ = 0;
};

}  // namespace viable
