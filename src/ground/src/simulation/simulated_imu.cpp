#include "ground/simulation/simulated_imu.h"

#include <cmath>

namespace ground {
namespace {

constexpr double kDegrees = M_PI / 180;
constexpr double kTurnUnit = kDegrees / 16.4,
                 kPushUnit = 9.80665 / SimulatedImu::kGravity;    // [rad/s], [m/s^2]
constexpr double kTurnNoise = 0.1 * kDegrees, kPushNoise = 0.05;  // of a sample
constexpr double kTurnBias = 0.5 * kDegrees, kPushBias = 0.1;     // of a craft
constexpr double kImuMounting = 2 * kDegrees, kImuPlace = 0.015;  // [rad], [m]

}  // namespace

SimulatedImu::SimulatedImu(unsigned seed) : random_(seed) {
  turn_bias_ = normal(kTurnBias);
  for (int i = 0; i < 2; ++i) {
    bias_(i) = normal(kPushBias);
    place_(i) = normal(kImuPlace);
  }
  angle_ = normal(kImuMounting);
}

InertialMounting SimulatedImu::mounting() const {
  return {kTurnUnit, kPushUnit, angle_, place_.x(), place_.y()};
}

ImuSample SimulatedImu::sample(const RigidState<double>& state, const Vector3<double>& nu_dot) {
  const double r = state.nu.z(), turn = nu_dot.z();
  const Vector2<double> force(nu_dot.x() - r * state.nu.y() - turn * place_.y() - r * r * place_.x(),
                              nu_dot.y() + r * state.nu.x() + turn * place_.x() - r * r * place_.y());
  const Vector2<double> seen = Rotation<double>(angle_).toBody(force) + bias_;
  ImuSample sample;
  sample.yaw_rate = static_cast<int>(std::lround((r + turn_bias_ + normal(kTurnNoise)) / kTurnUnit));
  for (int i = 0; i < 2; ++i)
    sample.acceleration[static_cast<std::size_t>(i)] =
        static_cast<int>(std::lround((seen(i) + normal(kPushNoise)) / kPushUnit));
  return sample;
}

}  // namespace ground
