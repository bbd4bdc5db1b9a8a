#include "analysis/smoothing/SplinePiece.h"

#include <Eigen/Dense>
#include <cmath>

namespace viable::detail {

using Matrix4 = SplinePiece::Matrix4;
using Matrix8 = SplinePiece::Matrix8;

/** exp(A u) of the chain p' = v, v' = a, a' = j. */
static Matrix4 makeTransition(double u) {
    Matrix4 F = Matrix4::Zero();
    for (int row = 0; row < 4; ++row)
        for (int column = row; column < 4; ++column)
            F(row, column) = column == row ? 1.0 : F(row, column - 1) * u / (column - row);
    return F;
}

/** Covariance that white noise of density 1 in j' leaves after u. */
static Matrix4 makeProcess(double u) {
    constexpr double kFactorial[] = {6.0, 2.0, 1.0, 1.0};  // (3 - row)!
    double powers[8] = {1.0};
    for (int power = 1; power < 8; ++power) powers[power] = powers[power - 1] * u;
    Matrix4 Q;
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) {
            const int power = 7 - row - column;
            Q(row, column) = powers[power] / (kFactorial[row] * kFactorial[column] * power);
        }
    return Q;
}

double factorial(int n) {
    double product = 1.0;
    for (int i = 2; i <= n; ++i) product *= i;
    return product;
}

SplinePiece::SplinePiece() {
    const Matrix4 process = makeProcess(1.0);
    information = process.inverse();
    logDeterminant = std::log(process.determinant());
    innovation << -makeTransition(1.0), Matrix4::Identity();
    prior = innovation.transpose() * information * innovation;
    Matrix8 ends = Matrix8::Zero();  // (x0, x1) from the coefficients
    for (int order = 0; order < 4; ++order)
        for (int power = order; power < 8; ++power) {
            const double slope = factorial(power) / factorial(power - order);
            if (power == order) ends(order, power) = slope;
            ends(4 + order, power) = slope;
        }
    const Matrix8 powers = ends.inverse();
    for (int m = 0; m < 8; ++m) (m % 2 == 0 ? evenPowers : oddPowers).col(m / 2) = powers.row(m).transpose();
}

Matrix4 SplinePiece::calcBridge(double u) const {
    const Matrix4 left = makeProcess(u);
    const Matrix4 cross = left * makeTransition(1.0 - u).transpose();
    return left - cross * information * cross.transpose();
}

const SplinePiece& getPiece() {
    static const SplinePiece piece;
    return piece;
}

}  // namespace viable::detail
