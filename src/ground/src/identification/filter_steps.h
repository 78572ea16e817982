// Steps of the disturbance filter's recursion: covariances, gains, deviations of the state.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "disturbance_filter.h"
#include "ground/model/measurement.h"
#include "ground/model/simulation.h"

namespace ground::detail {

/// Size of the recursion's vectors and matrices: one more, which is zero, so that columns are whole
/// registers.
constexpr int kN = kFilterStates + 1;
constexpr int kProcesses = kConstant - kSlow;  ///< Ornstein-Uhlenbeck: X, Y, N, room x, room y

/// Accelerations [m/s^2], [rad/s^2] by all thrusters at once; infinite where angles add to them.
template <typename T>
Vector2<double> fullAccelerations(const Dynamics<T>& dynamics) {
  const ThrusterLayout& layout = dynamics.layout();
  const Body<T>& body = dynamics.body();
  double force = 0, moment = 0;
  for (int i = 0; i < layout.size(); ++i) {
    if (!layout.pushes(i)) return Vector2<double>::Constant(std::numeric_limits<double>::infinity());
    const double most =
        std::max(std::abs(layout[i].least), std::abs(layout[i].most)) * valueOf(body.input_max);
    force += most;
    moment += most * std::abs(layout.lever(i));
  }
  const double k = valueOf(body.k);
  return {k * force / valueOf(body.m), k * valueOf(body.l) * moment / valueOf(body.I_z)};
}

/// Longest integration step [s] between poses of this noise [m], [rad]. The error of the motion grows
/// with about the third power of the step over the craft's time scale, and with the way of its accelerations
/// in that time; it changes the log-likelihood of a minute by less than 1.
template <typename T>
double longestStep(const Dynamics<T>& dynamics, const Vector3<double>& noise) {
  // Noise with which a craft of these full accelerations is allowed kMost.
  constexpr double kPosition = 2e-4, kHeading = 2e-3, kForward = 2.0, kTurning = 40.0;  // m, rad, s
  constexpr double kMost = 4;  // steps of a simulation
  const double least = dynamics.longestStep(), scale = least / kDefaultStep;
  const Vector2<double> full = scale * scale * fullAccelerations(dynamics);
  const double slower = std::min(1.0, full(0) / kForward), calmer = std::min(1.0, full(1) / kTurning);
  const double position = kPosition * slower, heading = kHeading * calmer;
  const double relative = std::min({noise(0) / position, noise(1) / position, noise(2) / heading});
  const double step = least * std::clamp(kMost * std::cbrt(relative), 1.0, kMost);
  return std::min(step, dynamics.settling().step);
}

/// Variances that the recursion uses.
struct Random {
  using Processes = Eigen::Array<double, kProcesses, 1>;

  Processes variance, time;  ///< stationary variance, correlation time [s]
  Eigen::Array3d white;      ///< density of the white wrench: X, Y, N
  Eigen::Array3d noise;      ///< variance of measured x, y, psi
  Eigen::Array4d constant;   ///< variance of the constant states

  Random(const DisturbanceLevels& levels, const Vector3<double>& pose_noise) {
    const double room = levels.sigma_room * levels.sigma_room;
    variance << levels.sigma.array().square(), room, room;
    time << levels.time.array(), levels.time_room, levels.time_room;
    white = levels.white.array().square();
    noise << levels.position * pose_noise(0), levels.position * pose_noise(1), levels.heading * pose_noise(2);
    noise = noise.square().eval();
    constant << levels.trim.array().square(), levels.thrust * levels.thrust;
  }

  /// The wrench over a step of length h [s]. For an initial Ornstein-Uhlenbeck wrench d its end has
  /// mean left * d and variance `added`; its time average has mean `mean` * d. The average of the
  /// white wrench has variance `density`.
  struct Step {
    Processes left, mean, added;
    Eigen::Array3d density;
  };
  Step over(double h) const {
    const Processes part = h / time, left = (-part).exp();
    return {left, (1 - left) / part, variance * (1 - left.square()), white / h};
  }
};

using Response = Eigen::Matrix<double, 6, kProcesses>;
using MotionByState = Eigen::Matrix<double, 6, kN>;
using StateVector = Eigen::Matrix<double, kN, 1>;
using Gain = Eigen::Matrix<double, kN, 3>;
using StateMatrix = Eigen::Matrix<double, kN, kN>;
constexpr int kConstants = kFilterStates - kConstant;

/// Derivative of the next pose and velocity by the five processes, if these were held.
inline Response responseToProcesses(const FilterSample& s) {
  Response response;
  const Eigen::Matrix<double, 6, 2> force = s.response.leftCols<2>();
  response << s.response, s.middle.c * force.col(0) - s.middle.s * force.col(1),
      s.middle.s * force.col(0) + s.middle.c * force.col(1);
  return response;
}

/// Derivative of the next pose and velocity by the state before the step.
inline MotionByState motionByState(const FilterSample& s, const Random::Step& step) {
  MotionByState G;
  G << s.motion, responseToProcesses(s) * step.mean.matrix().asDiagonal(), s.response, s.by_thrust,
      Eigen::Matrix<double, 6, 1>::Zero();
  return G;
}

/// Propagates deviations of the filter's state, a column each, by one step.
template <class Columns>
void moveDeviation(const FilterSample& s, const Random::Step& step, Columns& x) {
  const auto next = (motionByState(s, step) * x).eval();
  x.template topRows<6>() = next;
  x.template middleRows<kProcesses>(kSlow).array().colwise() *= step.left;
}

/// Covariance of the filter's state, with itself and with the errors of sensors, which only runs with
/// inertial samples have.
struct Covariance {
  StateMatrix P = StateMatrix::Zero();
  Eigen::Matrix<double, kN, kSensorErrors> with_errors;
  Eigen::Matrix<double, kSensorErrors, kSensorErrors> errors;
  bool sensed;

  explicit Covariance(bool has_sensors = false) : sensed(has_sensors) {
    if (!sensed) return;
    with_errors.setZero();
    errors = sensorDeviations().cwiseAbs2().asDiagonal();
  }

  /// Initial covariance of a stretch. Keeps that of the constant states unless `first`.
  void start(const Random& random, bool first) {
    // Standard deviations of the first measured pose and smoothed velocity; deliberately large.
    constexpr double kPosition = 0.1, kHeading = 0.5, kSpeed = 0.3, kYawRate = 3.0;  // m, rad, s
    const Eigen::Matrix<double, kConstants, kConstants> known =
        P.block<kConstants, kConstants>(kConstant, kConstant);
    StateVector variances;
    const double position = std::max(kPosition * kPosition, 9 * random.noise.head<2>().maxCoeff());
    variances << position, position, std::max(kHeading * kHeading, 9 * random.noise(2)), kSpeed * kSpeed,
        kSpeed * kSpeed, kYawRate * kYawRate, random.variance, random.constant, 0;
    P = variances.asDiagonal();
    if (!first) P.block<kConstants, kConstants>(kConstant, kConstant) = known;
    if (sensed) with_errors.topRows<kConstant>().setZero();
  }

  /// Prediction: P = F P F' + Q, with the motion's rows G of F.
  void move(const FilterSample& s, const Random::Step& step) {
    constexpr int kMotion = kSlow, kRest = kN - kSlow;
    const MotionByState G = motionByState(s, step), top = G * P;
    const Response response = responseToProcesses(s);
    // A third of the processes' variance acts on the mean wrench of the step, half on both.
    Eigen::Array3d noise = step.added.head<3>() / 3 + step.density;
    noise.head<2>() += step.added(3) / 3;
    const Eigen::Matrix<double, 6, 6> moved =
        top * G.transpose() + s.response * noise.matrix().asDiagonal() * s.response.transpose();
    Eigen::Matrix<double, kRest, 1> left;
    left << step.left, Eigen::Array<double, kRest - kProcesses, 1>::Ones();
    Eigen::Matrix<double, 6, kRest> across = top.rightCols<kRest>() * left.asDiagonal();
    across.leftCols<kProcesses>() += response * (0.5 * step.added).matrix().asDiagonal();
    P.topLeftCorner<kMotion, kMotion>() = 0.5 * (moved + moved.transpose());
    P.topRightCorner<kMotion, kRest>() = across;
    P.bottomLeftCorner<kRest, kMotion>() = across.transpose();
    P.bottomRightCorner<kRest, kRest>().array() *= (left * left.transpose()).array();
    P.diagonal().segment<kProcesses>(kSlow).array() += step.added;
    if (sensed) moveDeviation(s, step, with_errors);
  }
};

/// Measurement update of a Kalman filter, before the cap of distances.
struct Seen {
  Gain PH;                                         ///< P H'
  Eigen::Matrix<double, kSensorErrors, 3> errors;  ///< the same of the errors of sensors, if there are any
  Eigen::Matrix3d S;                               ///< H P H' + R
};

inline Seen seenPose(const FilterSample& s, const Random& random, const Covariance& covariance) {
  Seen seen;
  seen.PH = covariance.P.leftCols<3>() * s.seen.transpose();
  seen.S = s.seen * seen.PH.topRows<3>();
  seen.S.diagonal().array() += random.noise;
  if (covariance.sensed) seen.errors = covariance.with_errors.topRows<3>().transpose() * s.seen.transpose();
  return seen;
}

/// Update by inertial means of this noise over the step that begins at sample s. They depend on the motion
/// at both its ends, so that the wrench within the step, also its white part, is in the motion at its end.
/// Covariances before and after the step. with_before: set to that of the state before it with the means.
inline Seen seenInertial(const InertialSample& i, const FilterSample& s, const Random::Step& step,
                         const Eigen::RowVector3d& noise, const Covariance& before, const Covariance& after,
                         Gain* with_before = nullptr) {
  Eigen::Matrix<double, kN, 6> across = before.P.leftCols<6>();
  moveDeviation(s, step, across);  // covariance of the state after the step with the motion before it
  Seen seen;
  seen.PH = after.P.leftCols<6>() * i.by_to.transpose() + across * i.by_from.transpose() +
            after.with_errors * i.by_errors.transpose();
  const Gain by_start =
      before.P.leftCols<6>() * i.by_from.transpose() + before.with_errors * i.by_errors.transpose();
  seen.errors = after.with_errors.topRows<6>().transpose() * i.by_to.transpose() +
                before.with_errors.topRows<6>().transpose() * i.by_from.transpose() +
                after.errors * i.by_errors.transpose();
  seen.S = i.by_to * seen.PH.topRows<6>() +
           i.by_from * (across.topRows<6>().transpose() * i.by_to.transpose() + by_start.topRows<6>()) +
           i.by_errors * seen.errors;
  seen.S.diagonal().array() += noise.transpose().array().square();
  if (with_before) {
    const MotionByState G = motionByState(s, step);
    *with_before = by_start + before.P * G.transpose() * i.by_to.transpose();
  }
  return seen;
}

/// Sets deviations to zero at the start of a stretch, except for those of the constant states.
template <class Columns>
void forgetDeviation(Columns& x) {
  x.template topRows<kConstant>().setZero();
}

/// Advances the actuators over a gap, in which the motion is not known.
inline void passGap(Simulation<Jet>& simulation, double until) {
  simulation.state() = {};
  simulation.advance(until);
}

/// Deviations of the state and, of runs with inertial samples, of the errors of sensors, a column each.
struct Deviations {
  Eigen::MatrixXd state, errors;
  Eigen::MatrixXd before;  ///< those of the motion before the last step

  Deviations(bool sensed, Eigen::Index count)
      : state(Eigen::MatrixXd::Zero(kN, count)),
        errors(Eigen::MatrixXd::Zero(sensed ? kSensorErrors : 0, count)) {}

  void move(const FilterSample& s, const Random::Step& step) {
    if (errors.rows() > 0) before = state.topRows<6>();
    moveDeviation(s, step, state);
  }
};

/// Corrects deviations by the filter's gain, given those of the innovation. Returns the deviations of the
/// whitened innovation.
inline Eigen::Matrix3Xd correctDeviation(const Correction& s, Eigen::Matrix3Xd change, Deviations& x) {
  const Eigen::Matrix3Xd white = s.whitening * change;
  if (s.capped()) {
    // The gain falls with the square of the innovation's size, so that the correction falls with
    // the size.
    const Vector3<double> e = s.whitened();
    const Eigen::RowVectorXd longer = 2 / e.squaredNorm() * (e.transpose() * white);
    change -= s.innovation * longer;
  }
  x.state += s.gain * change;
  if (x.errors.rows() > 0) x.errors += s.sensor_gain * change;
  return white;
}

/// By a pose. `seen`: changes of the measured pose apart from those by the state.
inline Eigen::Matrix3Xd correctDeviation(const FilterSample& s, const Eigen::Matrix3Xd& seen, Deviations& x) {
  return correctDeviation(static_cast<const Correction&>(s), -seen - s.seen * x.state.topRows<3>(), x);
}

/// By inertial means. `seen` likewise.
inline Eigen::Matrix3Xd correctDeviation(const InertialSample& s, const Eigen::Matrix3Xd& seen,
                                         Deviations& x) {
  return correctDeviation(
      static_cast<const Correction&>(s),
      -seen - s.by_to * x.state.topRows<6>() - s.by_from * x.before - s.by_errors * x.errors, x);
}

}  // namespace ground::detail
