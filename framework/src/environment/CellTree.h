#pragma once

#include <algorithm>

#include "environment/OccupancyMap.h"

namespace viable::detail {

/** Cubes in a binary tree of boxes around them, for the ones near a place. */
class CellTree {
public:
    CellTree() = default;
    explicit CellTree(std::vector<OccupancyMap::Cell> cells) : cells_(std::move(cells)) {
        if (!cells_.empty()) build(0, cells_.size());
    }

    /** Calls `visit` for every cube that lies within `best` of `box`, nearer branches first; `visit` may make `best`
    smaller, and returns nothing. */
    template <class Visit>
    void visitNear(const Eigen::AlignedBox3d& box, const double& best, Visit&& visit) const {
        if (!nodes_.empty()) visitNode(0, calcGap(nodes_[0].box, box), box, best, visit);
    }

    static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

    /** The squared distance of a point from the nearest cube [m^2], or `squared` when none is nearer than that.
    @param nearest  index of a cube to begin with, for points beside each other, or kNone; that of the nearest after */
    double findSquaredDistance(const Eigen::Vector3d& point, double squared, std::size_t& nearest) const {
        if (nodes_.empty()) return squared;
        if (nearest != kNone) squared = std::min(squared, calcSquared(cells_[nearest], point));
        findInNode(0, calcSquared(nodes_[0].box, point), point, squared, nearest);
        return squared;
    }

private:
    static constexpr std::size_t kLeafCells = 4;

    struct Node {
        Eigen::AlignedBox3d box;
        std::size_t begin = 0, end = 0;  ///< its cubes
        std::size_t right = 0;           ///< its second child, the first follows it; 0: a leaf
    };

    static double calcGap(const Eigen::AlignedBox3d& a, const Eigen::AlignedBox3d& b) {
        return (a.min() - b.max()).cwiseMax(b.min() - a.max()).cwiseMax(0.0).norm();
    }

    static double calcSquared(const Eigen::AlignedBox3d& box, const Eigen::Vector3d& p) {
        return (box.min() - p).cwiseMax(p - box.max()).cwiseMax(0.0).squaredNorm();
    }
    static double calcSquared(const OccupancyMap::Cell& cell, const Eigen::Vector3d& p) {
        return ((p - cell.centre).cwiseAbs().array() - 0.5 * cell.edge).max(0.0).square().sum();
    }

    void findInNode(std::size_t index, double gap, const Eigen::Vector3d& p, double& squared,
                    std::size_t& nearest) const {
        if (gap >= squared) return;
        const Node& node = nodes_[index];
        if (node.right == 0) {
            for (std::size_t i = node.begin; i < node.end; ++i) {
                const double now = calcSquared(cells_[i], p);
                if (now >= squared) continue;
                squared = now;
                nearest = i;
            }
            return;
        }
        std::size_t near = index + 1, far = node.right;
        double nearGap = calcSquared(nodes_[near].box, p), farGap = calcSquared(nodes_[far].box, p);
        if (farGap < nearGap) {
            std::swap(near, far);
            std::swap(nearGap, farGap);
        }
        findInNode(near, nearGap, p, squared, nearest);
        findInNode(far, farGap, p, squared, nearest);
    }

    std::size_t build(std::size_t begin, std::size_t end) {
        const std::size_t index = nodes_.size();
        nodes_.emplace_back();
        Eigen::AlignedBox3d box, centres;
        for (std::size_t i = begin; i < end; ++i) {
            const OccupancyMap::Cell& cell = cells_[i];
            centres.extend(cell.centre);
            box.extend(Eigen::Vector3d(cell.centre.array() - 0.5 * cell.edge));
            box.extend(Eigen::Vector3d(cell.centre.array() + 0.5 * cell.edge));
        }
        std::size_t right = 0;
        if (end - begin > kLeafCells) {
            int axis;
            centres.sizes().maxCoeff(&axis);
            const std::size_t middle = begin + (end - begin) / 2;
            const auto at = [&](std::size_t i) { return cells_.begin() + static_cast<std::ptrdiff_t>(i); };
            std::nth_element(at(begin), at(middle), at(end),
                             [axis](const auto& a, const auto& b) { return a.centre[axis] < b.centre[axis]; });
            build(begin, middle);
            right = build(middle, end);
        }
        nodes_[index] = {box, begin, end, right};
        return index;
    }

    template <class Visit>
    void visitNode(std::size_t index, double gap, const Eigen::AlignedBox3d& box, const double& best,
                   Visit& visit) const {
        if (gap > 0.0 && gap >= best) return;  // where they overlap the cubes may be nearer than any gap
        const Node& node = nodes_[index];
        if (node.right == 0) {
            for (std::size_t i = node.begin; i < node.end; ++i) visit(cells_[i]);
            return;
        }
        std::size_t near = index + 1, far = node.right;
        double nearGap = calcGap(nodes_[near].box, box), farGap = calcGap(nodes_[far].box, box);
        if (farGap < nearGap) {
            std::swap(near, far);
            std::swap(nearGap, farGap);
        }
        visitNode(near, nearGap, box, best, visit);
        visitNode(far, farGap, box, best, visit);
    }

    std::vector<OccupancyMap::Cell> cells_;
    std::vector<Node> nodes_;
};

}  // namespace viable::detail
