// Derivatives of the disturbance filter's log-likelihood, by parameters and by levels.
#include <Eigen/LU>
#include <cmath>

#include "disturbance_filter.h"
#include "filter_steps.h"

namespace ground::detail {
namespace {

/// Derivatives of the filter's state by the n free parameters, a column each: first with the same
/// wrenches of the disturbance, then (columns n to 2n - 1) with the same accelerations.
class Sensitivity {
 public:
  Sensitivity(const Model& model, const Free& free, const RunData& run)
      : n_(static_cast<int>(free.index.size())),
        state_(Eigen::MatrixXd::Zero(kN, 2 * n_)),
        seen_(Eigen::Matrix3Xd::Zero(3, 2 * n_)) {
    const std::vector<double> base = model.coordinates();
    for (int first = 0; first < n_; first += kDerivatives) {
      std::vector<Jet> coordinates(base.begin(), base.end());
      for (int j = first; j < std::min(n_, first + kDerivatives); ++j)
        coordinates[free.index[j]].v[j - first] = free.scale[j];
      dynamics_.emplace_back(model, coordinates);
      mobility_.push_back(dynamics_.back().mass().inverse());
    }
    for (const auto& d : dynamics_)
      simulations_.emplace_back(d, run.inputs, RigidState<Jet>(), run.times[0], longestStep(d, run.noise));
  }

  void forget(double until) {
    forgetDeviation(state_);
    for (Simulation<Jet>& simulation : simulations_) passGap(simulation, until);
  }

  /// Derivatives of the whitened innovation, with the same wrenches, then the same accelerations.
  const Eigen::Matrix3Xd& white() const { return white_; }

  void correct(const FilterSample& s) {
    const RigidState<Jet> here = cast<Jet>(s.predicted);
    for (std::size_t g = 0; g < dynamics_.size(); ++g) {
      if (!dynamics_[g].distorts()) continue;
      const Measurement<Jet> seen = dynamics_[g].measure(here);
      for (int a = 0; a < 3; ++a)
        eachOf(g, [&](int column, int j) { seen_(a, column) = seen_(a, n_ + column) = seen.eta(a).v[j]; });
    }
    white_ = correctDeviation(s, seen_, state_);
  }

  /// Derivatives with the same wrenches, (kFilterStates, parameters).
  Eigen::MatrixXd underWrenches() const { return state_.topLeftCorner(kFilterStates, n_); }

  void move(const FilterSample& s, const Random::Step& step, double until) {
    moveDeviation(s, step, state_);
    const RigidState<Jet> here = cast<Jet>(s.filtered);
    for (std::size_t g = 0; g < dynamics_.size(); ++g) {
      simulations_[g].state() = here;
      simulations_[g].advance(until);
      addMotion(s, simulations_[g].state(), mobility_[g] * s.push.cast<Jet>(), g);
    }
  }

 private:
  /// Calls act(column, j) for each parameter of group g, which is variable j of its Jets.
  template <class Act>
  void eachOf(std::size_t g, const Act& act) const {
    const int first = static_cast<int>(g) * kDerivatives;
    for (int j = 0; j < std::min(kDerivatives, n_ - first); ++j) act(first + j, j);
  }

  void addMotion(const FilterSample& s, const RigidState<Jet>& to, const Vector3<Jet>& pushed,
                 std::size_t g) {
    eachOf(g, [&](int column, int j) {
      Eigen::Matrix<double, 6, 1> moved;
      for (int i = 0; i < 3; ++i) {
        moved(i) = to.eta(i).v[j];
        moved(3 + i) = to.nu(i).v[j];
      }
      const Vector3<double> push(pushed(0).v[j], pushed(1).v[j], pushed(2).v[j]);
      state_.col(n_ + column).head<6>() += moved;
      state_.col(column).head<6>() += moved + s.held * push;
    });
  }

  int n_;
  std::vector<Dynamics<Jet>> dynamics_;  ///< with derivatives by eight parameters each
  std::vector<Matrix3<Jet>> mobility_;
  std::vector<Simulation<Jet>> simulations_;
  Eigen::MatrixXd state_;
  Eigen::Matrix3Xd seen_, white_;
};

/// Derivatives at a sample by a level: of the whitened innovation (3), of its covariance (the lower
/// triangle, by rows).
using LevelRow = Eigen::Matrix<double, 9, 1>;

/// Finite difference of the filter by one level.
class LevelDeviation {
 public:
  LevelDeviation(const DisturbanceLevels& levels, const Vector3<double>& noise, int level)
      : unchanged_(levels, noise), random_(changed(levels, level), noise) {}

  void start(bool first) {
    covariance_.start(random_, first);
    x_.head<kConstant>().setZero();
    if (!first) processes_.setZero();
  }

  /// Returns the derivatives; those of capped poses and of a stretch's first one are not used.
  LevelRow correct(const FilterSample& s) {
    const Seen seen(s, random_, covariance_.P);
    const Vector3<double> innovation = s.innovation - s.seen * x_.head<3>();
    // A pose whose noise was increased keeps the gain of the unchanged levels.
    Gain gain = s.gain;
    if (!s.capped()) gain = seen.PH * seen.S.inverse();
    const StateVector without = s.gain * s.innovation;
    x_ += gain * innovation - without;
    processes_ += without.segment<kProcesses>(kSlow);
    // The gain of a capped pose is not that of this covariance: the product is not symmetric then.
    covariance_.P -= gain * seen.PH.transpose();
    covariance_.P = StateMatrix(covariance_.P.selfadjointView<Eigen::Upper>());
    LevelRow row;
    row.head<3>() = s.whitening * (innovation - s.innovation);
    const Matrix3<double> change =
        s.whitening * seen.S * s.whitening.transpose() - Matrix3<double>::Identity();
    for (int a = 0, at = 3; a < 3; ++a)
      for (int b = 0; b <= a; ++b) row(at++) = change(a, b);
    return row / kChange;
  }

  void move(const FilterSample& s) {
    const Random::Step step = random_.over(s.dt), unchanged = unchanged_.over(s.dt);
    covariance_.move(s, step);
    moveDeviation(s, step, x_);
    // A different correlation time changes the decay of the filtered wrench.
    x_.head<6>() += responseToProcesses(s) * ((step.mean - unchanged.mean) * processes_.array()).matrix();
    x_.segment<kProcesses>(kSlow).array() += (step.left - unchanged.left) * processes_.array();
    processes_.array() *= unchanged.left;
  }

 private:
  static constexpr double kChange = 1e-3;  ///< of the level's logarithm

  static DisturbanceLevels changed(const DisturbanceLevels& levels, int level) {
    auto values = levels.values();
    values[static_cast<std::size_t>(level)] *= std::exp(kChange);
    return DisturbanceLevels::of(values);
  }

  Random unchanged_, random_;
  Covariance covariance_;
  StateVector x_ = StateVector::Zero();
  /// The filtered processes with the unchanged levels.
  Eigen::Matrix<double, kProcesses, 1> processes_ = Eigen::Matrix<double, kProcesses, 1>::Zero();
};

/// Derivative of the log-density at a sample by its LevelRow, and the information of this row. The
/// elements off the diagonal occur twice in the covariance.
LevelRow levelPull(const Vector3<double>& e) {
  LevelRow pull;
  pull << -e, 0.5 * (e(0) * e(0) - 1), e(1) * e(0), 0.5 * (e(1) * e(1) - 1), e(2) * e(0), e(2) * e(1),
      0.5 * (e(2) * e(2) - 1);
  return pull;
}
LevelRow levelWeight() {
  LevelRow weight;
  weight << 1, 1, 1, 0.5, 1, 0.5, 1, 1, 0.5;
  return weight;
}

}  // namespace

RunScores DisturbanceFilter::scores(const Model& model, const Free& free, double block,
                                    std::vector<FilterBelief>* kept) const {
  const int blocks = blockCount(block);
  const auto n = static_cast<Eigen::Index>(free.index.size());
  Sensitivity sensitivity(model, free, run_);
  RunScores sums{Eigen::MatrixXd::Zero(blocks, n), Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, n)};
  const Random random(levels_, run_.noise);
  std::size_t next = 0;  // belief to fill in
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    if (s.starts && k > 0) sensitivity.forget(run_.times[k]);
    sensitivity.correct(s);
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next)
      (*kept)[next].sensitivity = sensitivity.underWrenches();
    if (!s.starts) {
      const auto by_wrench = sensitivity.white().leftCols(n);
      const auto by_acceleration = sensitivity.white().rightCols(n);
      const double weight = s.weight();
      sums.score.row(blockOf(k, blocks)) -= weight * s.whitened().transpose() * by_wrench;
      sums.information += weight * by_wrench.transpose() * by_wrench;
      sums.by_acceleration += weight * by_acceleration.transpose() * by_acceleration;
    }
    if (s.dt > 0) sensitivity.move(s, random.over(s.dt), run_.times[k + 1]);
  }
  return sums;
}

RunLevelScores DisturbanceFilter::levelScores(const DisturbanceLevels& levels,
                                              const std::set<int>& held) const {
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(9 * static_cast<Eigen::Index>(samples_.size()), kLevels);
  for (int level = 0; level < kLevels; ++level) {
    if (held.count(level) > 0) continue;
    LevelDeviation deviation(levels, run_.noise, level);
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const FilterSample& s = samples_[k];
      if (s.starts) deviation.start(k == 0);
      const LevelRow row = deviation.correct(s);
      // Capped poses do not count: their density hardly depends on the levels, so that levels of
      // ever more capped poses would seem ever likelier.
      if (!s.starts && !s.capped()) rows.block<9, 1>(9 * static_cast<Eigen::Index>(k), level) = row;
      if (s.dt > 0) deviation.move(s);
    }
  }
  RunLevelScores sums{Eigen::VectorXd::Zero(kLevels), Eigen::MatrixXd::Zero(kLevels, kLevels)};
  const LevelRow weight = levelWeight();
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const auto part = rows.middleRows<9>(9 * static_cast<Eigen::Index>(k));
    sums.score += part.transpose() * levelPull(whitened(k));
    sums.information += part.transpose() * (weight.asDiagonal() * part);
  }
  return sums;
}

}  // namespace ground::detail
