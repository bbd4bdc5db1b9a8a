#pragma once

#include <type_traits>

namespace viable::detail {

/** Calls work(size) with the number of joints as a std::integral_constant, so that its loops unroll: that of most arms, with a
gripper's joint or two of them; 0 for others. */
template <class Work>
auto withFixedSize(int joints, const Work& work) {
    switch (joints) {
        case 6:
            return work(std::integral_constant<int, 6>());
        case 7:
            return work(std::integral_constant<int, 7>());
        case 8:
            return work(std::integral_constant<int, 8>());
        case 14:
            return work(std::integral_constant<int, 14>());
        default:
            return work(std::integral_constant<int, 0>());
    }
}

}  // namespace viable::detail
