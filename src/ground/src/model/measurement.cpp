#include "ground/model/measurement.h"

#include <Eigen/LU>
#include <stdexcept>

namespace ground {

RigidState<double> stateSeenAs(const Dynamics<Jet>& dynamics, const Measurement<double>& measured) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  RigidState<double> state{measured.eta, measured.nu};
  for (int round = 0; round < 10; ++round) {
    RigidState<Jet> seeded;
    for (int i = 0; i < 3; ++i) {
      seeded.eta(i) = Jet(state.eta(i), i);
      seeded.nu(i) = Jet(state.nu(i), 3 + i);
    }
    const Measurement<Jet> seen = dynamics.measure(seeded);
    Vector6 missing;
    Eigen::Matrix<double, 6, 6> slope;
    for (int i = 0; i < 3; ++i) {
      missing(i) = measured.eta(i) - seen.eta(i).a;
      missing(3 + i) = measured.nu(i) - seen.nu(i).a;
      slope.row(i) = seen.eta(i).v.head<6>();
      slope.row(3 + i) = seen.nu(i).v.head<6>();
    }
    const Vector6 step = slope.partialPivLu().solve(missing);
    if (!step.allFinite()) break;
    state.eta += step.head<3>();
    state.nu += step.tail<3>();
    if (step.cwiseAbs().maxCoeff() < 1e-10) return state;
  }
  throw std::runtime_error(
      "no state of the model has the recorded pose and velocity as its "
      "measurement");
}

}  // namespace ground
