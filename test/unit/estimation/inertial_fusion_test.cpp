// Velocities from poses and the craft's gyro and accelerometer, also with sensors that lie.
#include "ground/estimation/inertial_fusion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "ground/estimation/velocity_estimator.h"

namespace ground {
namespace inertial_fusion_test {

constexpr double kStep = 1e-3, kEnd = 20;  // of the true motion [s]
constexpr int kPose = 10, kSample = 5;     // steps between poses (100 Hz), and samples (200 Hz)
constexpr double kPosition = 3e-4, kHeading = 5e-3;

struct Sample {
  double gyro;
  Vector2<double> acceleration;
};
/// What becomes of a sample at a time [s]; false: it is lost.
using Fault = std::function<bool(double, Sample&)>;

bool none(double, Sample&) { return true; }

/// How the sensor measures: in degrees and g, turned, off the markers, late.
InertialMounting mounted() { return {M_PI / 180, 9.81, 0.1, 0.02, -0.01, 5e-3}; }

struct Result {
  Vector3<double> error = Vector3<double>::Zero();  ///< rms of u, v, r from 3 s on, or from `from` on
  std::vector<bool> valid;
  int used = 0;  ///< poses at which sensors counted
  std::string status;
};

/// A craft whose thrusters switch at random, seen by poses and by its sensors.
Result fly(const InertialMounting& believed, const Fault& fault = none, double from = 3) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  VelocityEstimator estimator{EstimatorParams()};
  estimator.inertial().setMounting(believed);
  const InertialMounting truth = mounted();
  const Rotation<double> turned(truth.mounting);
  RigidState<double> state;
  Vector3<double> thrust = Vector3<double>::Zero(), wanted = thrust;
  Result result;
  int counted = 0;
  for (int i = 0; i * kStep < kEnd; ++i) {
    const double t = i * kStep, r = state.nu.z();
    if (i % 100 == 0) wanted << (normal(random) > 0 ? 1.5 : 0), 0, (normal(random) > 0 ? 10 : -10);
    thrust += kStep / 0.05 * (wanted - thrust);  // motors lag
    const Vector3<double> push = thrust - Vector3<double>(0.5 * state.nu.x(), 0.8 * state.nu.y(), 2 * r);
    if (i % kSample == 0) {
      const Vector2<double> force(push.x() - push.z() * truth.starboard - r * r * truth.ahead,
                                  push.y() + push.z() * truth.ahead - r * r * truth.starboard);
      Sample sample{(r + 0.01 + 1.7e-3 * normal(random)) / truth.gyro_scale,
                    (turned.toBody(force) +
                     Vector2<double>(0.1 + 0.05 * normal(random), -0.08 + 0.05 * normal(random))) /
                        truth.acceleration_scale};
      if (fault(t, sample)) estimator.inertial().sample(t + truth.delay, sample.gyro, sample.acceleration);
    }
    if (i % kPose == 0 && i > 0) {
      const Vector3<double> noise(kPosition * normal(random), kPosition * normal(random),
                                  kHeading * normal(random));
      // With a pose come the samples that left before it.
      const StateEstimate& estimate = estimator.update(t, state.eta + noise);
      result.valid.push_back(estimate.valid);
      result.used += estimator.inertial().agrees();
      if (t > from) {
        result.error += (estimate.nu - state.nu).cwiseAbs2();
        ++counted;
      }
    }
    // (2.3), (2.4) with forces over mass: u' = X + v r, v' = Y - u r
    const Vector2<double> world = bodyToWorld<double>(state.eta.z(), state.nu.head<2>());
    state.eta += kStep * Vector3<double>(world.x(), world.y(), r);
    state.nu += kStep * Vector3<double>(push.x() + state.nu.y() * r, push.y() - state.nu.x() * r, push.z());
  }
  result.error = (result.error / counted).cwiseSqrt();
  result.status = estimator.inertial().status();
  return result;
}

class Fusion : public testing::Test {
 protected:
  /// Neither worse than poses alone, nor valid when these are not.
  void expectAsWithout(const Result& found, double factor = 1.1) const {
    EXPECT_EQ(found.valid, alone_.valid);
    for (int i = 0; i < 3; ++i) EXPECT_LT(found.error(i), factor * alone_.error(i)) << i;
  }

  const Result alone_ = fly(InertialMounting());
};

TEST_F(Fusion, SensorsMakeVelocitiesThreeTimesAsGood) {
  const Result found = fly(mounted());
  EXPECT_EQ(found.valid, alone_.valid);
  EXPECT_EQ(found.status, "");
  for (int i = 0; i < 3; ++i) EXPECT_LT(found.error(i), alone_.error(i) / 3) << i << " " << alone_.error(i);
}

TEST_F(Fusion, SensorsMayBeSlowerThanPoses) {
  int number = 0;
  const auto slower = [&](double, Sample&) { return number++ % 4 == 0; };  // 50 Hz
  const Result found = fly(mounted(), slower);
  EXPECT_EQ(found.valid, alone_.valid);
  EXPECT_EQ(found.status, "");
  EXPECT_GT(found.used, 1500);
  EXPECT_LT(found.error(2), alone_.error(2) / 1.5);
}

TEST_F(Fusion, AGyroAloneMakesTheYawRateBetter) {
  InertialMounting gyro = mounted();
  gyro.acceleration_scale = 0;
  const Result found = fly(gyro);
  EXPECT_LT(found.error(2), alone_.error(2) / 3);
  expectAsWithout(found);
}

TEST_F(Fusion, UnmountedSensorsChangeNothing) {
  const Result noise = fly(InertialMounting(), [](double t, Sample& s) {
    s.gyro = 1e6 * std::sin(t);
    return true;
  });
  EXPECT_EQ(noise.error, alone_.error);
  EXPECT_EQ(noise.used, 0);
}

TEST_F(Fusion, ASensorThatStopsIsMissedAtOnce) {
  const Result found = fly(
      mounted(), [](double t, Sample&) { return t < 10; }, 10.1);
  const Result alone = fly(InertialMounting(), none, 10.1);
  EXPECT_LT((found.error - alone.error).norm(), 1e-12);
  EXPECT_NE(found.status, "");
}

TEST_F(Fusion, NumbersThatAreNotFiniteDoNotCount) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const Result found = fly(mounted(), [](double t, Sample& s) {
    if (t > 5) s.gyro = kNan;
    if (t > 10) s.acceleration.x() = std::numeric_limits<double>::infinity();
    return true;
  });
  EXPECT_NE(found.status, "");
  expectAsWithout(found);
}

TEST_F(Fusion, NumbersThatOverflowAreRejected) {
  const Result found = fly(mounted(), [](double t, Sample& s) {
    if (t > 5 && t < 5.1) s.acceleration.x() = 1e300;
    if (t > 10 && t < 10.1) s.gyro = -1e300;
    return true;
  });
  EXPECT_EQ(found.status, "");
  expectAsWithout(found);
}

TEST_F(Fusion, AScaleThatIsHalfWrongMakesNothingWorse) {
  for (const double factor : {0.5, 1.5}) {
    InertialMounting wrong = mounted();
    wrong.acceleration_scale *= factor;
    expectAsWithout(fly(wrong));
  }
}

TEST_F(Fusion, AGyroThatSticksIsRejected) {
  const Result found = fly(mounted(), [](double t, Sample& s) {
    if (t > 8) s.gyro = 57;
    return true;
  });
  EXPECT_LT(found.used, 0.75 * alone_.valid.size());
  expectAsWithout(found, 1.5);
}

TEST_F(Fusion, WrongScalesAreRejected) {
  InertialMounting wrong = mounted();
  wrong.gyro_scale *= -1.5;
  wrong.acceleration_scale *= 3;
  const Result found = fly(wrong);
  EXPECT_LT(found.used, 0.05 * alone_.valid.size());
  expectAsWithout(found, 1.5);
}

TEST_F(Fusion, GarbageNeverMakesAStateValid) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Result found = fly(mounted(), [&](double, Sample& s) {
    s.gyro = 1e4 * normal(random);
    s.acceleration << 1e3 * normal(random), 1e9;
    return true;
  });
  EXPECT_EQ(found.used, 0);
  expectAsWithout(found, 1 + 1e-12);
}

}  // namespace inertial_fusion_test
}  // namespace ground
