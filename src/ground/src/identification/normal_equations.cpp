#include "normal_equations.h"

namespace ground::detail {

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
  const auto J = rows.derivatives.middleRows(first, count);
  return {J.transpose() * (weight.asDiagonal() * J), J.transpose() * product, loss.sum()};
}

double lossOf(const Eigen::VectorXd& residuals, const Weigh& weigh) {
  Eigen::VectorXd loss(residuals.size());
  weigh(residuals.data(), static_cast<int>(loss.size()), nullptr, nullptr, loss.data());
  return loss.sum();
}

}  // namespace ground::detail
