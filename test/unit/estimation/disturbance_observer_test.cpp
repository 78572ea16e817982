// The disturbance observer, compared with a plain Kalman filter about a simulation.
#include "ground/estimation/disturbance_observer.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>

#include "../crafts.h"
#include "ground/model/measurement.h"
#include "ground/model/simulation.h"

namespace ground {
namespace disturbance_observer_test {

using Vector9 = Eigen::Matrix<double, 9, 1>;
using Matrix9 = Eigen::Matrix<double, 9, 9>;

constexpr double kPosition = 3e-4, kHeading = 4e-3;  // assumed noise of poses [m], [rad]

PoseMeasurement pose(const RigidState<double>& state) {
  return poseMeasurement(state.eta, kPosition, kHeading);
}

/// A craft with delay, lag, a battery that fades during a drive, and a marker off the centre.
Model craft() {
  return withValues(loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml"), {{"input_delay.delay", 0.033},
                                                                        {"motor_lag.tau", 0.05},
                                                                        {"battery_sag.tau", 4},
                                                                        {"marker_offset.dx", 0.02},
                                                                        {"marker_offset.dy", -0.03}});
}

/// Kalman filter with derivatives by finite differences; forces and moments for accelerations.
class PlainObserver {
 public:
  PlainObserver(const Model& model, const ObserverParams& params, const InputSequence& inputs)
      : model_(model), params_(params), inputs_(inputs), measure_(model) {}

  void measure(double time, const RigidState<double>& seen) {
    if (!started_ || time - time_ > 1.0) {
      const RigidState<double> at = stateSeenAs(Dynamics<Jet>(model_), {seen.eta, seen.nu});
      x_.head<6>() << at.eta, at.nu;
      if (!started_) x_.tail<3>().setZero();  // a restart keeps what was missing
      Vector9 deviation;
      deviation << kPosition, kPosition, kHeading, 0.05, 0.05, 0.2, params_.push_drift, params_.push_drift,
          params_.twist_drift;
      P_ = deviation.cwiseAbs2().asDiagonal();
      began_ = time;
      started_ = true;
      time_ = time;
      return;
    }
    Matrix9 F = Matrix9::Identity();
    for (int i = 2; i < 9; ++i) {  // the motion hardly depends on the position
      const double change = 1e-4;
      const Vector9 up = x_ + change * Vector9::Unit(i), down = x_ - change * Vector9::Unit(i);
      F.col(i).head<6>() = (moved(up, time) - moved(down, time)) / (2 * change);
    }
    const Eigen::Matrix<double, 6, 1> next = moved(x_, time);
    x_.head<6>() = next;
    Vector9 density;
    density << 0, 0, 0, params_.push, params_.push, params_.twist, params_.push_drift, params_.push_drift,
        params_.twist_drift;
    P_ = F * P_ * F.transpose();
    P_ += (time - time_) * Matrix9(density.cwiseAbs2().asDiagonal());
    time_ = time;
    Eigen::Matrix<double, 3, 9> H = Eigen::Matrix<double, 3, 9>::Zero();
    for (int i = 0; i < 3; ++i) {
      const Vector9 step = 1e-5 * Vector9::Unit(i);
      H.col(i) = (measured(x_ + step) - measured(x_ - step)) / 2e-5;
    }
    Vector3<double> e = seen.eta - measured(x_);
    e(2) = std::remainder(e(2), 2 * M_PI);
    const Vector3<double> noise(kPosition, kPosition, kHeading);
    const Matrix3<double> S = H * P_ * H.transpose() + Matrix3<double>(noise.cwiseAbs2().asDiagonal());
    const Eigen::Matrix<double, 9, 3> K = P_ * H.transpose() * S.inverse();
    x_ += K * e;
    P_ -= K * H * P_;
  }

  /// Predicted pose and velocity.
  Eigen::Matrix<double, 6, 1> at(double time) const { return moved(x_, time); }
  Vector3<double> missing() const { return x_.tail<3>(); }

 private:
  Vector3<double> measured(const Vector9& x) const {
    return measure_.measure({x.head<3>(), x.segment<3>(3)}).eta;
  }

  /// Replays the commands from the start, so that the motors are in the right state.
  Eigen::Matrix<double, 6, 1> moved(const Vector9& x, double until) const {
    const Dynamics<double> dynamics(withValues(model_, {{"body_force_bias.x0", x(6) * model_.body.m},
                                                        {"body_force_bias.y0", x(7) * model_.body.m},
                                                        {"yaw_bias.n0", x(8) * model_.body.I_z}}));
    Simulation<double> simulation(dynamics, inputs_, {}, began_);
    simulation.advance(time_);
    simulation.state() = {x.head<3>(), x.segment<3>(3)};
    simulation.advance(until);
    Eigen::Matrix<double, 6, 1> to;
    to << simulation.state().eta, simulation.state().nu;
    return to;
  }

  Model model_;
  ObserverParams params_;
  const InputSequence& inputs_;
  Dynamics<double> measure_;
  bool started_ = false;
  double time_ = 0, began_ = 0;
  Vector9 x_ = Vector9::Zero();
  Matrix9 P_;
};

TEST(DisturbanceObserver, AgreesWithAPlainKalmanFilter) {
  const Model model = craft();
  const Model truth = withValues(model, {{"body_force_bias.x0", 0.004}, {"body_force_bias.y0", -0.006}});
  ObserverParams params;
  params.push = 0.05;
  params.push_drift = 0.1;
  InputSequence inputs;
  const double lift_off = 0.4;  // the drive begins
  inputs.add(0.1, 0, 0, 0);
  for (int i = 0; i < 90; ++i)
    inputs.add(lift_off + 0.03 * i, i % 7 < 4 ? 0.8 : 0.3, i % 5 < 2 ? 0.9 : 0.2, 1);
  DisturbanceObserver observer(model, params);
  observer.countFrom(lift_off);
  PlainObserver plain(model, params, inputs);
  const Dynamics<double> dynamics(truth);
  RigidState<double> start;
  start.eta << 0.3, -0.2, 3.0;
  Simulation<double> simulation(dynamics, inputs, start, 0);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::size_t given = 0;
  int looks = 0;
  for (int i = 0; i < 240; ++i) {
    const double t = 0.2 + 0.0103 * i;
    simulation.advance(t);
    for (; given < inputs.size() && inputs.times[given] <= t; ++given)
      observer.command(inputs.times[given], inputs.thrusters[given], inputs.lift[given]);
    if (i >= 150 && i < 185) continue;  // a gap, after which it restarts
    if (i % 20 == 3) continue;
    const Measurement<double> seen = simulation.measure();
    RigidState<double> measured{seen.eta, seen.nu};
    for (int c = 0; c < 3; ++c) measured.eta(c) += (c < 2 ? 5e-4 : 6e-3) * normal(random);
    measured.eta(2) = wrapAngle(measured.eta(2));
    observer.measure(t, measured, pose(measured));
    observer.measure(t - 0.005, start, pose(start));  // late ones are ignored
    observer.measure(t, start, pose(start));
    plain.measure(t, measured);
    if (i % 9) continue;
    ++looks;
    for (const double ahead : {0.0, 0.021}) {
      const auto found = observer.at(t + ahead);
      // Commands that are not given yet would act later than the delay.
      Eigen::Matrix<double, 6, 1> error = plain.at(t + ahead);
      error.head<3>() -= found.state.eta;
      error.tail<3>() -= found.state.nu;
      EXPECT_LT(error.head<3>().norm(), 2e-6) << t;
      EXPECT_LT(error.tail<3>().norm(), 5e-5) << t;
      const Vector3<double> missing = found.missing - plain.missing();
      EXPECT_LT(missing.head<2>().norm(), 2e-4) << t;
      EXPECT_LT(std::abs(missing.z()), 2e-3) << t;
    }
  }
  EXPECT_GT(looks, 15);
  EXPECT_GT(plain.missing().head<2>().norm(), 0.05);
}

TEST(DisturbanceObserver, ForgetsMeasurementsButNotCommands) {
  const Model model = craft();
  RigidState<double> here, there;
  here.eta << 1, 2, 0.5;
  there.eta << -1, 0, 2;
  DisturbanceObserver used(model, {}), fresh(model, {});
  for (DisturbanceObserver* observer : {&used, &fresh})
    for (int i = 0; i < 300; ++i) observer->command(0.01 * i, {0.7, 0.4}, 1);
  for (int i = 0; i < 20; ++i) used.measure(2.9 + 0.01 * i, here, pose(here));
  used.reset();
  for (DisturbanceObserver* observer : {&used, &fresh})
    for (int i = 0; i < 5; ++i) observer->measure(3 + 0.01 * i, there, pose(there));
  const auto a = used.at(3.1), b = fresh.at(3.1);
  EXPECT_EQ(a.state.eta, b.state.eta);
  EXPECT_EQ(a.missing, b.missing);
  EXPECT_EQ(a.effects, b.effects);
  EXPECT_NEAR(a.effects[0], 0.7, 1e-3) << "the motors have long followed the commands";
}

/// Rms error of u, v, r and of the missing acceleration's surge, sway and yaw parts of a pushed craft that is
/// seen at 30 Hz, after 5 s. `sensed`: with gyro and accelerometer of these biases.
Eigen::Matrix<double, 6, 1> errorsOfPushed(bool sensed, const Vector3<double>& bias) {
  constexpr double kFrame = 1.0 / 30, kPose = 1e-3, kAngle = 1e-2, kEnd = 40;
  const Model model = loadModel("cfg/hovercraft/tiny_whoover_4_1.yaml");
  const Dynamics<double> dynamics(model);
  DisturbanceObserver observer(model, {});
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  RigidState<double> state;
  Vector3<double> push = Vector3<double>::Zero();
  Eigen::Matrix<double, 6, 1> squares = Eigen::Matrix<double, 6, 1>::Zero();
  int count = 0;
  const int parts = 33;
  for (int i = 0; i * kFrame < kEnd; ++i) {
    const double t = i * kFrame;
    const Thrusters<double> given = {i / 9 % 2 ? 0.7 : 0.3, i / 14 % 2 ? 0.2 : 0.8};
    observer.command(t, given, 1);
    const Vector3<double> before = state.nu;
    Vector3<double> felt = Vector3<double>::Zero();
    for (int k = 0; k < parts; ++k) {
      const double h = kFrame / parts;
      for (int c = 0; c < 3; ++c)
        push(c) += -h / 0.5 * push(c) + (c < 2 ? 0.1 : 1.0) * std::sqrt(h) * normal(random);
      const Vector3<double> was = state.nu;
      state = pushedStep(dynamics, t, state, {{given, given, given}, {1, std::nullopt}, true}, push, h);
      const Vector3<double> mean = (was + state.nu) / 2;
      felt.head<2>() +=
          ((state.nu - was).head<2>() + h * mean.z() * Vector2<double>(-mean.y(), mean.x())) / kFrame;
    }
    felt.z() = state.nu.z();
    RigidState<double> seen = state;
    for (int c = 0; c < 3; ++c) seen.eta(c) += (c < 2 ? kPose : kAngle) * normal(random);
    PoseMeasurement measured = poseMeasurement(seen.eta, kPose, kAngle);
    if (sensed && i > 0) {
      for (int c = 0; c < 3; ++c) felt(c) += bias(c) + (c < 2 ? 0.05 : 4e-3) * normal(random);
      measured.inertial = InertialMeasurement{felt.head<2>(), felt.z(), {2.5e-3, 2.5e-3, 1.6e-5}, kFrame};
    }
    observer.measure(t + kFrame, {seen.eta, before}, measured);
    if (t < 5) continue;
    const auto found = observer.at(t + kFrame);
    squares.head<3>() += (found.state.nu - state.nu).cwiseAbs2();
    squares.tail<3>() += (found.missing - push).cwiseAbs2();
    ++count;
  }
  return (squares / count).cwiseSqrt();
}

TEST(DisturbanceObserver, SensorsMakeVelocityAndMissingAccelerationBetterAlsoWithBiases) {
  const Eigen::Matrix<double, 6, 1> without = errorsOfPushed(false, Vector3<double>::Zero());
  for (const Vector3<double>& bias : {Vector3<double>(0, 0, 0), Vector3<double>(0.15, -0.1, 0.01)}) {
    const Eigen::Matrix<double, 6, 1> sensed = errorsOfPushed(true, bias);
    for (const int c : {0, 1}) EXPECT_LT(sensed(c), 0.75 * without(c)) << c;
    EXPECT_LT(sensed(2), 0.2 * without(2));
    for (const int c : {3, 4}) EXPECT_LT(sensed(c), 0.8 * without(c)) << c;
    EXPECT_LT(sensed(5), 0.9 * without(5));
  }
}

}  // namespace disturbance_observer_test
}  // namespace ground
