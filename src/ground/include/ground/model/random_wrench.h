#pragma once

#include <cmath>

#include "ground/model/simulation.h"

namespace ground {

/// Exact step of an Ornstein-Uhlenbeck process: next = left * now + fresh * (a standard normal number).
struct OrnsteinUhlenbeckStep {
  /// sigma: stationary standard deviation; time: of correlation [s], 0: independent from step to step.
  OrnsteinUhlenbeckStep(double sigma, double time, double step)
      : left(time > 0 ? std::exp(-step / time) : 0), fresh(sigma * std::sqrt(1 - left * left)) {}

  double left, fresh;
};

/// Advances a simulation to a time while a wrench of these impulses acts, in the body [N s, N s, N m s] and
/// in the room [N s]. Half of them acts before the step, half after it.
inline void advancePushed(Simulation<double>& simulation, double until, const Matrix3<double>& mobility,
                          const Vector3<double>& impulse, const Vector2<double>& in_room) {
  const auto push = [&] {
    RigidState<double>& at = simulation.state();
    Vector3<double> sum = impulse;
    sum.head<2>() += worldToBody(at.eta.z(), in_room);
    at.nu += 0.5 * mobility * sum;
  };
  push();
  simulation.advance(until);
  push();
}

}  // namespace ground
