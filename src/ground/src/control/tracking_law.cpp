#include "ground/control/tracking_law.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ground {

std::string TrackingGains::validate() const {
  if (!(k_e > 0)) return "k_e must be positive";
  if (!(k_z > 0)) return "k_z must be positive";
  if (!(k_phi_1 > 0) || !(k_phi_2 > 0)) return "k_phi_1 and k_phi_2 must be positive";
  if (!(delta_1 != 0) || !std::isfinite(delta_1)) return "delta_1 must not be 0";
  if (!std::isfinite(delta_2)) return "delta_2 must be finite";
  return "";
}

TrackingLaw::Output TrackingLaw::run(const RigidState<double>& state,
                                     const ReferencePoint& reference,
                                     const TrackingGains& gains) const {
  using Vector = Vector2<double>;
  using Matrix = Eigen::Matrix2d;
  const double m = body_.m, d = body_.Y_v, k_e = gains.k_e, r = state.nu.z();
  const Vector v = state.nu.head<2>(), delta(gains.delta_1, gains.delta_2);
  const Matrix K = Vector(gains.k_phi_1, gains.k_phi_2).asDiagonal();
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

  // The acceleration with the force that the thrusters can give; only its sway part reaches u_2.
  const double applied = std::clamp(out.force, 0.0, 2 * body_.k * body_.input_max);
  const Vector v_dot = Vector(applied / m, 0) - S * v - d / m * v;
  const Vector z1_dot = v_dot + S * w_d - a_d + k_e / m * e_dot;
  const Vector h_dot = -d * (-S * w_d + a_d) + k_e / m * d * e_dot - m * (-S * a_d + j_d) +
                       k_e * z1_dot - k_e * k_e / m * e_dot;
  out.alpha_dot = -B_inverse * (h_dot + e_dot / m + K * z1_dot / m);

  const double z2 = r - out.alpha.y();
  out.torque = -m * B.col(1).dot(phi) + body_.N_r * out.alpha.y() + body_.I_z * out.alpha_dot.y() -
               gains.k_z * z2;
  out.wanted =
      Vector(out.force + out.torque / body_.l, out.force - out.torque / body_.l) / (2 * body_.k);
  out.inputs = out.wanted.cwiseMax(0.0).cwiseMin(body_.input_max);
  return out;
}

BacksteppingControl::BacksteppingControl(const Model& model, const TrackingGains& gains)
    : law_(model.body), gains_(gains) {
  const std::string refusal = effectUse(model).refusal;
  if (!refusal.empty()) throw std::invalid_argument(refusal);
}

}  // namespace ground
