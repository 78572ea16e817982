#pragma once

#include <Eigen/Core>

#include "ground/model/thrusters.h"

namespace ground {

/// A number for each thruster.
using PerThruster = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxThrusters, 1>;

/// Minimises g' d + d' H d / 2 for low <= d <= high, with a positive definite H: a primal active
/// set (Nocedal and Wright, Numerical Optimization, 2nd ed., 16.5). It allocates no memory.
class BoxMinimum {
 public:
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxThrusters, kMaxThrusters>;
  using Flags = Eigen::Matrix<bool, Eigen::Dynamic, 1, 0, kMaxThrusters, 1>;

  /// Solves; returns false, without a result, if H is not positive definite. Low must not be above
  /// high.
  bool solve(const Square& H, const PerThruster& g, const PerThruster& low, const PerThruster& high);

  /// The minimum inside the box.
  const PerThruster& minimum() const { return minimum_; }
  /// The minimum without bounds.
  const PerThruster& unbounded() const { return unbounded_; }
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
  bool moveFree(const Square& H, const PerThruster& g, const PerThruster& low, const PerThruster& high);
  bool release(const Square& H, const PerThruster& g, const PerThruster& low, const PerThruster& high);

  Square L_;  ///< Cholesky factor of H or of its free part
  PerThruster unbounded_, minimum_;
  Flags free_;
};

}  // namespace ground
