#pragma once

#include <Eigen/Core>

#include "ground/model/registers.h"

namespace ground {

/// Adds left * right to `sum`, by columns in whole registers: `left` and `sum` have a multiple of eight
/// rows, with zeros where a matrix needs fewer. For six or eight rows it takes half of the time of
/// Eigen's product. `right` has the rows that the columns of `left` need, or more.
template <class Left, class Right, class Sum>
GROUND_INLINE void addProduct(const Left& left, const Right& right, Sum& sum) {
  constexpr int kRows = Sum::RowsAtCompileTime, kRegister = 8;
  static_assert(kRows % kRegister == 0 && Left::RowsAtCompileTime == kRows, "whole registers");
  for (Eigen::Index j = 0; j < sum.cols(); ++j) {
    for (int i = 0; i < kRows; i += kRegister) {
      Vec8 total = registers::load<Vec8>(&sum(i, j));
      for (Eigen::Index k = 0; k < left.cols(); ++k)
        total += registers::load<Vec8>(&left(i, k)) * right(k, j);
      registers::store(total, &sum(i, j));
    }
  }
}

}  // namespace ground
