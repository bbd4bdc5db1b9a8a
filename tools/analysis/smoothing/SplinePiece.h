#pragma once

#include <Eigen/Core>

namespace viable::detail {

double factorial(int n);

/** What does not depend on the readings: one piece of length 1 between two states (p, v, a, j). */
struct SplinePiece {
    using Matrix4 = Eigen::Matrix4d;
    using Vector8 = Eigen::Matrix<double, 8, 1>;
    using Matrix8 = Eigen::Matrix<double, 8, 8>;
    using Pair = Eigen::Matrix<double, 4, 8>;  // of the states at both ends of a piece

    Matrix4 information;    // inverse of the covariance that white noise in j' of density 1 leaves after the piece
    double logDeterminant;  // of that covariance
    Pair innovation;        // w = innovation * (x0, x1)
    Matrix8 prior;          // w' information w as a form in (x0, x1)
    // Coefficients of 1, u^2, u^4, u^6 and of u, u^3, u^5, u^7 from (x0, x1), a column each.
    Eigen::Matrix<double, 8, 4> evenPowers, oddPowers;

    SplinePiece();

    /** Row that gives the order-th derivative at u in [0, 1] from (x0, x1): the polynomial of degree 7 through both
    states, which is the expected path between them. */
    Vector8 calcRow(double u, int order) const {
        Eigen::Vector4d even = Eigen::Vector4d::Zero(), odd = Eigen::Vector4d::Zero();
        double power = 1.0;
        for (int m = order; m < 8; ++m, power *= u) {
            double slope = power;
            for (int k = 0; k < order; ++k) slope *= m - k;
            (m % 2 == 0 ? even : odd)[m / 2] = slope;
        }
        return evenPowers.lazyProduct(even) + oddPowers.lazyProduct(odd);
    }

    /** Covariance of the path at u, both ends known, for density 1. */
    Matrix4 calcBridge(double u) const;
};

/** The one of its kind. */
const SplinePiece& getPiece();

}  // namespace viable::detail
