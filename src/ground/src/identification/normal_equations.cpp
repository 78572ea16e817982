#include "normal_equations.h"

namespace ground::detail {
namespace {

using Square = Eigen::Matrix<double, kDerivatives, kDerivatives>;

/// The sum of weight left right' over rows.
Square squaresOf(const Derivatives* left, const Derivatives* right, const Eigen::VectorXd& weight) {
  Derivatives sum[kDerivatives];
  for (Derivatives& row : sum) row = Derivatives::zero();
  for (Eigen::Index i = 0; i < weight.size(); ++i) {
    const Derivatives weighted = weight(i) * right[i];
    for (int a = 0; a < kDerivatives; ++a) sum[a] += left[i][a] * weighted;
  }
  Square block;
  for (int a = 0; a < kDerivatives; ++a) block.row(a) = sum[a].head<kDerivatives>();
  return block;
}

}  // namespace

WindowResiduals::WindowResiduals(int rows, int count)
    : residuals(rows),
      passes((count + kDerivatives - 1) / kDerivatives, std::vector<Derivatives>(rows)),
      columns(count) {}

bool WindowResiduals::finite() const {
  Derivatives sum = Derivatives::zero();
  for (const std::vector<Derivatives>& pass : passes)
    for (const Derivatives& row : pass) sum += 0.0 * row;
  return residuals.allFinite() && sum.head<kDerivatives>().allFinite();
}

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

NormalEquations normalEquations(const WindowResiduals& rows, int first, int last, const Weigh& weigh) {
  const int count = last - first;
  Eigen::VectorXd weight(count), product(count), loss(count);
  weigh(rows.residuals.data() + first, count, weight.data(), product.data(), loss.data());
  const auto passes = static_cast<Eigen::Index>(rows.passes.size());
  Eigen::MatrixXd A(kDerivatives * passes, kDerivatives * passes);
  Eigen::VectorXd b(kDerivatives * passes);
  for (Eigen::Index p = 0; p < passes; ++p) {
    const std::vector<Derivatives>& left = rows.passes[p];
    Derivatives sum = Derivatives::zero();
    for (int i = 0; i < count; ++i) sum += product(i) * left[first + i];
    b.segment<kDerivatives>(kDerivatives * p) = sum.head<kDerivatives>();
    for (Eigen::Index q = 0; q <= p; ++q) {
      const auto block = squaresOf(left.data() + first, rows.passes[q].data() + first, weight);
      A.block<kDerivatives, kDerivatives>(kDerivatives * p, kDerivatives * q) = block;
      A.block<kDerivatives, kDerivatives>(kDerivatives * q, kDerivatives * p) = block.transpose();
    }
  }
  return {A.topLeftCorner(rows.columns, rows.columns), b.head(rows.columns), loss.sum()};
}

double lossOf(const Eigen::VectorXd& residuals, const Weigh& weigh) {
  Eigen::VectorXd loss(residuals.size());
  weigh(residuals.data(), static_cast<int>(loss.size()), nullptr, nullptr, loss.data());
  return loss.sum();
}

}  // namespace ground::detail
