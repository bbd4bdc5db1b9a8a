#pragma once

namespace viable {

/** Which of an arm's joints slide: what is of all of them has more than one unit where only some do. */
enum class Sliding : unsigned char { None, Some, All };

/** @param arm  has a size() and slides(joint) */
template <class Arm>
Sliding findSliding(const Arm& arm) {
    int count = 0;
    for (int i = 0; i < arm.size(); ++i) count += arm.slides(i);
    return count == 0 ? Sliding::None : count == arm.size() ? Sliding::All : Sliding::Some;
}

/** A word for all joints together. */
inline const char* choose(Sliding sliding, const char* none, const char* some, const char* all) {
    return sliding == Sliding::None ? none : sliding == Sliding::All ? all : some;
}

}  // namespace viable
