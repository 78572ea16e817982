#include "disturbance_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "filter_steps.h"

namespace ground::detail {
namespace {

/// The state of the filter during a run.
class Pass {
 public:
  Pass(const Model& model, const RunData& run, const Eigen::MatrixX3d& poses, const DisturbanceLevels& levels)
      : run_(run),
        poses_(poses),
        dynamics_(model, coordinatesWithThrust(model), run.payload),
        random_(levels, run.noise),
        simulation_(dynamics_, run.inputs, {}, run.times[0], longestStep(dynamics_, run.noise)),
        covariance_(!run.inertial.empty()) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) mobility_(i, j) = dynamics_.mass()(i, j).a;
    mobility_ = mobility_.inverse().eval();
  }

  /// Begins a stretch at sample k, with measured pose and velocity.
  void start(std::size_t k) {
    if (k > 0) passGap(simulation_, run_.times[k]);
    const auto row = static_cast<Eigen::Index>(k);
    at_ = stateSeenAs(dynamics_, {poses_.row(row).transpose(), run_.nu.row(row).transpose()});
    processes_.setZero();
    covariance_.start(random_, k == 0);
  }

  /// Kalman correction by the pose of sample k; fills in its FilterSample.
  void correct(std::size_t k, double cap, FilterSample& s) {
    s.predicted = at_;
    compare(k, s);
    update(seenPose(s, random_, covariance_), cap, s);
    if (s.starts) s.log_density = 0;
    s.filtered = at_;
  }

  /// Kalman correction by the inertial means over the step from sample s to k.
  void correct(std::size_t k, const FilterSample& s, const InertialSteps& steps, double cap,
               InertialSample& i) {
    i.used = steps.has(k);
    if (!i.used) return;
    const auto row = static_cast<Eigen::Index>(k);
    i.to = at_;
    compare(s, steps.mean.row(row).transpose(), i);
    const Seen seen =
        seenInertial(i, s, random_.over(s.dt), steps.noise.row(row), before_, covariance_, &i.with_before);
    i.with = seen.PH;
    update(seen, cap, i);
  }

  void keep(FilterBelief& belief) const {
    belief.mean << at_.eta, at_.nu, processes_, constant_;
    belief.covariance = covariance_.P.topLeftCorner<kFilterStates, kFilterStates>();
  }

  /// Kalman prediction from sample k to the next, s.dt later.
  void move(std::size_t k, FilterSample& s) {
    if (covariance_.sensed) before_ = covariance_;
    const double until = run_.times[k + 1];
    simulation_.restart(seeded());
    const Vector3<double> at_start = covariance_.sensed ? felt() : Vector3<double>::Zero();
    simulation_.advance(until);
    if (covariance_.sensed) felt_rate_ = (felt() - at_start) / s.dt;
    const RigidState<Jet>& to = simulation_.state();
    linearise(to, s);
    const Random::Step step = random_.over(s.dt);
    const Eigen::Matrix<double, kProcesses, 1> mean = (step.mean * processes_.array()).matrix();
    s.push = mean.head<3>() + constant_.head<3>();
    pushInRoom(mean.tail<2>(), s);
    if (run_.wrench.rows() > 0) s.push += run_.wrench.row(static_cast<Eigen::Index>(k)).transpose();
    covariance_.move(s, step);
    const Eigen::Matrix<double, 6, 1> change = s.response * s.push + s.by_thrust * constant_(3);
    for (int i = 0; i < 3; ++i) {
      at_.eta(i) = to.eta(i).a + change(i);
      at_.nu(i) = to.nu(i).a + change(3 + i);
    }
    processes_.array() *= step.left;
  }

  bool finite() const { return std::isfinite(at_.eta.sum() + at_.nu.sum()); }
  /// The Ornstein-Uhlenbeck wrench and force, body.
  Vector3<double> wrench() const {
    Vector3<double> sum = processes_.head<3>();
    sum.head<2>() += worldToBody<double>(at_.eta.z(), processes_.tail<2>());
    return sum;
  }
  const Eigen::Vector4d& constants() const { return constant_; }
  Eigen::Vector4d constantsSigma() const {
    return covariance_.P.diagonal().segment<kConstants>(kConstant).cwiseMax(0).cwiseSqrt();
  }

 private:
  static constexpr int kByThrust = 6;  ///< index of the derivative by thrust in a Jet

  static std::vector<Jet> coordinatesWithThrust(const Model& model) {
    std::vector<Jet> coordinates;
    for (const double value : model.coordinates()) coordinates.emplace_back(value);
    coordinates[static_cast<std::size_t>(model.index("k"))].v[kByThrust] = model.body.k;
    return coordinates;
  }

  /// The state as variables 0 to 5 of a Jet.
  RigidState<Jet> seeded() const { return seeded(at_); }
  static RigidState<Jet> seeded(const RigidState<double>& at) {
    RigidState<Jet> state;
    for (int i = 0; i < 3; ++i) {
      state.eta(i) = Jet(at.eta(i), i);
      state.nu(i) = Jet(at.nu(i), 3 + i);
    }
    return state;
  }

  /// Kalman correction of the state by an innovation.
  void update(const Seen& seen, double cap, Correction& s) {
    weigh(seen.S, cap, s);
    const Gain white = seen.PH * s.whitening.transpose();
    s.gain = white * s.whitening;
    const StateVector change = s.gain * s.innovation;
    at_.eta += change.head<3>();
    at_.nu += change.segment<3>(3);
    processes_ += change.segment<kProcesses>(kSlow);
    constant_ += change.segment<kConstants>(kConstant);
    covariance_.P -= white * white.transpose();
    if (!covariance_.sensed) return;
    const Eigen::Matrix<double, kSensorErrors, 3> white_errors = seen.errors * s.whitening.transpose();
    s.sensor_gain = white_errors * s.whitening;
    errors_ += s.sensor_gain * s.innovation;
    covariance_.with_errors -= white * white_errors.transpose();
    covariance_.errors -= white_errors * white_errors.transpose();
  }

  /// The innovation of inertial means over the step that begins at sample s, and its derivatives.
  void compare(const FilterSample& s, const Vector3<double>& mean, InertialSample& i) const {
    const RigidState<Jet> from = seeded(s.filtered), to = seeded(i.to);
    const Vector3<Jet> by_from = between(from, cast<Jet>(i.to), s.dt),
                       by_to = between(cast<Jet>(s.filtered), to, s.dt);
    const Vector3<double> expected(by_to(0).a, by_to(1).a, by_to(2).a);
    i.by_errors = byErrors(expected, felt_rate_);
    i.innovation = mean - expected - i.by_errors * errors_;
    for (int a = 0; a < 3; ++a) {
      i.by_from.row(a) = by_from(a).v.head<6>();
      i.by_to.row(a) = by_to(a).v.head<6>();
    }
  }
  /// Yaw rate and specific force by the model at the end of the simulation.
  Vector3<double> felt() const {
    const Vector3<Jet>& nu = simulation_.state().nu;
    const Vector3<Jet> rate = simulation_.derivative().nu;
    return {nu(2).a, rate(0).a - nu(1).a * nu(2).a, rate(1).a + nu(0).a * nu(2).a};
  }
  Vector3<Jet> between(const RigidState<Jet>& from, const RigidState<Jet>& to, double dt) const {
    return inertialBetween(dynamics_.measure(from), dynamics_.measure(to), dt, run_.inertial.place);
  }

  void compare(std::size_t k, FilterSample& s) const {
    const Measurement<Jet> seen = dynamics_.measure(seeded());
    for (int a = 0; a < 3; ++a) {
      s.innovation(a) = poses_(static_cast<Eigen::Index>(k), a) - seen.eta(a).a;
      s.seen.row(a) = seen.eta(a).v.head<3>();
    }
    s.innovation(2) = wrapAngle(s.innovation(2));
  }

  /// Increases the noise of an innovation beyond the Mahalanobis limit `cap` so that it equals the
  /// limit; sets the whitening and the log-density.
  static void weigh(const Matrix3<double>& S, double cap, Correction& s) {
    const Eigen::LLT<Matrix3<double>> root(S);
    s.whitening = root.matrixL().solve(Matrix3<double>::Identity());
    const double distance = s.whitened().squaredNorm();
    s.inflation = distance > cap ? distance / cap : 1;
    s.whitening /= std::sqrt(s.inflation);
    const double log_root = std::log(s.whitening.diagonal().prod());
    s.log_density = log_root - 0.5 * distance / s.inflation;
  }

  void linearise(const RigidState<Jet>& to, FilterSample& s) const {
    for (int i = 0; i < 3; ++i) {
      s.motion.row(i) = to.eta(i).v.head<6>();
      s.motion.row(3 + i) = to.nu(i).v.head<6>();
      s.by_thrust(i) = to.eta(i).v[kByThrust];
      s.by_thrust(3 + i) = to.nu(i).v[kByThrust];
    }
    // mean of the derivatives by velocity at the step's start and end
    s.held = 0.5 * s.dt * s.motion.rightCols<3>();
    s.held.bottomRows<3>().diagonal().array() += 0.5 * s.dt;
    s.response = s.held * mobility_;
  }

  /// Adds a force in the room to the wrench that acts, by the heading in the middle of the step, and
  /// the derivative by this heading to that of the motion.
  void pushInRoom(const Vector2<double>& force, FilterSample& s) const {
    s.middle = Rotation<double>(at_.eta.z() + 0.5 * s.dt * at_.nu.z());
    const Vector2<double> body = s.middle.toBody(force);
    s.push.head<2>() += body;
    const Eigen::Matrix<double, 6, 1> turned = s.response.col(0) * body.y() - s.response.col(1) * body.x();
    s.motion.col(2) += turned;
    s.motion.col(5) += 0.5 * s.dt * turned;
  }

  const RunData& run_;
  const Eigen::MatrixX3d& poses_;
  Dynamics<Jet> dynamics_;
  Matrix3<double> mobility_;
  Random random_;
  Simulation<Jet> simulation_;
  RigidState<double> at_;
  /// The Ornstein-Uhlenbeck processes: the wrench (body), the force in the room.
  Eigen::Matrix<double, kProcesses, 1> processes_ = Eigen::Matrix<double, kProcesses, 1>::Zero();
  Eigen::Vector4d constant_ = Eigen::Vector4d::Zero();
  Covariance covariance_;
  Covariance before_;                           ///< before the last step, if the run has inertial samples
  SensorVector errors_ = SensorVector::Zero();  ///< of its sensors
  Vector3<double> felt_rate_ = Vector3<double>::Zero();  ///< mean derivative of felt() over that step
};

}  // namespace

DisturbanceFilter::DisturbanceFilter(const RunData& run)
    : run_(run), poses_(run.poses.rows() == 0 ? run.eta : run.poses), steps_(run) {
  checkRun(run);
  const std::size_t count = run.times.size();
  starts_.assign(count, false);
  starts_[0] = true;
  for (std::size_t k = 1; k < count; ++k) starts_[k] = run.times[k] - run.times[k - 1] > run.scales.max_gap;
  samples_.resize(count);
  if (steps_.mean.rows() > 0) inertial_.resize(count);
  wrench_.resize(static_cast<Eigen::Index>(count), 3);
  constants_.resize(static_cast<Eigen::Index>(count), 4);
}

double DisturbanceFilter::run(const Model& model, const DisturbanceLevels& levels, double cap,
                              std::vector<FilterBelief>* kept) {
  Pass pass(model, run_, poses_, levels);
  double likelihood = 0;
  std::size_t next = 0;  // belief to keep
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    FilterSample& s = samples_[k];
    s.starts = starts_[k];
    if (s.starts)
      pass.start(k);
    else if (!inertial_.empty() && samples_[k - 1].dt > 0)
      pass.correct(k, samples_[k - 1], steps_, cap, inertial_[k]);
    if (const InertialSample* inertial = inertialAt(k)) likelihood += inertial->log_density;
    pass.correct(k, cap, s);
    likelihood += s.log_density;
    wrench_.row(static_cast<Eigen::Index>(k)) = pass.wrench();
    constants_.row(static_cast<Eigen::Index>(k)) = pass.constants();
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next) {
      pass.keep((*kept)[next]);
      (*kept)[next].log_likelihood = likelihood;
    }
    const bool last = k + 1 == samples_.size() || starts_[k + 1];
    s.dt = last ? 0 : run_.times[k + 1] - run_.times[k];
    if (s.dt <= 0) continue;
    pass.move(k, s);
    if (!std::isfinite(likelihood) || !pass.finite()) return std::numeric_limits<double>::quiet_NaN();
  }
  constants_sigma_ = pass.constantsSigma();
  levels_ = levels;
  return likelihood;
}

double requireFinite(double log_likelihood) {
  if (!std::isfinite(log_likelihood))
    throw std::runtime_error("the model's motion along the recordings is not finite");
  return log_likelihood;
}

std::size_t DisturbanceFilter::lastOfStretch(std::size_t sample) const {
  const auto next = std::find(starts_.begin() + static_cast<std::ptrdiff_t>(sample) + 1, starts_.end(), true);
  return static_cast<std::size_t>(next - starts_.begin()) - 1;
}

int DisturbanceFilter::blockCount(double block) const {
  if (!(block > 0)) throw std::invalid_argument("blocks of time must be longer than 0 s");
  const double duration = run_.times.back() - run_.times.front();
  const auto most = static_cast<double>(samples_.size());
  return static_cast<int>(std::clamp(std::round(duration / block), 1.0, most));
}

int DisturbanceFilter::blockOf(std::size_t sample, int blocks) const {
  return static_cast<int>(sample * static_cast<std::size_t>(blocks) / samples_.size());
}

Eigen::VectorXd DisturbanceFilter::densities(double block) const {
  const int blocks = blockCount(block);
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(blocks);
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    sums(blockOf(k, blocks)) += samples_[k].log_density;
    if (const InertialSample* inertial = inertialAt(k)) sums(blockOf(k, blocks)) += inertial->log_density;
  }
  return sums;
}

Eigen::MatrixXd DisturbanceFilter::whitened() const {
  const auto count = static_cast<Eigen::Index>(samples_.size());
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(count, inertial_.empty() ? 3 : 6);
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    rows.row(row).head<3>() = samples_[k].whitened();
    if (const InertialSample* inertial = inertialAt(k)) rows.row(row).tail<3>() = inertial->whitened();
  }
  return rows;
}

Eigen::MatrixXd DisturbanceFilter::responses(const Eigen::MatrixXd& acting) const {
  const Eigen::Index count = acting.cols() / 3;
  const Eigen::Index of_sample = inertial_.empty() ? 3 : 6;
  Eigen::MatrixXd result =
      Eigen::MatrixXd::Zero(of_sample * static_cast<Eigen::Index>(samples_.size()), count);
  Deviations x(!inertial_.empty(), count);
  const Eigen::Matrix3Xd nothing = Eigen::Matrix3Xd::Zero(3, count);
  const Random random(levels_, run_.noise);
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    const auto row = static_cast<Eigen::Index>(k);
    if (s.starts) forgetDeviation(x.state);
    if (const InertialSample* inertial = inertialAt(k))
      result.middleRows<3>(of_sample * row + 3) = -correctDeviation(*inertial, nothing, x);
    const Eigen::Matrix3Xd white = correctDeviation(s, nothing, x);
    if (!s.starts) result.middleRows<3>(of_sample * row) = -white;
    if (s.dt <= 0) continue;
    x.move(s, random.over(s.dt));
    const Eigen::RowVectorXd now = acting.row(row);  // X, Y, N of each wrench
    x.state.topRows<6>() += s.response * Eigen::Map<const Eigen::Matrix3Xd>(now.data(), 3, count);
  }
  return result;
}

}  // namespace ground::detail
