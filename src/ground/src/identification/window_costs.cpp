#include "window_costs.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <cstring>

#include "parallel.h"

namespace ground {

NormalEquations normalEquations(const Derivatives& rows, int columns, const Eigen::VectorXd& weight,
                                const Eigen::VectorXd& residual, Eigen::Index first,
                                Eigen::Index last) {
  NormalEquations result{Eigen::MatrixXd(columns, columns), Eigen::VectorXd(columns)};
  const int blocks = static_cast<int>(rows.cols()) / 8;
  for (int q = 0; q < blocks; ++q) {
    for (int p = 0; p <= q; ++p) {
      Vec8 sum[8] = {}, slope = {};
      for (Eigen::Index i = first; i < last; ++i) {
        const double* left = &rows(i, 8 * p);
        Vec8 right;
        std::memcpy(&right, &rows(i, 8 * q), sizeof right);
        if (p == q) slope += residual(i) * right;
        right *= weight(i);
        for (int k = 0; k < 8; ++k) sum[k] += left[k] * right;
      }
      for (int j = 0; j < 8 && 8 * q + j < columns; ++j) {
        for (int k = 0; k < 8 && 8 * p + k < columns; ++k)
          result.A(8 * p + k, 8 * q + j) = result.A(8 * q + j, 8 * p + k) = sum[k][j];
        if (p == q) result.b(8 * q + j) = slope[j];
      }
    }
  }
  return result;
}

/// A window's share, as the last evaluation left it.
class WindowCosts::Cost : public ceres::CostFunction {
 public:
  Cost(const WindowCosts& all, std::size_t window, int free, int initial)
      : all_(all), window_(window) {
    set_num_residuals(free + initial + 1);
    if (free > 0) mutable_parameter_block_sizes()->push_back(free);
    mutable_parameter_block_sizes()->push_back(initial);
  }

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const Compressed& window = all_.windows_[window_];
    if (!window.finite) return false;
    const int rows = num_residuals();
    Eigen::Map<Eigen::VectorXd> r(residuals, rows);
    if (!all_.has_derivatives_) {
      r.setZero();
      r(rows - 1) = window.size;
      return true;
    }
    r = window.factor.rightCols<1>();
    if (!jacobians) return true;
    int column = 0;
    for (std::size_t block = 0; block < parameter_block_sizes().size(); ++block) {
      const int count = parameter_block_sizes()[block];
      if (jacobians[block])
        Eigen::Map<Derivatives>(jacobians[block], rows, count) =
            window.factor.middleCols(column, count);
      column += count;
    }
    return true;
  }

 private:
  const WindowCosts& all_;
  std::size_t window_;
};

WindowCosts::WindowCosts(const SimulationError& problem, const Model& model, const Free& free,
                         const Robust& robust, int threads, std::vector<double>& scaled,
                         Initials& initial)
    : problem_(problem),
      model_(model),
      free_(free),
      robust_(robust),
      threads_(threads),
      scaled_(scaled),
      initial_(initial),
      windows_(problem.windows().size()) {}

void WindowCosts::addTo(ceres::Problem& solver) {
  for (std::size_t w = 0; w < windows_.size(); ++w) {
    std::vector<double*> blocks = {initial_[w].data()};
    if (!scaled_.empty()) blocks.insert(blocks.begin(), scaled_.data());
    solver.AddResidualBlock(
        new Cost(*this, w, static_cast<int>(scaled_.size()), problem_.initialSize()), nullptr,
        blocks);
  }
}

void WindowCosts::PrepareForEvaluation(bool derivatives, bool moved) {
  if (!moved && (has_derivatives_ || !derivatives)) return;
  const int free = static_cast<int>(free_.index.size()), columns = free + problem_.initialSize();
  problem_.residuals(
      model_, free_.coordinates(scaled_.data()), free_.index, initial_, derivatives, threads_,
      [&](const WindowResiduals& found) {
        Compressed& window = windows_[found.window];
        window.finite = found.finite;
        if (!found.finite) return;
        if (!derivatives) {
          double sum = 0;
          for (const double r : found.residuals) sum += robust_(r) * robust_(r);
          window.size = std::sqrt(sum);
          return;
        }
        const Eigen::Index rows = found.residuals.size();
        Eigen::VectorXd weight(rows), residual(rows);
        const double size = robust_.weigh(found.residuals, weight, residual);
        const NormalEquations normal =
            normalEquations(found.derivatives, columns, weight, residual, 0, rows);
        Eigen::VectorXd scale = Eigen::VectorXd::Ones(columns);
        for (int i = 0; i < free; ++i) scale(i) = free_.scale[i];
        Eigen::MatrixXd A(columns + 1, columns + 1);
        A.topLeftCorner(columns, columns) = scale.asDiagonal() * normal.A * scale.asDiagonal();
        A.col(columns).head(columns) = scale.cwiseProduct(normal.b);
        A.row(columns).head(columns) = A.col(columns).head(columns).transpose();
        A(columns, columns) = size;
        // Of what the derivatives do not tell apart rounding may leave less than nothing.
        const Eigen::LDLT<Eigen::MatrixXd> decomposed(A);
        const Eigen::MatrixXd upper = decomposed.matrixU();
        const Eigen::PermutationMatrix<Eigen::Dynamic> order(decomposed.transpositionsP());
        window.factor = decomposed.vectorD().cwiseMax(0).cwiseSqrt().asDiagonal() * upper * order;
      });
  has_derivatives_ = derivatives;
}

}  // namespace ground
