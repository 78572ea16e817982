#include "normal_equations.h"

#include <algorithm>

namespace ground::detail {
namespace {

// Size of the column blocks that are multiplied at once: their products fill the registers.
#ifdef __AVX512F__
constexpr int kBlock = 4;
#else
constexpr int kBlock = 2;
#endif
constexpr int kTile = 48;  // rows that stay in the cache while all blocks are multiplied

const double* flat(const Lanes* x) { return reinterpret_cast<const double*>(x); }
double* flat(Lanes* x) { return reinterpret_cast<double*>(x); }

}  // namespace

NormalEquations& NormalEquations::operator+=(const NormalEquations& other) {
  A += other.A;
  b += other.b;
  loss += other.loss;
  return *this;
}

NormalEquations& NormalEquations::operator-=(const NormalEquations& other) {
  A -= other.A;
  b -= other.b;
  loss -= other.loss;
  return *this;
}

void LaneRows::prepare(int rows, int columns) {
  const int padded = (columns + kBlock - 1) / kBlock * kBlock;
  residuals.resize(rows);
  if (stride == padded && derivatives.size() == static_cast<std::size_t>(rows * padded)) return;
  stride = padded;
  derivatives.assign(static_cast<std::size_t>(rows * padded), Lanes(0.0));
}

NormalEquations normalEquations(const WindowResiduals& rows, int columns, int first, int last,
                                const Weigh& weigh) {
  const int count = last - first;
  Eigen::VectorXd weight(count), product(count), loss(count);
  weigh(rows.residuals.data() + first, count, weight.data(), product.data(), loss.data());
  NormalEquations result{Eigen::MatrixXd(columns, columns), Eigen::VectorXd(columns), loss.sum()};
  const int blocks = static_cast<int>(rows.derivatives.cols()) / 8;
  for (int q = 0; q < blocks; ++q) {
    for (int p = 0; p <= q; ++p) {
      Vec8 sum[8] = {}, slope = {};
      for (int i = 0; i < count; ++i) {
        const double* left = &rows.derivatives(first + i, 8 * p);
        Vec8 right = registers::load<Vec8>(&rows.derivatives(first + i, 8 * q));
        if (p == q) slope += product(i) * right;
        right *= weight(i);
        for (int k = 0; k < 8; ++k) sum[k] += left[k] * right;
      }
      for (int j = 0; j < 8 && 8 * q + j < columns; ++j) {
        for (int k = 0; k < 8 && 8 * p + k < columns; ++k)
          result.A(8 * p + k, 8 * q + j) = result.A(8 * q + j, 8 * p + k) = registers::at(sum[k], j);
        if (p == q) result.b(8 * q + j) = registers::at(slope, j);
      }
    }
  }
  return result;
}

LaneSums::LaneSums(int columns) : columns_(columns), blocks_((columns + kBlock - 1) / kBlock) {
  A_.assign(blocks_ * (blocks_ + 1) / 2 * kBlock * kBlock, Lanes(0.0));
  b_.assign(blocks_ * kBlock, Lanes(0.0));
}

void LaneSums::add(const LaneRows& rows, int first, int last, const Weigh& weigh) {
  for (int begin = first; begin < last; begin += kTile) {
    const int count = std::min(kTile, last - begin);
    Lanes weight[kTile], product[kTile], loss[kTile];
    weigh(flat(&rows.residuals[begin]), 8 * count, flat(weight), flat(product), flat(loss));
    for (int i = 0; i < count; ++i) loss_ += loss[i];
    const Lanes* derivatives = &rows.derivatives[static_cast<std::size_t>(begin) * rows.stride];
    Lanes* A = A_.data();
    for (int q = 0; q < blocks_; ++q)
      for (int p = 0; p <= q; ++p, A += kBlock * kBlock) {
        Lanes sum[kBlock * kBlock];
        Vec8 slope[kBlock] = {};
        std::copy_n(A, kBlock * kBlock, sum);
        const Lanes* row = derivatives;
        for (int i = 0; i < count; ++i, row += rows.stride) {
          Vec8 right[kBlock];
          for (int j = 0; j < kBlock; ++j) {
            right[j] = row[kBlock * q + j].x;
            if (p == q) slope[j] += product[i].x * right[j];
            right[j] *= weight[i].x;
          }
          for (int k = 0; k < kBlock; ++k)
            for (int j = 0; j < kBlock; ++j)
              sum[kBlock * k + j].x += row[kBlock * p + k].x * right[j];
        }
        std::copy_n(sum, kBlock * kBlock, A);
        if (p == q)
          for (int j = 0; j < kBlock; ++j) b_[kBlock * q + j].x += slope[j];
      }
  }
}

void LaneSums::take(int lane, NormalEquations& result) {
  const auto out = [lane](Lanes& from) {
    double& x = from[lane];
    const double value = x;
    x = 0;
    return value;
  };
  result.A.resize(columns_, columns_);
  result.b.resize(columns_);
  Lanes* A = A_.data();
  for (int q = 0; q < blocks_; ++q)
    for (int p = 0; p <= q; ++p)
      for (int k = 0; k < kBlock; ++k)
        for (int j = 0; j < kBlock; ++j) {
          const int row = kBlock * p + k, column = kBlock * q + j;
          const double value = out(*A++);
          if (row < columns_ && column < columns_)
            result.A(row, column) = result.A(column, row) = value;
        }
  for (int i = 0; i < columns_; ++i) result.b(i) = out(b_[i]);
  result.loss = out(loss_);
}

Lanes losses(const std::vector<Lanes>& residuals, const Weigh& weigh) {
  Lanes sum = 0.0;
  const int rows = static_cast<int>(residuals.size());
  for (int begin = 0; begin < rows; begin += kTile) {
    const int count = std::min(kTile, rows - begin);
    Lanes loss[kTile];
    weigh(flat(&residuals[begin]), 8 * count, nullptr, nullptr, flat(loss));
    for (int i = 0; i < count; ++i) sum += loss[i];
  }
  return sum;
}

}  // namespace ground::detail
