#include "window_costs.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace ground::detail {
namespace {

using RowMajor = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

}  // namespace

/// The rows of one window, from the last evaluation.
class WindowCosts::OwnCost : public ceres::CostFunction {
 public:
  OwnCost(const WindowCosts& all, std::size_t window) : all_(all), window_(window) {
    const int initial = all.all_.problem().initialSize();
    set_num_residuals(initial);
    mutable_parameter_block_sizes()->push_back(initial);
    if (!all.scaled_.empty())
      mutable_parameter_block_sizes()->push_back(static_cast<int>(all.scaled_.size()));
  }

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const Share& share = all_.windows_[window_];
    const int rows = num_residuals();
    Eigen::Map<Eigen::VectorXd> r(residuals, rows);
    if (!all_.has_derivatives_) {
      r.setZero();
      r(0) = std::sqrt(all_.losses_[window_]);
      return std::isfinite(r(0));
    }
    if (!share.finite) return false;
    r = share.own.rightCols<1>();
    if (!jacobians) return true;
    int column = 0;
    for (std::size_t block = 0; block < parameter_block_sizes().size(); ++block) {
      const int count = parameter_block_sizes()[block];
      if (jacobians[block]) RowMajor(jacobians[block], rows, count) = share.own.middleCols(column, count);
      column += count;
    }
    return true;
  }

 private:
  const WindowCosts& all_;
  std::size_t window_;
};

/// The rows that all windows share. Without free parameters they are a constant; ceres then needs
/// an initial state as their variable.
class WindowCosts::SharedCost : public ceres::CostFunction {
 public:
  explicit SharedCost(const WindowCosts& all) : all_(all) {
    const int free = static_cast<int>(all.scaled_.size());
    set_num_residuals(free + 1);
    mutable_parameter_block_sizes()->push_back(free > 0 ? free : all.all_.problem().initialSize());
  }

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const int rows = num_residuals(), columns = parameter_block_sizes()[0];
    Eigen::Map<Eigen::VectorXd> r(residuals, rows);
    r.setZero();
    if (jacobians && jacobians[0]) RowMajor(jacobians[0], rows, columns).setZero();
    if (!all_.has_derivatives_) return true;
    r = all_.shared_.rightCols<1>();
    if (jacobians && jacobians[0] && rows > 1)
      RowMajor(jacobians[0], rows, columns) = all_.shared_.leftCols(columns);
    return true;
  }

 private:
  const WindowCosts& all_;
};

WindowCosts::WindowCosts(Linearisation& windows, const Free& free, const RobustLoss& robust,
                         std::vector<double>& scaled, Initials& initial)
    : all_(windows),
      free_(free),
      robust_(robust),
      scaled_(scaled),
      initial_(initial),
      windows_(initial.size()) {}

void WindowCosts::addTo(ceres::Problem& solver) {
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    std::vector<double*> blocks = {initial_[w].data()};
    if (!scaled_.empty()) blocks.push_back(scaled_.data());
    solver.AddResidualBlock(new OwnCost(*this, w), nullptr, blocks);
  }
  solver.AddResidualBlock(new SharedCost(*this), nullptr,
                          scaled_.empty() ? initial_[0].data() : scaled_.data());
}

void WindowCosts::PrepareForEvaluation(bool derivatives, bool moved) {
  if (!moved && (has_derivatives_ || !derivatives)) return;
  has_derivatives_ = derivatives;
  const ParameterPoint point{free_.coordinates(scaled_.data()), free_.index, initial_};
  const Weigh weigh = robust_.weighing();
  if (!derivatives) {
    losses_ = all_.losses(point, weigh);
    return;
  }
  all_.normalEquations(
      point, weigh, [](int) { return 1; },
      [&](int window, int, const NormalEquations& equations) { eliminate(equations, windows_[window]); });
  const auto columns = static_cast<Eigen::Index>(free_.index.size()) + 1;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(columns, columns);
  for (const Share& share : windows_)
    if (share.finite) sum += share.shared;
  // Rounding may make pivots of indistinguishable parameters negative.
  const Eigen::LDLT<Eigen::MatrixXd> decomposed(sum);
  const Eigen::MatrixXd upper = decomposed.matrixU();
  const Eigen::PermutationMatrix<Eigen::Dynamic> order(decomposed.transpositionsP());
  shared_ = decomposed.vectorD().cwiseMax(0).cwiseSqrt().asDiagonal() * upper * order;
}

/// Eliminates the initial state from [J r]'[J r] by rows of its Cholesky factor.
void WindowCosts::eliminate(const NormalEquations& equations, Share& share) const {
  const auto n = static_cast<Eigen::Index>(free_.index.size());
  const Eigen::Index k = equations.b.size() - n, columns = k + n + 1;
  share.finite = std::isfinite(equations.A.trace() + equations.b.sum() + equations.loss);
  if (!share.finite) return;
  const Eigen::Map<const Eigen::VectorXd> scale(free_.scale.data(), n);
  Eigen::MatrixXd A(columns, columns);
  A.topLeftCorner(k, k) = equations.A.bottomRightCorner(k, k);
  A.block(0, k, k, n) = equations.A.bottomLeftCorner(k, n) * scale.asDiagonal();
  A.block(0, k + n, k, 1) = equations.b.tail(k);
  A.block(k, k, n, n) = scale.asDiagonal() * equations.A.topLeftCorner(n, n) * scale.asDiagonal();
  A.block(k, k + n, n, 1) = scale.cwiseProduct(equations.b.head(n));
  A(columns - 1, columns - 1) = equations.loss;
  share.own.setZero(k, columns);
  for (Eigen::Index i = 0; i < k; ++i) {
    const Eigen::Index rest = columns - i;
    const double left = A(i, i);
    // Only rounding remains of a column that depends on the earlier ones.
    if (!(left > 1e-14 * equations.A(n + i, n + i))) continue;
    share.own.row(i).tail(rest) = A.row(i).tail(rest) / std::sqrt(left);
    for (Eigen::Index j = i + 1; j < columns; ++j)
      A.row(j).tail(columns - j) -= share.own(i, j) * share.own.row(i).tail(columns - j);
  }
  share.shared = A.bottomRightCorner(n + 1, n + 1);
  share.shared.triangularView<Eigen::StrictlyLower>() = share.shared.transpose();
}

}  // namespace ground::detail
