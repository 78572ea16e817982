#include "ground/control/box_minimum.h"

#include <cmath>

namespace ground {

template <int kCount>
bool BoxMinimumOf<kCount>::solve(const Square& H, const Vector& g, const Vector& low, const Vector& high) {
  if (!factor(H)) return false;
  unbounded_ = -g;
  solveFactored(unbounded_.transpose());
  minimum_ = unbounded_.cwiseMax(low).cwiseMin(high);
  free_ = (unbounded_.array() >= low.array() && unbounded_.array() <= high.array()).matrix();
  if (free_.all()) return true;
  // Each change of the active set lowers the function; the limit guards against rounding errors.
  constexpr int kMaxChanges = 64;
  for (int change = 0; change < kMaxChanges; ++change)
    if (moveFree(H, g, low, high) && !release(H, g, low, high)) break;
  factorFree(H);
  return true;
}

/// Cholesky factorisation of H; returns false if H is not positive definite.
template <int kCount>
bool BoxMinimumOf<kCount>::factor(const Square& H) {
  L_ = H;
  const Eigen::Index n = H.cols();
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index k = 0; k < j; ++k)
      for (Eigen::Index i = j; i < n; ++i) L_(i, j) -= L_(j, k) * L_(i, k);
    if (!(L_(j, j) > 0)) return false;
    const double root = std::sqrt(L_(j, j));
    for (Eigen::Index i = j; i < n; ++i) L_(i, j) /= root;
  }
  return true;
}

/// Factorises H with the rows and columns of elements at a bound replaced by those of the identity.
template <int kCount>
void BoxMinimumOf<kCount>::factorFree(const Square& H) {
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
/// Returns whether they reached the minimum.
template <int kCount>
bool BoxMinimumOf<kCount>::moveFree(const Square& H, const Vector& g, const Vector& low, const Vector& high) {
  factorFree(H);
  const Vector slope = g + H * minimum_;
  const Vector step =
      -solveFree(Eigen::Matrix<double, 1, kCount, Eigen::RowMajor, 1, kMost>(slope.transpose())).transpose();
  double length = 1;
  Eigen::Index first = -1;
  for (Eigen::Index i = 0; i < step.size(); ++i) {
    if (!free_(i) || step(i) == 0) continue;
    const double distance = (step(i) > 0 ? high(i) : low(i)) - minimum_(i);
    if (distance / step(i) >= length) continue;
    length = distance / step(i);
    first = i;
  }
  minimum_ = (minimum_ + length * step).cwiseMax(low).cwiseMin(high);
  if (first < 0) return true;
  minimum_(first) = step(first) > 0 ? high(first) : low(first);
  free_(first) = false;
  return false;
}

/// Frees the element whose bound costs most; returns whether there is one.
template <int kCount>
bool BoxMinimumOf<kCount>::release(const Square& H, const Vector& g, const Vector& low, const Vector& high) {
  constexpr double kRounding = 1e-14;  // relative
  const Vector slope = g + H * minimum_;
  Eigen::Index most = -1;
  double largest = 0;
  for (Eigen::Index i = 0; i < slope.size(); ++i) {
    if (free_(i) || low(i) == high(i)) continue;
    // Positive if the function decreases towards the inside.
    const double gain = minimum_(i) == low(i) ? -slope(i) : slope(i);
    const double terms = std::abs(g(i)) + H.row(i).cwiseAbs().dot(minimum_.cwiseAbs());
    if (gain <= kRounding * terms || gain <= largest) continue;
    largest = gain;
    most = i;
  }
  if (most < 0) return false;
  free_(most) = true;
  return true;
}

template class BoxMinimumOf<2>;
template class BoxMinimumOf<Eigen::Dynamic>;

}  // namespace ground
