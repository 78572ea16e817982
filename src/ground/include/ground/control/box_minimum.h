#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "ground/model/thrusters.h"

namespace ground {

/// A number for each of N thrusters; N may be Eigen::Dynamic, then there are at most kMaxThrusters.
template <int N>
using PerThruster = Eigen::Matrix<double, N, 1, 0, N == Eigen::Dynamic ? kMaxThrusters : N, 1>;

/// Minimises g' d + d' H d / 2 for low <= d <= high, with a positive definite H: a primal active
/// set (Nocedal and Wright, Numerical Optimization, 2nd ed., 16.5). An unbounded minimum inside
/// the box takes one factorisation. It allocates no memory.
template <int N>
class BoxMinimum {
 public:
  using Vector = PerThruster<N>;
  static constexpr int kMax = Vector::MaxRowsAtCompileTime;
  using Square = Eigen::Matrix<double, N, N, 0, kMax, kMax>;
  using Flags = Eigen::Matrix<bool, N, 1, 0, kMax, 1>;

  /// Solves; returns false, without a result, if H is not positive definite. Low must not be above
  /// high.
  bool solve(const Square& H, const Vector& g, const Vector& low, const Vector& high) {
    if (!factor(H)) return false;
    unbounded_ = -solved(g);
    minimum_ = unbounded_.cwiseMax(low).cwiseMin(high);
    free_ = (unbounded_.array() >= low.array() && unbounded_.array() <= high.array()).matrix();
    if (free_.all()) return true;
    // Each change of the active set lowers the function; the limit guards against rounding errors.
    constexpr int kMaxChanges = 64;
    for (int change = 0; change < kMaxChanges; ++change) {
      moveFree(H, g, low, high);
      if (!blocked_ && !release(H, g, low, high)) break;
    }
    factorFree(H);
    return true;
  }

  /// The minimum inside the box.
  const Vector& minimum() const { return minimum_; }
  /// The minimum without bounds.
  const Vector& unbounded() const { return unbounded_; }
  /// Which elements of the minimum are not at a bound.
  const Flags& free() const { return free_; }
  /// Product of `rows`, as many columns as H and a multiple of eight rows, with the inverse of H
  /// restricted to the free elements; columns of elements at a bound are zero.
  template <class Rows>
  Rows solveFree(const Rows& rows) const {
    Rows result = Rows::Zero(rows.rows(), rows.cols());
    if constexpr (N == 2) {
      Square inverse = inverse_;
      for (int i = 0; i < N; ++i)
        if (!free_(i)) inverse.row(i).setZero(), inverse.col(i).setZero();
      result = rows * inverse;
    } else {
      for (Eigen::Index i = 0; i < rows.rows(); ++i)
        result.row(i) = freeWay(rows.row(i).transpose()).transpose();
    }
    return result;
  }

 private:
  /// Two elements, the most frequent case, are faster with the inverse.
  bool factor(const Square& H) {
    if constexpr (N == 2) {
      const double determinant = H(0, 0) * H(1, 1) - H(0, 1) * H(1, 0);
      inverse_ << H(1, 1), -H(0, 1), -H(1, 0), H(0, 0);
      inverse_ /= determinant;
      return determinant > 0 && H(0, 0) > 0;
    } else {
      factor_.compute(H);
      return factor_.info() == Eigen::Success;
    }
  }
  Vector solved(const Vector& g) const {
    if constexpr (N == 2)
      return inverse_ * g;
    else
      return factor_.solve(g);
  }
  /// Product of the inverse of H, restricted to the free elements, with a vector.
  Vector freeWay(Vector g) const {
    for (Eigen::Index i = 0; i < free_.size(); ++i)
      if (!free_(i)) g(i) = 0;
    return solved(g);
  }

  /// Factorises H with the rows and columns of elements at a bound replaced by those of the
  /// identity.
  void factorFree(const Square& H) {
    Square masked = H;
    for (Eigen::Index i = 0; i < free_.size(); ++i) {
      if (free_(i)) continue;
      masked.row(i).setZero();
      masked.col(i).setZero();
      masked(i, i) = 1;
    }
    factor(masked);
  }

  /// Moves the free elements towards their minimum, up to the first bound, which becomes active.
  void moveFree(const Square& H, const Vector& g, const Vector& low, const Vector& high) {
    factorFree(H);
    const Vector slope = g + H * minimum_;
    const Vector way = -freeWay(slope);
    double length = 1;
    Eigen::Index first = -1;
    for (Eigen::Index i = 0; i < way.size(); ++i) {
      if (!free_(i) || way(i) == 0) continue;
      const double room = (way(i) > 0 ? high(i) : low(i)) - minimum_(i);
      if (room / way(i) >= length) continue;
      length = room / way(i);
      first = i;
    }
    blocked_ = first >= 0;
    minimum_ = (minimum_ + length * way).cwiseMax(low).cwiseMin(high);
    if (!blocked_) return;
    minimum_(first) = way(first) > 0 ? high(first) : low(first);
    free_(first) = false;
  }

  /// Frees the element whose bound holds it back most; returns whether there is one.
  bool release(const Square& H, const Vector& g, const Vector& low, const Vector& high) {
    const Vector slope = g + H * minimum_;
    Eigen::Index most = -1;
    double least = 0;
    for (Eigen::Index i = 0; i < slope.size(); ++i) {
      if (free_(i) || low(i) == high(i)) continue;
      // Positive if the function falls towards the inside; rounding errors do not count.
      const double gain = minimum_(i) == low(i) ? -slope(i) : slope(i);
      const double terms = std::abs(g(i)) + H.row(i).cwiseAbs().dot(minimum_.cwiseAbs());
      if (gain <= kRounding * terms || gain <= least) continue;
      least = gain;
      most = i;
    }
    if (most < 0) return false;
    free_(most) = true;
    return true;
  }

  static constexpr double kRounding = 1e-14;  ///< relative

  Eigen::LLT<Square> factor_;  ///< unless N is 2
  Square inverse_;             ///< if N is 2
  Vector unbounded_, minimum_;
  Flags free_;
  bool blocked_ = false;
};

}  // namespace ground
