#include "ground/estimation/change_filter.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "ground/model/capability.h"
#include "ground/model/measurement.h"
#include "ground/model/plausibility.h"
#include "ground/model/time_scale.h"

namespace ground {
namespace {

constexpr double kPositionNoise = 3e-4, kHeadingNoise = 5e-3;  // of poses [m], [rad]
constexpr int kLanes = 8;                                      // derivatives of a Jet
constexpr double kFilterStep = 0.01;  // longest step of the integration [time scales]
// A longer gap between measurements restarts it, because commands may be lost, too [time scales].
constexpr double kFilterGap = 0.15;
constexpr double kCommandMemory = 12;   // commands kept, for delay and lag [s]
constexpr double kRelinearised = 5e-3;  // change of parameters that needs new derivatives
constexpr double kOutlying = 25;        // squared innovation beyond which a pose has less weight

constexpr double kWhiteShare =
    0.2;  // part of the observer's white noise that is taken: the push is modelled apart
constexpr double kMostWhite =
    0.005;  // most white noise, as a share of the acceleration by full thrust [time scales^0.5]
// Change of velocity by a collision: the velocity turns round, or changes as by full thrust for so long
// [time scales].
constexpr double kHitTime = 0.25;
constexpr double kFirstPoses = 0.01;  // of poses that give the first velocity, which lags by so much [s]
constexpr double kHitPause = 1;       // shortest time between two collisions [time scales]
// Levels where the model file has no disturbance, as shares of the acceleration by full thrust, and how long
// pushes last [time scales].
constexpr double kPushShare = 0.02, kPushTime = 0.5, kTrimShare = 0.02;
constexpr double kBiasDrift = 0.05;  // drift of the bias, relative to its level [1/time scale^0.5]
// A floor that is not level: its slope as in usual rooms, a share of full thrust for what else stays in the
// room, and the most of it, because boats have no floor; its drift, relative to that [1/time scale^0.5].
constexpr double kSlope = 2e-3, kTiltShare = 0.02, kMostTilt = 0.1, kTiltDrift = 0.04, kGravity = 9.80665;

/// What is known of a craft by its file, and how fast it may change unnoticed [1/time scale^0.5].
struct Level {
  double known, drift;
};
constexpr Level kThrusterLevel{0.03, 5e-4}, kThrustLevel{0.05, 3e-3}, kMassLevel{0.02, 1e-4},
    kInertiaLevel{0.05, 5e-4}, kCentreLevel{0.02, 3e-4}, kDragLevel{0.1, 3e-3};  // the centre in levers

Vector3<double> squared(const Vector3<double>& x) { return x.cwiseAbs2(); }

}  // namespace

/// State and its derivatives after a motion.
struct ChangeFilter::Moved {
  RigidState<Jet> state;
  std::array<Jet, kMaxStates> effects;
};

ChangeFilter::ChangeFilter(const Model& model, const ObserverParams& params)
    : craft_(model), params_(params), time_scale_(timeScale(model)), inputs_(model.thrusters->size()) {
  if (model.stateCount() > kMaxStates)
    throw std::invalid_argument("a model whose effects have more than " + std::to_string(kMaxStates) +
                                " states cannot be observed");
  const Body<double>& body = model.body;
  const Vector2<double> most = capability(model).accelerations(body.m, body.I_z);
  most_ << most.x(), most.x(), most.y();
  const Disturbance& known = model.disturbance;
  const Vector3<double> mass(body.m, body.m, body.I_z);
  white_ = kWhiteShare * Vector3<double>(params.push, params.push, params.twist);
  white_ = white_.cwiseMin(kMostWhite * std::sqrt(time_scale_) * most_);
  tilt_ = std::min(std::hypot(kGravity * kSlope, kTiltShare * most_.x()), kMostTilt * most_.x());
  push_ = kPushShare * most_;
  push_time_.setConstant(kPushTime * time_scale_);
  bias_ = kTrimShare * most_;
  thrust_trim_ = std::max(kThrustLevel.known, known.trim_thrust);
  if (!known.empty()) {
    white_ = known.white.cwiseQuotient(mass).cwiseMax(0.5 * white_);
    push_ = known.sigma.cwiseQuotient(mass).cwiseMax(0.2 * push_);
    for (int i = 0; i < 3; ++i)
      if (known.time(i) > 0) push_time_(i) = known.time(i);
    bias_ = known.trim.cwiseQuotient(mass).cwiseMax(0.2 * bias_);
  }
  reset();
}

void ChangeFilter::reset() {
  const int n = kChange + craft_.size(), thrusters = craft_.thrusters();
  started_ = false;
  far_ = 0;
  hit_ = -std::numeric_limits<double>::infinity();
  inputs_ = InputSequence(inputs_.thruster_count);
  acting_ = 0;
  x_ = Vector::Zero(n);
  P_ = Matrix::Zero(n, n);
  P_.diagonal().segment<3>(kPush) = squared(push_);
  P_.diagonal().segment<3>(kBias) = squared(bias_);
  P_.diagonal().segment<2>(kTilt).setConstant(tilt_ * tilt_);
  auto change = P_.bottomRightCorner(craft_.size(), craft_.size());
  change.topLeftCorner(thrusters, thrusters).setConstant(thrust_trim_ * thrust_trim_);
  change.diagonal().head(thrusters).array() += kThrusterLevel.known * kThrusterLevel.known;
  change(craft_.mass(), craft_.mass()) = kMassLevel.known * kMassLevel.known;
  change(craft_.inertia(), craft_.inertia()) = kInertiaLevel.known * kInertiaLevel.known;
  const double lever = kCentreLevel.known * craft_.model().body.l;
  change.diagonal().segment<2>(craft_.centre()).setConstant(lever * lever);
  change(craft_.drag(), craft_.drag()) = kDragLevel.known * kDragLevel.known;
  at_ = Vector::Zero(craft_.size());
  linearise();
}

void ChangeFilter::voltage(double volts) {
  if (isPlausibleVoltage(volts, craft_.model().body.volts)) volts_ = volts;
}

void ChangeFilter::command(double time, const Thrusters<double>& thrusters, double lift) {
  inputs_.add(time, thrusters, lift);
  acting_ -= std::min(acting_, inputs_.dropBefore(time_ - kCommandMemory));
}

/// The steps from time_, which is moved, to a time.
std::vector<ChangeFilter::Piece> ChangeFilter::pieces(double until) {
  std::vector<Piece> all;
  const double delay = dynamics_.front().inputDelay().a, began = inputs_.drive.origin(until);
  const auto begins = [&] { return inputs_.times[acting_] + delay; };
  while (time_ < until) {
    while (acting_ < inputs_.size() && begins() <= time_) ++acting_;
    const double end = acting_ < inputs_.size() ? std::min(until, begins()) : until;
    const int steps =
        std::max(1, static_cast<int>(std::ceil((end - time_) / (kFilterStep * time_scale_) - 1e-9)));
    all.push_back({steps, (end - time_) / steps, time_ - began, acting_});
    time_ = end;
  }
  return all;
}

Thrusters<Jet> ChangeFilter::thrusters(const Piece& piece) const {
  if (piece.acts > 0) return inputs_.thrusters[piece.acts - 1].cast<Jet>();
  return Thrusters<Jet>::zero(inputs_.thruster_count);
}

/// Derivatives at the present change: first those by the state, then by eight parameters each.
void ChangeFilter::linearise() {
  at_ = craft_.bounded(x_.tail(craft_.size()));
  dynamics_.clear();
  for (int first = -kLanes; first < craft_.size(); first += kLanes) {
    std::vector<Jet> change;
    for (int i = 0; i < craft_.size(); ++i) {
      change.emplace_back(at_(i));
      if (first >= 0 && i >= first && i < first + kLanes) change.back().v[i - first] = 1;
    }
    dynamics_.emplace_back(craft_.model(), craft_.coordinates(change));
  }
}

void ChangeFilter::begin(const RigidState<double>& measured) {
  RigidState<double> state = measured;
  try {
    state = stateSeenAs(dynamics_.front(), {measured.eta, measured.nu});
  } catch (const std::runtime_error&) {
    // Starts with the measurement; corrections converge to the state.
  }
  x_.head<6>() << state.eta, state.nu;
  x_.segment<3>(kPush).setZero();
  P_.topRows<kBias>().setZero();
  P_.leftCols<kBias>().setZero();
  const double position = kPositionNoise, heading = kHeadingNoise;
  Eigen::Matrix<double, 6, 1> deviation;
  // The first velocity is as certain as that by two poses.
  const Vector3<double> noise(position, position, heading);
  deviation << noise, std::sqrt(2) / kFirstPoses * noise + kFirstPoses * most_;
  P_.diagonal().head<6>() = deviation.cwiseAbs2();
  P_.diagonal().segment<3>(kPush) = squared(push_);
  started_ = true;
}

/// Moves the states of effects to a time by the commands before it, as if the craft stood.
void ChangeFilter::settle(double until) {
  const Dynamics<Jet>& dynamics = dynamics_.front();
  std::array<Jet, kMaxStates> states;
  std::copy(dynamics.initialStates().begin(), dynamics.initialStates().end(), states.begin());
  const RigidState<Jet> rest;
  time_ = until - kActuatorMemory;
  acting_ = 0;
  for (const Piece& piece : pieces(until))
    for (int i = 0; i < piece.steps && dynamics.hasMemory(); ++i)
      dynamics.settle(Jet(piece.t), rest, thrusters(piece), conditions(piece), Jet(piece.h), states.data());
  for (std::size_t i = 0; i < effects_.size(); ++i)
    effects_[i] = i < dynamics.initialStates().size() ? states[i].a : 0;
}

std::optional<ChangeFilter::Step> ChangeFilter::measure(double time, const RigidState<double>& measured) {
  if (!started_ || time - time_ > kFilterGap * time_scale_) {
    settle(time);
    begin(measured);
    return std::nullopt;
  }
  if (((x_.tail(craft_.size()) - at_).array().abs() > kRelinearised).any()) linearise();
  Matrix transition = predict(time);
  Step step = correct(measured.eta);
  step.transition = std::move(transition);
  if (!x_.allFinite() || !P_.allFinite()) {
    const InputSequence inputs = inputs_;
    reset();
    inputs_ = inputs;
    return std::nullopt;
  }
  return step;
}

/// The motion over stretches of constant commands. Pass 0 has derivatives by heading, velocity and missing
/// acceleration, the others by parameters.
ChangeFilter::Moved ChangeFilter::move(const Dynamics<Jet>& dynamics, const std::vector<Piece>& all,
                                       int pass) const {
  Moved moved;
  const Rotation<double> heading(x_(2));
  const Vector2<double> tilt = heading.toBody(x_.segment<2>(kTilt));
  Vector3<Jet> missing;
  for (int i = 0; i < 3; ++i) {
    moved.state.eta(i) = Jet(x_(i));
    moved.state.nu(i) = Jet(x_(kNu + i));
    missing(i) = Jet(x_(kPush + i) + x_(kBias + i) + (i < 2 ? tilt(i) : 0));
    if (pass > 0) continue;
    moved.state.nu(i).v[1 + i] = 1;
    missing(i).v[4 + i] = 1;
  }
  if (pass == 0) {
    moved.state.eta.z().v[0] = 1;
    missing.x().v[0] = tilt.y();
    missing.y().v[0] = -tilt.x();
  }
  for (std::size_t i = 0; i < effects_.size(); ++i) moved.effects[i] = Jet(effects_[i]);
  for (const Piece& piece : all)
    for (int i = 0; i < piece.steps; ++i)
      moved.state = drivenStep(dynamics, Jet(piece.t + i * piece.h), moved.state, thrusters(piece),
                               conditions(piece), missing, piece.h, moved.effects.data());
  return moved;
}

/// Moves x and its covariance; returns the derivatives of x by x before.
ChangeFilter::Matrix ChangeFilter::predict(double until) {
  const double h = until - time_;
  const std::vector<Piece> all = pieces(until);
  const int n = size(), parameters = craft_.size();
  Matrix F = Matrix::Identity(n, n);
  const Moved by_state = move(dynamics_[0], all, 0);
  const Rotation<double> heading(x_(2));
  for (int i = 0; i < 6; ++i) {
    const Jet& value = i < 3 ? by_state.state.eta(i) : by_state.state.nu(i - 3);
    F(i, 2) = value.v[0];
    for (int j = 0; j < 3; ++j) {
      F(i, kNu + j) = value.v[1 + j];
      F(i, kPush + j) = F(i, kBias + j) = value.v[4 + j];
    }
    F.block<1, 2>(i, kTilt) = heading.toWorld({value.v[4], value.v[5]}).transpose();
  }
  for (int pass = 1; pass < static_cast<int>(dynamics_.size()); ++pass) {
    const Moved moved = move(dynamics_[static_cast<std::size_t>(pass)], all, pass);
    const int first = kLanes * (pass - 1), count = std::min(kLanes, parameters - first);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < count; ++j)
        F(i, kChange + first + j) = (i < 3 ? moved.state.eta(i) : moved.state.nu(i - 3)).v[j];
  }
  for (int i = 0; i < 3; ++i) F(kPush + i, kPush + i) = std::exp(-h / push_time_(i));
  for (int i = 0; i < 3; ++i) {
    x_(i) = by_state.state.eta(i).a;
    x_(kNu + i) = by_state.state.nu(i).a;
    x_(kPush + i) *= F(kPush + i, kPush + i);
  }
  x_.head<6>() += F.topRightCorner(6, parameters) * (x_.tail(parameters) - at_);
  for (std::size_t i = 0; i < effects_.size(); ++i) effects_[i] = by_state.effects[i].a;
  P_ = (F * P_ * F.transpose()).eval();
  addNoise(h);
  return F;
}

void ChangeFilter::addNoise(double h) {
  const auto walk = [&](double drift) { return drift * drift * h / time_scale_; };
  auto all = P_.diagonal();
  for (int i = 0; i < 3; ++i) {
    all(kNu + i) += white_(i) * white_(i) * h;
    all(kPush + i) += push_(i) * push_(i) * (1 - std::exp(-2 * h / push_time_(i)));
    all(kBias + i) += walk(kBiasDrift * bias_(i));
  }
  all.segment<2>(kTilt).array() += walk(kTiltDrift * tilt_);
  const int thrusters = craft_.thrusters();
  P_.block(kChange, kChange, thrusters, thrusters).array() += walk(kThrustLevel.drift);
  all.segment(kChange, thrusters).array() += walk(kThrusterLevel.drift);
  all(kChange + craft_.mass()) += walk(kMassLevel.drift);
  all(kChange + craft_.inertia()) += walk(kInertiaLevel.drift);
  all.segment<2>(kChange + craft_.centre()).array() += walk(kCentreLevel.drift * craft_.model().body.l);
  all(kChange + craft_.drag()) += walk(kDragLevel.drift);
}

ChangeFilter::Step ChangeFilter::correct(const Vector3<double>& eta) {
  Step step;
  RigidState<Jet> state{x_.head<3>().cast<Jet>(), x_.segment<3>(kNu).cast<Jet>()};
  for (int i = 0; i < 3; ++i) state.eta(i).v[i] = 1;
  const Measurement<Jet> seen = dynamics_.front().measure(state);
  step.output = Matrix::Zero(3, size());
  for (int i = 0; i < 3; ++i) {
    step.output.row(i).head<3>() = seen.eta(i).v.head<3>().transpose();
    step.innovation(i) = eta(i) - seen.eta(i).a;
  }
  step.innovation.z() = wrapAngle(step.innovation.z());
  const Vector3<double> noise(kPositionNoise, kPositionNoise, kHeadingNoise);
  const Matrix PH = P_ * step.output.transpose();
  Matrix3<double> R = squared(noise).asDiagonal();
  step.covariance = step.output * PH + R;
  const double size_squared = step.innovation.dot(step.covariance.llt().solve(step.innovation));
  far_ = size_squared > kOutlying ? far_ + 1 : 0;
  if (far_ > 0 && time_ - hit_ > kHitPause * time_scale_) {  // a wrong pose, or the second after a collision
    step.hit = far_ > 1;
    if (step.hit) hit(eta);
    step.output.setZero();
    step.gain = Matrix::Zero(size(), 3);
    return step;
  }
  if (size_squared > kOutlying) {
    R += (size_squared / kOutlying - 1) * step.covariance;
    step.covariance *= size_squared / kOutlying;
  }
  step.gain = step.covariance.llt().solve(PH.transpose()).transpose();
  x_ += step.gain * step.innovation;
  // Joseph form: keeps the covariance symmetric and positive.
  const Matrix rest = Matrix::Identity(size(), size()) - step.gain * step.output;
  P_ = (rest * P_ * rest.transpose() + step.gain * R * step.gain.transpose()).eval();
  return step;
}

/// The motion begins anew from a pose, with any velocity near the present one.
void ChangeFilter::hit(const Vector3<double>& eta) {
  RigidState<double> seen{eta, x_.segment<3>(kNu)};
  begin(seen);
  const double speed = 2 * seen.nu.head<2>().norm(), turn = 2 * std::abs(seen.nu.z());
  P_.diagonal().segment<3>(kNu) =
      squared(Vector3<double>(speed, speed, turn)) + squared(kHitTime * time_scale_ * most_);
  hit_ = time_;
}

void ChangeFilter::shift(const Vector& by, const Matrix& covariance) {
  x_ += by;
  P_ += covariance;
}

}  // namespace ground
