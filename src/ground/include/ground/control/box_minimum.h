#pragma once

#include <Eigen/Core>

#include "ground/model/thrusters.h"

namespace ground {

/// A number for each thruster.
using PerThruster = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxThrusters, 1>;

/// Minimises g' d + d' H d / 2 for low <= d <= high, with a positive definite H: a primal active
/// set (Nocedal and Wright, Numerical Optimization, 2nd ed., 16.5). It allocates no memory. For
/// kCount elements: a pair, which the compiler then unrolls, or Eigen::Dynamic.
template <int kCount>
class BoxMinimumOf {
  static constexpr int kMost = kCount == Eigen::Dynamic ? kMaxThrusters : kCount;

 public:
  using Vector = Eigen::Matrix<double, kCount, 1, 0, kMost, 1>;
  using Square = Eigen::Matrix<double, kCount, kCount, 0, kMost, kMost>;
  using Flags = Eigen::Matrix<bool, kCount, 1, 0, kMost, 1>;

  /// Solves; returns false, without a result, if H is not positive definite. Low must not be above
  /// high.
  bool solve(const Square& H, const Vector& g, const Vector& low, const Vector& high);

  /// The minimum inside the box.
  const Vector& minimum() const { return minimum_; }
  /// The minimum without bounds.
  const Vector& unbounded() const { return unbounded_; }
  /// Which elements of the minimum are not at a bound.
  const Flags& free() const { return free_; }
  /// Solves X_f H_ff = G_f for the free elements f, each row of G by itself; the others are zero.
  template <class Rows>
  Rows solveFree(Rows G) const {
    for (Eigen::Index i = 0; i < free_.size(); ++i)
      if (!free_(i)) G.col(i).setZero();
    solveFactored(G);
    return G;
  }

 private:
  bool factor(const Square& H);
  /// Solves X L L' = G in place. Eigen's LLT takes several times as long for so few elements.
  template <class Rows>
  void solveFactored(Rows&& G) const {
    for (Eigen::Index i = 0; i < G.cols(); ++i) {
      for (Eigen::Index j = 0; j < i; ++j) G.col(i) -= L_(i, j) * G.col(j);
      G.col(i) /= L_(i, i);
    }
    for (Eigen::Index i = G.cols() - 1; i >= 0; --i) {
      for (Eigen::Index j = i + 1; j < G.cols(); ++j) G.col(i) -= L_(j, i) * G.col(j);
      G.col(i) /= L_(i, i);
    }
  }
  void factorFree(const Square& H);
  bool moveFree(const Square& H, const Vector& g, const Vector& low, const Vector& high);
  bool release(const Square& H, const Vector& g, const Vector& low, const Vector& high);

  Square L_;  ///< Cholesky factor of H or of its free part
  Vector unbounded_, minimum_;
  Flags free_;
};

using BoxMinimum = BoxMinimumOf<Eigen::Dynamic>;

extern template class BoxMinimumOf<2>;
extern template class BoxMinimumOf<Eigen::Dynamic>;

}  // namespace ground
