#include "window_costs.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <cstring>

#include "parallel.h"

namespace ground {

Eigen::MatrixXd normalEquations(const WindowResiduals& window, int columns, const Robust& robust) {
  const Eigen::Index rows = window.residuals.size();
  const int blocks = static_cast<int>(window.derivatives.cols()) / 8;
  const auto row = [&](Eigen::Index i, int block) {
    Vec8 part;
    std::memcpy(&part, &window.derivatives(i, 8 * block), sizeof part);
    return part;
  };
  Eigen::VectorXd weight(rows), residual(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const double slope = robust.derivative(window.residuals(i));
    residual(i) = robust(window.residuals(i));
    weight(i) = slope * slope;
    residual(i) *= slope;  // with J's factor on its side as well
  }
  Eigen::MatrixXd A(columns + 1, columns + 1);
  for (int p = 0; p < blocks; ++p) {
    for (int q = p; q < blocks; ++q) {
      Vec8 sum[8] = {};
      for (Eigen::Index i = 0; i < rows; ++i) {
        const Vec8 left = weight(i) * row(i, p), right = row(i, q);
        for (int k = 0; k < 8; ++k) sum[k] += left[k] * right;
      }
      for (int k = 0; k < 8; ++k)
        for (int j = 0; j < 8; ++j) {
          if (8 * p + k >= columns || 8 * q + j >= columns) continue;
          A(8 * p + k, 8 * q + j) = A(8 * q + j, 8 * p + k) = sum[k][j];
        }
    }
    Vec8 slope = {};
    for (Eigen::Index i = 0; i < rows; ++i) slope += residual(i) * row(i, p);
    for (int k = 0; k < 8 && 8 * p + k < columns; ++k)
      A(8 * p + k, columns) = A(columns, 8 * p + k) = slope[k];
  }
  double size = 0;
  for (Eigen::Index i = 0; i < rows; ++i) {
    const double r = robust(window.residuals(i));
    size += r * r;
  }
  A(columns, columns) = size;
  return A;
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
          for (const double r : found.residuals) sum += std::pow(robust_(r), 2);
          window.size = std::sqrt(sum);
          return;
        }
        Eigen::MatrixXd A = normalEquations(found, columns, robust_);
        for (int i = 0; i < free; ++i) {
          A.row(i) *= free_.scale[i];
          A.col(i) *= free_.scale[i];
        }
        // Of what the derivatives do not tell apart rounding may leave less than nothing.
        const Eigen::LDLT<Eigen::MatrixXd> decomposed(A);
        const Eigen::MatrixXd upper = decomposed.matrixU();
        const Eigen::PermutationMatrix<Eigen::Dynamic> order(decomposed.transpositionsP());
        window.factor =
            decomposed.vectorD().cwiseMax(0).cwiseSqrt().asDiagonal() * upper * order;
      });
  has_derivatives_ = derivatives;
}

}  // namespace ground
