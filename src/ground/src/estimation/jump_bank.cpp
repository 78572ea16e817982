#include "ground/estimation/jump_bank.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace ground {
namespace {

constexpr int kMoving = ChangeFilter::kBias;  // states that a step moves; the later ones stay

}  // namespace

JumpBank::JumpBank(int states, double spacing, double memory)
    : states_(states), spacing_(spacing), memory_(memory) {}

void JumpBank::add(double time, const ChangeFilter::Step& step, double scale) {
  const Eigen::LLT<Matrix3<double>> covariance(scale * step.covariance);
  const Vector3<double> innovation = covariance.matrixL().solve(step.innovation);
  for (Start& start : starts_) {
    start.error.topRows<kMoving>() = (step.transition.topRows<kMoving>() * start.error).eval();
    const Matrix seen = step.output * start.error;
    const Matrix white = covariance.matrixL().solve(seen);
    start.information.noalias() += white.transpose() * white;
    start.score.noalias() += white.transpose() * innovation;
    start.error.noalias() -= step.gain * seen;
  }
  while (!starts_.empty() && time - starts_.front().time > memory_) starts_.pop_front();
  if (starts_.empty() || time - starts_.back().time > spacing_ - 1e-6)
    starts_.push_back(
        {time, Matrix::Identity(states_, states_), Matrix::Zero(states_, states_), Vector::Zero(states_)});
}

/// With information M and score c of z ~ N(0, 1):
/// log ratio = c' (1 + M)^-1 c / 2 - log det(1 + M) / 2.
JumpBank::Posterior JumpBank::posterior(const Start& start, const Hypothesis& hypothesis) {
  const Matrix& root = hypothesis.prior;
  const Matrix information = start.information(hypothesis.states, hypothesis.states);
  const Matrix precision = Matrix::Identity(root.cols(), root.cols()) + root.transpose() * information * root;
  const Vector score = root.transpose() * start.score(hypothesis.states);
  const Eigen::LLT<Matrix> factor(precision);
  Posterior found;
  found.mean = factor.solve(score);
  found.covariance = factor.solve(Matrix::Identity(root.cols(), root.cols()));
  const Matrix lower = factor.matrixL();
  found.log_ratio = 0.5 * score.dot(found.mean) - lower.diagonal().array().log().sum();
  return found;
}

JumpBank::Evidence JumpBank::test(const Hypothesis& hypothesis) const {
  Evidence found;
  double most = -std::numeric_limits<double>::infinity();
  std::vector<double> ratios;
  const Start* best = nullptr;
  Posterior posterior_there;
  for (const Start& start : starts_) {
    const Posterior one = posterior(start, hypothesis);
    ratios.push_back(one.log_ratio);
    if (!(one.log_ratio > most)) continue;
    most = one.log_ratio;
    best = &start;
    posterior_there = one;
  }
  if (!best) return found;
  double sum = 0;
  for (const double ratio : ratios) sum += std::exp(ratio - most);
  found.log_ratio = most + std::log(sum / static_cast<double>(ratios.size()));
  found.start = best->time;
  found.jump = hypothesis.prior * posterior_there.mean;
  found.covariance = hypothesis.prior * posterior_there.covariance * hypothesis.prior.transpose();
  const Matrix error = best->error(Eigen::all, hypothesis.states);
  found.now = error * found.jump;
  found.now_covariance = error * found.covariance * error.transpose();
  return found;
}

JumpBank::Matrix JumpBank::information(double start) const {
  const auto nearest = std::min_element(starts_.begin(), starts_.end(), [&](const Start& a, const Start& b) {
    return std::abs(a.time - start) < std::abs(b.time - start);
  });
  return nearest == starts_.end() ? Matrix() : nearest->information;
}

}  // namespace ground
