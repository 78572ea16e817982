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

void DisturbanceObserver::begin(double time, const RigidState<double>& measured) {
  started_ = true;
  time_ = time;
  estimate_.state = measured;
  try {
    // The state of the craft's centre, not of the tracked point.
    estimate_.state = stateSeenAs(derivatives_, {measured.eta, measured.nu});
  } catch (const std::runtime_error&) {
    // Starts with the measurement; corrections converge to the state.
  }
  settle();
  Vector9 deviation;
  deviation << params_.position_noise, params_.position_noise, params_.heading_noise, 0.05, 0.05, 0.2,
      params_.push_drift, params_.push_drift, params_.twist_drift;
  covariance_ = deviation.array().square().matrix().asDiagonal();
  deviation.tail<3>().setZero();
  noise_ = deviation.array().square().matrix().asDiagonal();
  transition_.setIdentity();
}

void DisturbanceObserver::measure(double time, const RigidState<double>& measured) {
  if (started_ && time <= time_) return;
  if (!started_ || time - time_ > kObserverGap) {
    begin(time, measured);
    return;
  }
  predict(time);
  correct(measured.eta);
}

void DisturbanceObserver::predict(double until) {
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
  replay(time_, until, [&](double t, double h, const Command& c) {
    const StepInputs<Jet> acting =
        derivatives_.actuate(c.thrusters.cast<Jet>(), {c.lift, volts_}, Jet(h), effects.data());
    state = pushedStep(derivatives_, Jet(t - origin_), state, acting, missing, h);
  });
  Matrix9 F = Matrix9::Identity();
  for (int i = 0; i < 3; ++i) {
    estimate_.state.eta(i) = state.eta(i).a;
    estimate_.state.nu(i) = state.nu(i).a;
    F.row(i).tail<7>() = state.eta(i).v.head<7>().transpose();
    F.row(3 + i).tail<7>() = state.nu(i).v.head<7>().transpose();
  }
  for (std::size_t i = 0; i < effects.size(); ++i) estimate_.effects[i] = effects[i].a;
  const double h = until - time_;
  time_ = until;
  Vector9 noise = Vector9::Zero();
  noise.segment<6>(3) << params_.push, params_.push, params_.twist, params_.push_drift, params_.push_drift,
      params_.twist_drift;
  transition_ = F.topLeftCorner<6, 6>();
  noise_ = (F * noise_ * F.transpose()).eval();
  covariance_ = (F * covariance_ * F.transpose()).eval();
  covariance_.diagonal() += h * noise.array().square().matrix();
}

void DisturbanceObserver::correct(const Vector3<double>& eta) {
  RigidState<Jet> state{estimate_.state.eta.cast<Jet>(), estimate_.state.nu.cast<Jet>()};
  for (int i = 0; i < 3; ++i) state.eta(i).v[i] = 1;
  const Measurement<Jet> seen = derivatives_.measure(state);
  Eigen::Matrix<double, 3, 9> H = Eigen::Matrix<double, 3, 9>::Zero();
  Vector3<double> off;
  for (int i = 0; i < 3; ++i) {
    H.row(i).head<3>() = seen.eta(i).v.head<3>().transpose();
    off(i) = eta(i) - seen.eta(i).a;
  }
  off.z() = wrapAngle(off.z());
  const Vector3<double> noise(params_.position_noise, params_.position_noise, params_.heading_noise);
  Matrix3<double> S = H * covariance_ * H.transpose();
  S.diagonal() += noise.array().square().matrix();
  const Eigen::Matrix<double, 9, 3> K =
      S.llt().solve(Eigen::Matrix<double, 3, 9>(H * covariance_)).transpose();
  const Vector9 change = K * off;
  estimate_.state.eta += change.head<3>();
  estimate_.state.nu += change.segment<3>(3);
  estimate_.missing += change.tail<3>();
  // Joseph form: keeps the covariance symmetric and positive.
  const Matrix9 rest = Matrix9::Identity() - K * H;
  const Matrix9 by_pose = K * noise.array().square().matrix().asDiagonal() * K.transpose();
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
