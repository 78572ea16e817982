#include "ground/control/tracking_law.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ground {
namespace {

/// Smallest useful force and moment of all thrusters, relative to one at its lever.
constexpr double kMinShare = 0.01;
constexpr double kSteeredSway = 1e-4;  ///< weight of the force to the side of a craft with angles

/// A rudder's force to the side comes with its moment: the law, which commands no such force, takes it.
Allocation allocationOf(const Model& model) {
  const double sway = model.thrusters->steers() ? kSteeredSway : 1;
  return Allocation(model, {1, sway, 1});
}

/// Why a craft's thrusters cannot follow the law; empty if they can.
std::string steeringProblem(const Model& model) {
  const Allocation allocation = allocationOf(model);
  const auto most = [&](const Vector3<double>& along) { return along.dot(allocation.most(along).wrench); };
  const char* missing = nullptr;
  if (most({0, 0, -1}) < kMinShare * model.body.l * model.body.k) missing = "turn it to port";
  if (most({0, 0, 1}) < kMinShare * model.body.l * model.body.k) missing = "turn it to starboard";
  if (most({1, 0, 0}) < kMinShare * model.body.k) missing = "push it forward";
  if (!missing) return "";
  return std::string("TrajectoryTracking cannot drive this craft: its thrusters (") +
         model.thrusters->names() + ") do not " + missing + "; use ModelPredictive";
}

}  // namespace

EffectUse BacksteppingControl::effectUse(const Model& model) {
  EffectUse use = bodyOnlyUse(model);
  if (use.refusal.empty()) use.refusal = steeringProblem(model);
  return use;
}

BacksteppingControl::BacksteppingControl(const Model& model, const TrackingGains& gains)
    : body_(model.body),
      allocation_(allocationOf(model)),
      least_force_(allocation_.most({-1, 0, 0}).wrench.x()),
      most_force_(allocation_.most({1, 0, 0}).wrench.x()),
      gains_(gains) {
  for (const std::string& wrong : {gains.validate(), effectUse(model).refusal})
    if (!wrong.empty()) throw std::invalid_argument(wrong);
}

BacksteppingControl::Output BacksteppingControl::run(const RigidState<double>& state,
                                                     const ReferencePoint& reference) const {
  using Vector = Vector2<double>;
  using Matrix = Eigen::Matrix2d;
  const double m = body_.m, d = body_.Y_v, k_e = gains_.k_e, r = state.nu.z();
  const Vector v = state.nu.head<2>(), delta(gains_.delta_1, gains_.delta_2);
  const Matrix K = Vector(gains_.k_phi_1, gains_.k_phi_2).asDiagonal();
  Matrix S, B;
  S << 0, -r, r, 0;
  B << 1, m * delta.y(), 0, -m * delta.x();
  const Matrix B_inverse = B.inverse();

  const double psi = state.eta.z();
  const Vector p_error = state.eta.head<2>() - reference.p;
  const Vector e = worldToBody<double>(psi, p_error);
  const Vector w_d = worldToBody<double>(psi, reference.p_dot);
  const Vector a_d = worldToBody<double>(psi, reference.p_ddot);
  const Vector j_d = worldToBody<double>(psi, reference.p_dddot);

  const Vector e_dot = -S * e + v - w_d;
  const Vector z1 = v - w_d + k_e / m * e;
  const Vector phi = z1 - delta;
  const Vector h = -d * w_d + k_e / m * d * e - m * a_d + k_e * z1 - k_e * k_e / m * e;

  Output out;
  out.error = e;
  out.alpha = -B_inverse * (h - d * delta + e / m + K * phi / m);
  out.force = out.alpha.x();

  // The acceleration by the saturated force. Only its sway component affects u_2.
  const double applied = std::clamp(out.force, least_force_, most_force_);
  const Vector v_dot = Vector(applied / m, 0) - S * v - d / m * v;
  const Vector z1_dot = v_dot + S * w_d - a_d + k_e / m * e_dot;
  const Vector h_dot = -d * (-S * w_d + a_d) + k_e / m * d * e_dot - m * (-S * a_d + j_d) + k_e * z1_dot -
                       k_e * k_e / m * e_dot;
  out.alpha_dot = -B_inverse * (h_dot + e_dot / m + K * z1_dot / m);

  const double z2 = r - out.alpha.y();
  out.torque =
      -m * B.col(1).dot(phi) + body_.N_r * out.alpha.y() + body_.I_z * out.alpha_dot.y() - gains_.k_z * z2;
  const Allocation::Output given = allocation_.run({out.force, 0, out.torque});
  out.wanted = given.wanted;
  out.inputs = given.inputs;
  return out;
}

}  // namespace ground
