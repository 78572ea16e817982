// The stages of a Runge-Kutta step of the rigid body.
#pragma once

#include "ground/model/dynamics.h"

namespace ground {

// raw() gives access to the vector register of a value, Slices to those of its derivatives. A slice
// is one Vec8: all eight derivatives of a Jet, or one derivative of a LanesJet in eight lanes.
GROUND_INLINE double raw(const double& x) { return x; }
GROUND_INLINE const Vec8& raw(const Lanes& x) { return x.x; }
GROUND_INLINE double& raw(double& x) { return x; }
GROUND_INLINE Vec8& raw(Lanes& x) { return x.x; }

template <typename V>
struct RawOf {
  using type = double;
};
template <>
struct RawOf<Lanes> {
  using type = Vec8;
};

template <typename T>
struct Slices {
  static constexpr int kCount = 0;
};
template <>
struct Slices<Jet> {
  static constexpr int kCount = 1;
  static GROUND_INLINE Vec8& of(Jet& x, int) { return x.v.x; }
  static GROUND_INLINE const Vec8& of(const Jet& x, int) { return x.v.x; }
};
template <int N>
struct Slices<Dual<Lanes, N>> {
  static constexpr int kCount = N;
  static GROUND_INLINE Vec8& of(Dual<Lanes, N>& x, int d) { return x.v.x[d].x; }
  static GROUND_INLINE const Vec8& of(const Dual<Lanes, N>& x, int d) { return x.v.x[d].x; }
};

/// A Runge-Kutta step of the rigid body: the state at the beginning of the step, at the current
/// stage and at the end. Each stage computes rates k_i and moves on,
///
///     end += share * k_i,   next stage = begin + to * k_i
///
/// with (share, to) = (h/6, h/2), (h/3, h/2), (h/3, h), (h/6, -) in classical RK4. The derivatives
/// go through a stage slice by slice, so that they stay in registers; this is several times faster
/// than Dual arithmetic.
template <typename T, bool kPose, typename H>
struct Stages {
  using V = ValueOf<T>;
  using Raw = typename RawOf<V>::type;

  const Vector3<T>& damping;  ///< X_u/m, Y_v/m, N_r/I_z
  const int directions;       ///< derivatives in use
  /// State at the end of the step: by value if it may stay in registers.
  std::conditional_t<(Slices<T>::kCount > 1), RigidState<T>&, RigidState<T>> next;
  Vector3<T> eta, nu, at_eta, at_nu;
  Rotation<T> heading;
  V first_c, first_s;  ///< cosine and sine of the heading at the beginning of the step
  Raw c, s;            ///< those of the current stage's heading
  Rotation<V>* known;  ///< of the heading at the beginning of the step, if it is known

  Stages(const Vector3<T>& rates, int derivatives, RigidState<T>& state, Rotation<V>* known_heading)
      : damping(rates), directions(derivatives), next(state), known(known_heading) {}

  void begin(bool uses_pose) {
    nu = next.nu;
    if (kPose || uses_pose) eta = next.eta;
    // If the pose is constant, only effects need the heading.
    if (!kPose && uses_pose)
      heading = known ? Rotation<T>(eta.z(), known->c, known->s) : Rotation<T>(eta.z());
  }

  /// Computes the heading of the current stage.
  template <bool kFirst>
  GROUND_INLINE void turn(bool uses_pose) {
    const T& psi = kFirst ? eta.z() : at_eta.z();
    V cosine, sine;
    if (kFirst) {
      if (known) {
        first_c = known->c;
        first_s = known->s;
      } else {
        cosSin(valueOf(psi), first_c, first_s);
      }
      cosine = first_c;
      sine = first_s;
    } else {
      cosSinBeside(first_c, first_s, V(valueOf(psi) - valueOf(eta.z())), valueOf(psi), cosine, sine);
    }
    c = raw(cosine);
    s = raw(sine);
    if (uses_pose) heading = Rotation<T>(psi, cosine, sine);
  }

  /// Moves the known heading to the end of the step.
  GROUND_INLINE void end() {
    if (!kPose || !known) return;
    const V& psi = valueOf(next.eta.z());
    cosSinBeside(first_c, first_s, V(psi - valueOf(eta.z())), psi, known->c, known->s);
  }

  /// Moves by the rates of the rigid body with thrust and linear damping (kRigid) plus `more`
  /// (kMore), as described above.
  template <bool kFirst, bool kLast, bool kRigid, bool kMore>
  GROUND_INLINE void move(const H& share, const H& to, const T& surge, const T& yaw,
                          const Vector3<T>& more) {
    const Vector3<T>& at = kFirst ? nu : at_nu;
    Raw rate[3] = {}, drift[3] = {};
    if (kRigid) setRate(at, raw(valueOf(surge)), raw(valueOf(yaw)), rate);
    if (kMore)
      for (int i = 0; i < 3; ++i) rate[i] += raw(valueOf(more(i)));
    if (kPose) setDrift(at, drift);
    using Of = Slices<T>;
    if constexpr (Of::kCount > 0)
      for (int d = 0; d < (Of::kCount > 1 ? directions : Of::kCount); ++d)
        moveSlice<kFirst, kLast, kRigid, kMore>(d, share, to, surge, yaw, more, rate, drift);
    const Raw by = raw(valueOf(share)), along = raw(valueOf(to));
    for (int i = 0; i < 3; ++i) {
      raw(valueIn(next.nu(i))) += by * rate[i];
      if (!kLast) raw(valueIn(at_nu(i))) = raw(valueOf(nu(i))) + along * rate[i];
      if (!kPose) continue;
      raw(valueIn(next.eta(i))) += by * drift[i];
      if (!kLast) raw(valueIn(at_eta(i))) = raw(valueOf(eta(i))) + along * drift[i];
    }
  }

 private:
  /// Rates of the rigid body with thrust and linear damping.
  GROUND_INLINE void setRate(const Vector3<T>& at, const Raw& surge, const Raw& yaw, Raw rate[3]) {
    const Raw u = raw(valueOf(at(0))), v = raw(valueOf(at(1))), r = raw(valueOf(at(2)));
    rate[0] = r * v + (surge - raw(valueOf(damping(0))) * u);
    rate[1] = -(r * u + raw(valueOf(damping(1))) * v);
    rate[2] = yaw - raw(valueOf(damping(2))) * r;
  }

  GROUND_INLINE void setDrift(const Vector3<T>& at, Raw drift[3]) {
    const Raw u = raw(valueOf(at(0))), v = raw(valueOf(at(1)));
    drift[0] = c * u - s * v;
    drift[1] = s * u + c * v;
    drift[2] = raw(valueOf(at(2)));
  }

  /// move() for slice d of the derivatives.
  template <bool kFirst, bool kLast, bool kRigid, bool kMore>
  GROUND_INLINE void moveSlice(int d, const H& share, const H& to, const T& surge, const T& yaw,
                               const Vector3<T>& more, const Raw rate[3], const Raw drift[3]) {
    using Of = Slices<T>;
    const Vector3<T>& at = kFirst ? nu : at_nu;
    const Raw u = raw(valueOf(at(0))), v = raw(valueOf(at(1))), r = raw(valueOf(at(2)));
    const Raw by = raw(valueOf(share)), along = raw(valueOf(to));
    const Vec8 du = Of::of(at(0), d), dv = Of::of(at(1), d), dr = Of::of(at(2), d);
    Vec8 drate[3] = {};
    if (kRigid) {
      const Raw d0 = raw(valueOf(damping(0))), d1 = raw(valueOf(damping(1))),
                d2 = raw(valueOf(damping(2)));
      drate[0] = r * dv + v * dr + (Of::of(surge, d) - d0 * du - u * Of::of(damping(0), d));
      drate[1] = -(r * du + u * dr + d1 * dv + v * Of::of(damping(1), d));
      drate[2] = Of::of(yaw, d) - d2 * dr - r * Of::of(damping(2), d);
    }
    if (kMore)
      for (int i = 0; i < 3; ++i) drate[i] += Of::of(more(i), d);
    for (int i = 0; i < 3; ++i)
      advance<kLast>(d, share, to, by, along, rate[i], drate[i], nu(i), next.nu(i), at_nu(i));
    if (!kPose) return;
    const Vec8 dpsi = Of::of(kFirst ? eta.z() : at_eta.z(), d);
    const Vec8 ddrift[3] = {c * du - s * dv - drift[1] * dpsi, s * du + c * dv + drift[0] * dpsi,
                            dr};
    for (int i = 0; i < 3; ++i)
      advance<kLast>(d, share, to, by, along, drift[i], ddrift[i], eta(i), next.eta(i), at_eta(i));
  }

  template <bool kLast>
  static GROUND_INLINE void advance(int d, const H& share, const H& to, const Raw& by,
                                    const Raw& along, const Raw& rate, const Vec8& drate,
                                    const T& begin, T& end, T& stage) {
    using Of = Slices<T>;
    Vec8 change = by * drate, way = along * drate;
    if constexpr (!std::is_same_v<H, V>) {
      change += Of::of(share, d) * rate;
      way += Of::of(to, d) * rate;
    }
    Of::of(end, d) += change;
    if (!kLast) Of::of(stage, d) = Of::of(begin, d) + way;
  }
};

}  // namespace ground
