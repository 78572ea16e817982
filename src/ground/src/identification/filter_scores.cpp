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
        x_(!run.inertial.empty(), 2 * n_),
        seen_(Eigen::Matrix3Xd::Zero(3, 2 * n_)),
        place_(run.inertial.place) {
    const std::vector<double> base = model.coordinates();
    for (int first = 0; first < n_; first += kDerivatives) {
      std::vector<Jet> coordinates(base.begin(), base.end());
      for (int j = first; j < std::min(n_, first + kDerivatives); ++j)
        coordinates[free.index[j]].v[j - first] = free.scale[j];
      dynamics_.emplace_back(model, coordinates, run.payload);
      mobility_.push_back(dynamics_.back().mass().inverse());
    }
    for (const auto& d : dynamics_)
      simulations_.emplace_back(d, run.inputs, RigidState<Jet>(), run.times[0], longestStep(d, run.noise));
  }

  void forget(double until) {
    forgetDeviation(x_.state);
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
    white_ = correctDeviation(s, seen_, x_);
  }

  /// By inertial means over the step that begins at sample `from`.
  void correct(const InertialSample& s, const FilterSample& from) {
    for (std::size_t g = 0; g < dynamics_.size(); ++g) {
      if (!dynamics_[g].distorts()) continue;
      const Vector3<Jet> mean = inertialBetween(dynamics_[g].measure(cast<Jet>(from.filtered)),
                                                dynamics_[g].measure(cast<Jet>(s.to)), from.dt, place_);
      for (int a = 0; a < 3; ++a)
        eachOf(g, [&](int column, int j) { seen_(a, column) = seen_(a, n_ + column) = mean(a).v[j]; });
    }
    white_ = correctDeviation(s, seen_, x_);
  }

  /// Derivatives with the same wrenches, (kFilterStates, parameters).
  Eigen::MatrixXd underWrenches() const { return x_.state.topLeftCorner(kFilterStates, n_); }

  void move(const FilterSample& s, const Random::Step& step, double until) {
    x_.move(s, step);
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
      x_.state.col(n_ + column).head<6>() += moved;
      x_.state.col(column).head<6>() += moved + s.held * push;
    });
  }

  int n_;
  std::vector<Dynamics<Jet>> dynamics_;  ///< with derivatives by eight parameters each
  std::vector<Matrix3<Jet>> mobility_;
  std::vector<Simulation<Jet>> simulations_;
  Deviations x_;
  Eigen::Matrix3Xd seen_, white_;
  Vector2<double> place_;
};

/// Derivatives at a sample by a level: of the whitened innovation (3), of its covariance (the lower
/// triangle, by rows).
using LevelRow = Eigen::Matrix<double, 9, 1>;

/// Finite difference of the filter by one level.
class LevelDeviation {
 public:
  LevelDeviation(const DisturbanceLevels& levels, const RunData& run, int level)
      : unchanged_(levels, run.noise),
        random_(changed(levels, level), run.noise),
        covariance_(!run.inertial.empty()) {}

  void start(bool first) {
    covariance_.start(random_, first);
    x_.head<kConstant>().setZero();
    if (!first) processes_.setZero();
  }

  /// Returns the derivatives; those of capped poses and of a stretch's first one are not used.
  LevelRow correct(const FilterSample& s) {
    return correct(s, seenPose(s, random_, covariance_), s.innovation - s.seen * x_.head<3>());
  }

  /// By inertial means of this noise over the step that begins at sample `from`.
  LevelRow correct(const InertialSample& s, const FilterSample& from, const Eigen::RowVector3d& noise) {
    return correct(s, seenInertial(s, from, random_.over(from.dt), noise, before_, covariance_),
                   s.innovation - s.by_to * x_.head<6>() - s.by_from * x_before_ - s.by_errors * errors_);
  }

  void move(const FilterSample& s) {
    if (covariance_.sensed) {
      before_ = covariance_;
      x_before_ = x_.head<6>();
    }
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

  /// Corrects by an innovation; returns its derivatives.
  LevelRow correct(const Correction& s, const Seen& seen, const Vector3<double>& innovation) {
    // A pose whose noise was increased keeps the gain of the unchanged levels.
    Gain gain = s.gain;
    if (!s.capped()) gain = seen.PH * seen.S.inverse();
    const StateVector without = s.gain * s.innovation;
    x_ += gain * innovation - without;
    processes_ += without.segment<kProcesses>(kSlow);
    // The gain of a capped pose is not that of this covariance: the product is not symmetric then.
    covariance_.P -= gain * seen.PH.transpose();
    covariance_.P = StateMatrix(covariance_.P.selfadjointView<Eigen::Upper>());
    if (covariance_.sensed) correctErrors(s, seen, gain, innovation);
    LevelRow row;
    row.head<3>() = s.whitening * (innovation - s.innovation);
    const Matrix3<double> change =
        s.whitening * seen.S * s.whitening.transpose() - Matrix3<double>::Identity();
    for (int a = 0, at = 3; a < 3; ++a)
      for (int b = 0; b <= a; ++b) row(at++) = change(a, b);
    return row / kChange;
  }

  void correctErrors(const Correction& s, const Seen& seen, const Gain& gain,
                     const Vector3<double>& innovation) {
    Eigen::Matrix<double, kSensorErrors, 3> error_gain = s.sensor_gain;
    if (!s.capped()) error_gain = seen.errors * seen.S.inverse();
    errors_ += error_gain * innovation - s.sensor_gain * s.innovation;
    covariance_.with_errors -= gain * seen.errors.transpose();
    const auto errors = (covariance_.errors - error_gain * seen.errors.transpose()).eval();
    covariance_.errors = 0.5 * (errors + errors.transpose());
  }

  static DisturbanceLevels changed(const DisturbanceLevels& levels, int level) {
    auto values = levels.values();
    values[static_cast<std::size_t>(level)] *= std::exp(kChange);
    return DisturbanceLevels::of(values);
  }

  Random unchanged_, random_;
  Covariance covariance_;
  StateVector x_ = StateVector::Zero();
  SensorVector errors_ = SensorVector::Zero();  ///< deviation of the sensors' errors
  // Before the last step, of runs with inertial samples:
  Covariance before_;
  Eigen::Matrix<double, 6, 1> x_before_;
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
    const auto add = [&](const Correction& correction) {
      const auto by_wrench = sensitivity.white().leftCols(n);
      const auto by_acceleration = sensitivity.white().rightCols(n);
      const double weight = correction.weight();
      sums.score.row(blockOf(k, blocks)) -= weight * correction.whitened().transpose() * by_wrench;
      sums.information += weight * by_wrench.transpose() * by_wrench;
      sums.by_acceleration += weight * by_acceleration.transpose() * by_acceleration;
    };
    if (const InertialSample* inertial = inertialAt(k)) {
      sensitivity.correct(*inertial, samples_[k - 1]);
      add(*inertial);
    }
    sensitivity.correct(s);
    if (!s.starts) add(s);
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next)
      (*kept)[next].sensitivity = sensitivity.underWrenches();
    if (s.dt > 0) sensitivity.move(s, random.over(s.dt), run_.times[k + 1]);
  }
  return sums;
}

RunLevelScores DisturbanceFilter::levelScores(const DisturbanceLevels& levels,
                                              const std::set<int>& held) const {
  const Eigen::Index parts = inertial_.empty() ? 1 : 2;  // of a sample: pose, inertial means
  const auto count = static_cast<Eigen::Index>(samples_.size());
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(9 * parts * count, kLevels);
  for (int level = 0; level < kLevels; ++level) {
    if (held.count(level) > 0) continue;
    LevelDeviation deviation(levels, run_, level);
    // Capped corrections do not count: their density hardly depends on the levels, so that levels of
    // ever more capped ones would seem ever likelier.
    const auto keep = [&](const Correction& s, Eigen::Index part, const LevelRow& row) {
      if (!s.capped()) rows.block<9, 1>(9 * part, level) = row;
    };
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const FilterSample& s = samples_[k];
      const auto at = static_cast<Eigen::Index>(k);
      if (s.starts) deviation.start(k == 0);
      if (const InertialSample* inertial = inertialAt(k))
        keep(*inertial, parts * at + 1, deviation.correct(*inertial, samples_[k - 1], steps_.noise.row(at)));
      const LevelRow row = deviation.correct(s);
      if (!s.starts) keep(s, parts * at, row);
      if (s.dt > 0) deviation.move(s);
    }
  }
  RunLevelScores sums{Eigen::VectorXd::Zero(kLevels), Eigen::MatrixXd::Zero(kLevels, kLevels)};
  const LevelRow weight = levelWeight();
  const auto add = [&](const Correction& s, Eigen::Index at) {
    const auto part = rows.middleRows<9>(9 * at);
    sums.score += part.transpose() * levelPull(s.whitened());
    sums.information += part.transpose() * (weight.asDiagonal() * part);
  };
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const Eigen::Index at = parts * static_cast<Eigen::Index>(k);
    if (const InertialSample* inertial = inertialAt(k)) add(*inertial, at + 1);
    add(samples_[k], at);
  }
  return sums;
}

}  // namespace ground::detail
