#include "ground/estimation/disturbance_observer.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "ground/model/drive_clock.h"
#include "ground/model/measurement.h"
#include "ground/model/pushed_step.h"

namespace ground {
namespace {

constexpr double kLongestStep = 0.01;  // [s]
constexpr double kObserverGap = 1.0;   // a longer gap between measurements restarts it [s]
// Biases of the sensors at first [m/s^2], [rad/s], and their drift [m/s^2.5], [rad/s^1.5].
constexpr double kPushBias = 0.2, kTurnBias = 0.02;
constexpr double kPushBiasDrift = 2e-3, kTurnBiasDrift = 1e-4;
constexpr double kSameSpan = 1e-3;       // largest difference of equal times [s]
constexpr double kNoAcceleration = 1e6;  // variance of an acceleration that says nothing [m^2/s^4]

/// The specific force of a motion from one measured velocity to another one, in the body frame: its mean, and
/// the derivatives by both velocities.
struct SpecificForce {
  SpecificForce(const Vector3<double>& before, const Vector3<double>& after, double h) {
    const Vector3<double> mean = 0.5 * (before + after);
    const Vector2<double> turned(-mean.y(), mean.x());
    value = (after - before).head<2>() / h + mean.z() * turned;
    Eigen::Matrix2d quarter;
    quarter << 0, -1, 1, 0;
    const Eigen::Matrix2d turning = 0.5 * mean.z() * quarter;
    by_before << turning - Eigen::Matrix2d::Identity() / h, 0.5 * turned;
    by_after << turning + Eigen::Matrix2d::Identity() / h, 0.5 * turned;
  }

  Vector2<double> value;
  Eigen::Matrix<double, 2, 3> by_before, by_after;
};

}  // namespace

DisturbanceObserver::DisturbanceObserver(const Model& model, const ObserverParams& params)
    : dynamics_(model), derivatives_(model), params_(params) {
  if (model.stateCount() > kMaxStates)
    throw std::invalid_argument("a model whose effects have more than " + std::to_string(kMaxStates) +
                                " states cannot be observed");
  reset();
}

void DisturbanceObserver::reset() {
  started_ = false;
  estimate_ = Estimate();
  bias_.setZero();
  noise_.setZero();
  transition_.setIdentity();
}

void DisturbanceObserver::command(double time, const Thrusters<double>& thrusters, double lift) {
  if (count_ > 0 && time < recent(0).time - DriveClock::kDisorder) count_ = 0;
  commands_[count_++ % commands_.size()] = {time, thrusters, lift};
}

const DisturbanceObserver::Command& DisturbanceObserver::recent(std::size_t age) const {
  return commands_[(count_ - 1 - age) % commands_.size()];
}

template <typename Step>
void DisturbanceObserver::replay(double from, double until, Step step) const {
  const Command none{0, Thrusters<double>::zero(dynamics_.layout().size()), 0};
  const std::size_t known = std::min(count_, commands_.size());
  std::size_t age = 0;  // age of the command that acts at `from`, 0 for the newest
  while (age < known && recent(age).time + delay() > from) ++age;
  double now = from;
  while (now < until) {
    const Command& held = age < known ? recent(age) : none;
    const double change = age > 0 ? recent(age - 1).time + delay() : until;
    const double end = std::max(now, std::min(until, change));
    const int pieces = std::max(1, static_cast<int>(std::ceil((end - now) / kLongestStep - 1e-9)));
    for (int i = 0; i < pieces && end > now; ++i)
      step(now + i * (end - now) / pieces, (end - now) / pieces, held);
    now = end;
    if (age > 0) --age;
  }
}

void DisturbanceObserver::settle() {
  const std::vector<double>& initial = dynamics_.initialStates();
  std::copy(initial.begin(), initial.end(), estimate_.effects.begin());
  const std::size_t known = std::min(count_, commands_.size());
  if (known == 0 || !dynamics_.hasMemory()) return;
  const double from = std::max(recent(known - 1).time + delay(), time_ - kActuatorMemory);
  replay(from, time_, [&](double t, double h, const Command& c) {
    dynamics_.settle(t - origin_, estimate_.state, c.thrusters, {c.lift, volts_}, h,
                     estimate_.effects.data());
  });
}

void DisturbanceObserver::begin(double time, const RigidState<double>& state,
                                const PoseMeasurement& measured) {
  started_ = true;
  time_ = time;
  estimate_.state = state;
  try {
    // The state of the craft's centre, not of the tracked point.
    estimate_.state = stateSeenAs(derivatives_, {state.eta, state.nu});
  } catch (const std::runtime_error&) {
    // Starts with the measurement; corrections converge to the state.
  }
  settle();
  Vector deviation;
  deviation << measured.covariance.diagonal().cwiseSqrt(), 0.05, 0.05, 0.2, params_.push_drift,
      params_.push_drift, params_.twist_drift, kPushBias, kPushBias, kTurnBias;
  covariance_ = deviation.array().square().matrix().asDiagonal();
  deviation.tail<6>().setZero();
  noise_ = deviation.array().square().matrix().asDiagonal();
  transition_.setIdentity();
}

void DisturbanceObserver::measure(double time, const RigidState<double>& state,
                                  const PoseMeasurement& measured) {
  if (!measured.eta.allFinite() || (started_ && time <= time_)) return;
  if (!started_ || time - time_ > kObserverGap) {
    begin(time, state, measured);
    return;
  }
  predict(time, measured.inertial);
  correct(measured);
}

void DisturbanceObserver::predict(double until, const std::optional<InertialMeasurement>& inertial) {
  // Derivatives by psi, nu and the missing acceleration. Those by x and y are neglected.
  constexpr int kPsi = 0, kNu = 1, kMissing = 4;
  RigidState<Jet> state{estimate_.state.eta.cast<Jet>(), estimate_.state.nu.cast<Jet>()};
  Vector3<Jet> missing = estimate_.missing.cast<Jet>();
  std::array<Jet, kMaxStates> effects;
  for (std::size_t i = 0; i < effects.size(); ++i) effects[i] = Jet(estimate_.effects[i]);
  state.eta.z().v[kPsi] = 1;
  for (int i = 0; i < 3; ++i) {
    state.nu(i).v[kNu + i] = 1;
    missing(i).v[kMissing + i] = 1;
  }
  const Velocity before = velocity(estimate_.state);
  replay(time_, until, [&](double t, double h, const Command& c) {
    const StepInputs<Jet> acting =
        derivatives_.actuate(c.thrusters.cast<Jet>(), {c.lift, volts_}, Jet(h), effects.data());
    state = pushedStep(derivatives_, Jet(t - origin_), state, acting, missing, h);
  });
  Matrix F = Matrix::Identity();
  for (int i = 0; i < 3; ++i) {
    estimate_.state.eta(i) = state.eta(i).a;
    estimate_.state.nu(i) = state.nu(i).a;
    F.row(i).segment<7>(2) = state.eta(i).v.head<7>().transpose();
    F.row(3 + i).segment<7>(2) = state.nu(i).v.head<7>().transpose();
  }
  for (std::size_t i = 0; i < effects.size(); ++i) estimate_.effects[i] = effects[i].a;
  const double h = until - time_;
  time_ = until;
  Vector density;
  density << 0, 0, 0, params_.push, params_.push, params_.twist, params_.push_drift, params_.push_drift,
      params_.twist_drift, kPushBiasDrift, kPushBiasDrift, kTurnBiasDrift;
  const Vector noise = h * density.array().square();
  if (inertial) {
    feel(*inertial, before, h, F, noise);
    return;
  }
  transition_ = F.topLeftCorner<6, 6>();
  noise_ = (F * noise_ * F.transpose()).eval();
  covariance_ = (F * covariance_ * F.transpose()).eval();
  covariance_.diagonal() += noise;
}

/// The measured velocity of a state and its derivatives by nu.
DisturbanceObserver::Velocity DisturbanceObserver::velocity(const RigidState<double>& at) const {
  RigidState<Jet> state{at.eta.cast<Jet>(), at.nu.cast<Jet>()};
  for (int i = 0; i < 3; ++i) state.nu(i).v[i] = 1;
  const Measurement<Jet> seen = derivatives_.measure(state);
  Velocity found;
  for (int i = 0; i < 3; ++i) {
    found.value(i) = seen.nu(i).a;
    found.by_nu.row(i) = seen.nu(i).v.head<3>().transpose();
  }
  return found;
}

/// Completes a prediction over h with derivatives F and variances `noise` of its random part. What is
/// measured depends on the state before and on the random part, both of which it therefore corrects.
void DisturbanceObserver::feel(const InertialMeasurement& measured, const Velocity& before, double h,
                               const Matrix& F, const Vector& noise) {
  const Velocity after = velocity(estimate_.state);
  const SpecificForce force(before.value, after.value, h);
  Eigen::Matrix<double, 3, 3> by_after, by_before = Matrix3<double>::Zero();
  by_after << force.by_after * after.by_nu, after.by_nu.row(2);
  by_before.topRows<2>() = force.by_before * before.by_nu;
  Vector3<double> off;
  off << measured.acceleration - force.value, measured.yaw_rate - after.value.z();
  off -= bias_;
  Vector3<double> R = measured.variance;
  // A state between the poses was lost: the mean acceleration is not that of the whole prediction.
  if (std::abs(h - measured.span) > kSameSpan) R.head<2>().setConstant(kNoAcceleration);
  Eigen::Matrix<double, 3, kStates> D = by_after * F.middleRows<3>(3);
  D.middleCols<3>(3) += by_before;
  D.rightCols<3>().setIdentity();
  const Matrix3<double> by_random = by_after * noise.segment<3>(3).asDiagonal();
  Gain cross = F * covariance_ * D.transpose();
  cross.middleRows<3>(3) += by_random.transpose();
  Matrix3<double> S = D * covariance_ * D.transpose() + by_random * by_after.transpose();
  S.diagonal() += R;
  const Gain K = S.llt().solve(Eigen::Matrix<double, 3, kStates>(cross.transpose())).transpose();
  apply(K * off);
  const Matrix rest = F - K * D;
  Matrix random = Matrix::Identity();
  random.middleCols<3>(3) -= K * by_after;
  const Matrix by_sensors = K * R.asDiagonal() * K.transpose();
  transition_ = rest.topLeftCorner<6, 6>();
  noise_ = (rest * noise_ * rest.transpose() + by_sensors).eval();
  covariance_ =
      (rest * covariance_ * rest.transpose() + random * noise.asDiagonal() * random.transpose() + by_sensors)
          .eval();
}

void DisturbanceObserver::apply(const Vector& change) {
  estimate_.state.eta += change.head<3>();
  estimate_.state.nu += change.segment<3>(3);
  estimate_.missing += change.segment<3>(6);
  bias_ += change.tail<3>();
}

void DisturbanceObserver::correct(const PoseMeasurement& measured) {
  RigidState<Jet> state{estimate_.state.eta.cast<Jet>(), estimate_.state.nu.cast<Jet>()};
  for (int i = 0; i < 3; ++i) state.eta(i).v[i] = 1;
  const Measurement<Jet> seen = derivatives_.measure(state);
  Eigen::Matrix<double, 3, kStates> H = Eigen::Matrix<double, 3, kStates>::Zero();
  Vector3<double> off;
  for (int i = 0; i < 3; ++i) {
    H.row(i).head<3>() = seen.eta(i).v.head<3>().transpose();
    off(i) = measured.eta(i) - seen.eta(i).a;
  }
  off.z() = wrapAngle(off.z());
  const Matrix3<double> S = H * covariance_ * H.transpose() + measured.covariance;
  const Gain K = S.llt().solve(Eigen::Matrix<double, 3, kStates>(H * covariance_)).transpose();
  apply(K * off);
  // Joseph form: keeps the covariance symmetric and positive.
  const Matrix rest = Matrix::Identity() - K * H;
  const Matrix by_pose = K * measured.covariance * K.transpose();
  covariance_ = (rest * covariance_ * rest.transpose() + by_pose).eval();
  noise_ = (rest * noise_ * rest.transpose() + by_pose).eval();
}

DisturbanceObserver::Estimate DisturbanceObserver::at(double time) const {
  Estimate at = estimate_;
  replay(time_, time, [&](double t, double h, const Command& c) {
    const StepInputs<double> acting = dynamics_.actuate(c.thrusters, {c.lift, volts_}, h, at.effects.data());
    at.state = pushedStep(dynamics_, t - origin_, at.state, acting, at.missing, h);
  });
  return at;
}

}  // namespace ground
