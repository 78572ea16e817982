#include "ground/identification/score.h"

#include <Eigen/QR>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <stdexcept>

#include "descent.h"
#include "parallel.h"
#include "whitening.h"

namespace ground {
namespace {

/// Calls work(window) for all windows over threads; throws what says that a window's simulation is
/// not finite when `work` returns false.
template <class Work>
void forWindows(const SimulationError& problem, int threads, const Work& work) {
  std::atomic<int> failed{-1};
  inParallel(problem.windows().size(), threads, [&](std::size_t w) {
    if (!work(static_cast<int>(w))) failed = static_cast<int>(w);
  });
  if (failed >= 0) throw std::runtime_error(notFinite(problem, failed));
}

/// Standard deviation of mostly normal values: Huber's M-estimate of scale.
double scaleOf(const std::vector<double>& values) {
  constexpr double kClip = 2.5, kExpected = 0.9657;  // mean of min(z^2, kClip^2), z normal
  std::vector<double> sizes(values.size());
  std::transform(values.begin(), values.end(), sizes.begin(), [](double x) { return std::abs(x); });
  std::nth_element(sizes.begin(), sizes.begin() + sizes.size() / 2, sizes.end());
  double scale = 1.4826 * sizes[sizes.size() / 2];
  for (int i = 0; i < 20 && scale > 0; ++i) {
    double sum = 0;
    for (const double x : sizes) sum += std::min(x * x / (scale * scale), kClip * kClip);
    scale *= std::sqrt(sum / (kExpected * static_cast<double>(sizes.size())));
  }
  return scale;
}

}  // namespace

Scores scores(const SimulationError& problem, const Model& model,
              const std::vector<std::string>& parameters, double width, double block, int threads,
              const std::vector<Eigen::VectorXd>& given) {
  if (!given.empty()) checkInitials(problem, given);
  const auto infos = model.parameters();
  const std::vector<double> coordinates = model.coordinates();
  std::vector<int> index;
  Scores result;
  for (const std::string& name : parameters) {
    index.push_back(model.index(name));
    const double typical = infos[index.back()].scale(model.body);
    const double scale = std::max(std::abs(coordinates[index.back()]), typical);
    result.scale.push_back(scale > 0 ? scale : 1.0);
  }
  const auto n = static_cast<Eigen::Index>(index.size());
  const Eigen::Index k = problem.initialSize();
  const Eigen::Map<const Eigen::VectorXd> scale(result.scale.data(), n);
  const Robust robust{width};
  const std::size_t count = problem.windows().size();
  Initials initial = given.empty() ? measuredInitials(problem) : given;
  std::vector<Eigen::MatrixXd> score(count), information(count);
  result.cost.resize(count);
  forWindows(problem, threads, [&](int w) {
    if (given.empty()) solveInitial(problem, model, coordinates, robust, w, initial[w]);
    const WindowResiduals found =
        problem.residuals(model, coordinates, index, w, initial[w], n > 0);
    if (!found.finite) return false;
    const Eigen::VectorXd& r = found.residuals;
    result.cost[w] = 0;
    for (const double x : r) result.cost[w] += 0.5 * robust(x) * robust(x);
    if (n == 0) return true;
    Eigen::MatrixXd J = found.derivatives.leftCols(n + k);
    J.leftCols(n) *= scale.asDiagonal();
    // Expected curvature (of normal residuals, but for the few beyond the width) weighs all alike.
    const auto state = J.rightCols(k).colPivHouseholderQr();
    const Eigen::MatrixXd rest = J.leftCols(n) - J.rightCols(k) * state.solve(J.leftCols(n));
    const Window& span = problem.windows()[w];
    const std::vector<double>& times = problem.runs()[span.run].times;
    const int samples = static_cast<int>(r.size()) / 3;
    const double duration = times[span.last] - times[span.first];
    const int blocks =
        std::min(samples, std::max(1, static_cast<int>(std::lround(duration / block))));
    score[w] = Eigen::MatrixXd::Zero(blocks, n);
    double curvature = 0;
    for (int b = 0; b < blocks; ++b)
      for (int i = 3 * (samples * b / blocks); i < 3 * (samples * (b + 1) / blocks); ++i) {
        score[w].row(b) -= robust.score(r(i)) * rest.row(i);
        curvature += robust.curvature(r(i), std::max(width, 1e-300));
      }
    information[w] = curvature / static_cast<double>(r.size()) * rest.transpose() * rest;
    return true;
  });
  result.initial = initial;
  if (n == 0) return result;
  Eigen::Index rows = 0;
  for (const auto& s : score) rows += s.rows();
  result.score.resize(rows, n);
  result.information = Eigen::MatrixXd::Zero(n, n);
  Eigen::Index row = 0;
  for (std::size_t w = 0; w < count; ++w) {
    result.score.middleRows(row, score[w].rows()) = score[w];
    row += score[w].rows();
    result.window.insert(result.window.end(), score[w].rows(), static_cast<int>(w));
    result.information += information[w];
  }
  return result;
}

std::vector<NoiseLevels> likeliestDisturbance(const SimulationError& problem, const Model& model,
                                              double width, int threads) {
  const std::vector<double> coordinates = model.coordinates();
  Initials initial = measuredInitials(problem);
  forWindows(problem, threads, [&](int w) {
    solveInitial(problem, model, coordinates, {width}, w, initial[w]);
    return problem.residuals(model, coordinates, {}, w, initial[w], false).finite;
  });
  const WindowSimulation simulation = problem.simulateFrom(model, initial);
  std::vector<NoiseLevels> result;
  for (const RunData& run : problem.runs()) result.push_back({run.noise, run.disturbance, {0, 0}});
  inParallel(2 * result.size(), threads, [&](std::size_t task) {
    const auto run = static_cast<int>(task / 2);
    const RunData& data = problem.runs()[run];
    // x and y together, or psi
    const std::vector<int> channels = task % 2 == 0 ? std::vector<int>{0, 1} : std::vector<int>{2};
    const double noise = data.noise(channels[0]);
    const auto inRun = [run](const Window& w) { return w.run == run; };
    if (std::none_of(problem.windows().begin(), problem.windows().end(), inRun)) return;
    double scale = 1;
    const auto unlikely = [&](double ratio) {  // minus the log likelihood by log of the disturbance
      Vector3<double> disturbance = Vector3<double>::Zero(), unit = Vector3<double>::Ones();
      if (std::isfinite(ratio)) disturbance.setConstant(std::exp(ratio));
      std::vector<double> z;
      double sum = 0;
      for (std::size_t w = 0; w < problem.windows().size(); ++w) {
        const Window& span = problem.windows()[w];
        if (span.run != run) continue;
        Eigen::MatrixX3d error =
            simulation.eta[w] - data.poses.middleRows(span.first, simulation.eta[w].rows());
        const Whitening<double> whitening =
            driftingErrors(data.times, span.first, span.last, unit, disturbance);
        Innovations<double, double> innovations(whitening);
        for (int i = 0; i < error.rows(); ++i)
          for (const int c : channels) {
            innovations.apply(i, c, error(i, c));
            z.push_back(error(i, c));
            sum -= std::log(whitening.over_deviation[i][c]);
          }
      }
      scale = scaleOf(z);
      return sum + static_cast<double>(z.size()) * std::log(std::max(scale, 1e-300));
    };
    // The disturbance in units of the noise, per second^1.5. What lasts is no white acceleration
    // but missing physics: whitened away, the fit would only see how the next pose differs from the
    // last.
    constexpr double kQuickest = 6;  // bandwidth at which poses are followed, at most [rad/s]
    const double interval =
        (data.times.back() - data.times.front()) / static_cast<double>(data.times.size() - 1);
    const double kLeast = -4, most = std::log(kQuickest * kQuickest * std::sqrt(interval));
    const double undisturbed = unlikely(-kInfinity);
    double best = -kInfinity, least = undisturbed, step = (most - kLeast) / 8;
    for (int i = 0; i <= 8; ++i) {
      const double ratio = kLeast + i * step;
      const double value = unlikely(ratio);
      if (value < least) {
        least = value;
        best = ratio;
      }
    }
    if (std::isfinite(best)) {
      const auto found = boost::math::tools::brent_find_minima(unlikely, best - step,
                                                               std::min(best + step, most), 8);
      if (found.second < least) best = found.first;
    }
    result[run].gain[task % 2] = 2 * (undisturbed - unlikely(best));
    for (const int c : channels) {
      result[run].noise(c) = scale > 0 ? scale : noise;
      result[run].disturbance(c) = std::isfinite(best) ? scale * std::exp(best) : 0;
    }
  });
  return result;
}

}  // namespace ground
