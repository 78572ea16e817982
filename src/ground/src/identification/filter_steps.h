// Steps of the disturbance filter's recursion: covariances, gains, deviations of the state.
#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "disturbance_filter.h"
#include "ground/model/measurement.h"
#include "ground/model/simulation.h"

namespace ground::detail {

constexpr int kN = kFilterStates;
/// The Ornstein-Uhlenbeck process of a state; both components of the force in the room have the
/// levels of process 3.
constexpr int processOf(int state) { return state < kRoom ? state - kSlow : 3; }
/// Longest integration step [s] between poses of this noise [m], [rad]. The error of the motion grows
/// with about the third power of the step; it changes the log-likelihood of a minute by less than 1.
template <typename T>
double longestStep(const Dynamics<T>& dynamics, const Vector3<double>& noise) {
  constexpr double kPosition = 2e-4, kHeading = 2e-3;  // noise with which kMost is allowed
  constexpr double kLeast = 0.005, kMost = 0.02;
  const double relative = std::min({noise(0) / kPosition, noise(1) / kPosition, noise(2) / kHeading});
  const double step = std::clamp(kMost * std::cbrt(relative), kLeast, kMost);
  return std::min(step, dynamics.settling().step);
}
// Standard deviations of a stretch's first state, measured pose and smoothed velocity; deliberately
// large. [m], [rad], [m/s], [rad/s]
constexpr double kFirstPosition = 0.1, kFirstHeading = 0.5, kFirstSpeed = 0.3, kFirstYawRate = 3.0;

/// Variances that the recursion uses, for one set of levels (double) or eight sets (Lanes).
template <typename V>
struct Random {
  /// Stationary variance and correlation time: X, Y, N, both components of the force in the room.
  V variance[4], time[4];
  V white[3];                        ///< density: X, Y, N
  V noise[3];                        ///< variance of measured x, y, psi
  V constant[4];                     ///< variance of the constant states

  /// The wrench over a step of length h [s]. For an initial Ornstein-Uhlenbeck wrench d its end has
  /// mean left * d and variance `added`; its time average has mean `mean` * d. The average of the
  /// white wrench has variance `density`.
  struct Step {
    V left[4], mean[4], added[4], density[3];
  };
  Step over(double h) const {
    Step step;
    for (int i = 0; i < 4; ++i) {
      using std::exp;
      const V part = V(h) / time[i];
      step.left[i] = exp(-part);
      step.mean[i] = (1.0 - step.left[i]) / part;
      step.added[i] = variance[i] * (1.0 - step.left[i] * step.left[i]);
    }
    for (int i = 0; i < 3; ++i) step.density[i] = white[i] * V(1 / h);
    return step;
  }
};

inline Random<double> randomOf(const DisturbanceLevels& levels, const Vector3<double>& noise) {
  Random<double> random;
  const double factor[3] = {levels.position, levels.position, levels.heading};
  for (int i = 0; i < 3; ++i) {
    random.variance[i] = levels.sigma(i) * levels.sigma(i);
    random.time[i] = levels.time(i);
    random.white[i] = levels.white(i) * levels.white(i);
    random.noise[i] = std::pow(factor[i] * noise(i), 2);
    random.constant[i] = levels.trim(i) * levels.trim(i);
  }
  random.variance[3] = levels.sigma_room * levels.sigma_room;
  random.time[3] = levels.time_room;
  random.constant[3] = levels.thrust * levels.thrust;
  return random;
}

/// A row of numbers for each state: one covariance (V = double) has eight columns in a register,
/// filled up with zeros; eight covariances (V = Lanes) have one column in a register.
template <typename V>
struct Row {
  static constexpr bool kWide = std::is_same_v<V, double>;
  static constexpr int kParts = kWide ? kFilterRow / Lanes::kCount : kN;

  Lanes part[kParts];

  V& operator[](int i) {
    if constexpr (kWide) return reinterpret_cast<double*>(part)[i];
    else return part[i];
  }
  const V& operator[](int i) const { return const_cast<Row&>(*this)[i]; }
};

/// Covariance of the filter's state, a full symmetric matrix.
template <typename V>
struct Covariance {
  Row<V> P[kN] = {};

  /// Initial covariance of a stretch. Keeps that of the constant states unless `first`.
  void start(const Random<V>& random, bool first) {
    const int known = first ? kN : kConstant;
    for (int i = 0; i < kN; ++i)
      for (int j = 0; j < kN; ++j)
        if (i < known || j < known) P[i][j] = V(0.0);
    const double sigma[6] = {kFirstPosition, kFirstPosition, kFirstHeading,
                             kFirstSpeed,    kFirstSpeed,    kFirstYawRate};
    for (int i = 0; i < 6; ++i) P[i][i] = V(sigma[i] * sigma[i]);
    for (int i = kSlow; i < kConstant; ++i) P[i][i] = random.variance[processOf(i)];
    for (int i = kConstant; first && i < kN; ++i) P[i][i] = random.constant[i - kConstant];
  }

  /// Computes H P and S = H P H' + R.
  void see(const FilterSample& s, const Random<V>& random, Row<V> HP[3], V S[3][3]) const {
    for (int a = 0; a < 3; ++a)
      for (int j = 0; j < kParts; ++j)
        HP[a].part[j] = Lanes(s.seen[a][0]) * P[0].part[j] + Lanes(s.seen[a][1]) * P[1].part[j] +
                        Lanes(s.seen[a][2]) * P[2].part[j];
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        const V sum = V(s.seen[a][0]) * HP[b][0] + V(s.seen[a][1]) * HP[b][1] +
                      V(s.seen[a][2]) * HP[b][2];
        S[a][b] = a == b ? sum + random.noise[a] : sum;
      }
  }

  /// Subtracts the symmetric matrix A' B. For V = double, A and B have to be the same: then the
  /// covariance stays exactly symmetric.
  void subtract(const Row<V> A[3], const Row<V> B[3]) {
    for (int i = 0; i < kN; ++i) {
      for (int j = Row<V>::kWide ? 0 : i; j < kParts; ++j)
        P[i].part[j] -= Lanes(A[0][i]) * B[0].part[j] + Lanes(A[1][i]) * B[1].part[j] +
                        Lanes(A[2][i]) * B[2].part[j];
      if constexpr (!Row<V>::kWide)
        for (int j = i + 1; j < kN; ++j) P[j][i] = P[i][j];
    }
  }

  void move(const FilterSample& s, const typename Random<V>::Step& step) {
    Row<V> top[6];
    moveOnce(s, step, top);
    moveMotion(s, step, top);
    moveWrench(s, step, top);
  }

 private:
  static constexpr int kParts = Row<V>::kParts;

  /// Covariance of the next pose and velocity with the state before the step.
  void moveOnce(const FilterSample& s, const typename Random<V>::Step& step, Row<V> top[6]) const {
    for (int j = 0; j < kParts; ++j) {
      Lanes push[3];  // covariance of the wrench that acts with the state
      for (int i = 0; i < 3; ++i)
        push[i] = Lanes(step.mean[i]) * P[kSlow + i].part[j] + P[kConstant + i].part[j];
      const Lanes c(s.middle.c * step.mean[3]), sine(s.middle.s * step.mean[3]);
      push[0] += c * P[kRoom].part[j] + sine * P[kRoom + 1].part[j];
      push[1] += c * P[kRoom + 1].part[j] - sine * P[kRoom].part[j];
      for (int i = 0; i < 6; ++i) {
        Lanes sum = Lanes(s.by_thrust[i]) * P[kThrust].part[j];
        for (int k = 0; k < 6; ++k) sum += Lanes(s.motion[i][k]) * P[k].part[j];
        for (int k = 0; k < 3; ++k) sum += Lanes(s.response[i][k]) * push[k];
        top[i].part[j] = sum;
      }
    }
  }

  /// Covariance of the next pose and velocity, with the process noise of the step.
  void moveMotion(const FilterSample& s, const typename Random<V>::Step& step,
                  const Row<V> top[6]) {
    V pushed[6][3];  // covariance with the acting wrench, including a third of its noise
    V noise[3];
    for (int k = 0; k < 3; ++k) noise[k] = step.added[k] * V(1.0 / 3) + step.density[k];
    for (int k = 0; k < 2; ++k) noise[k] += step.added[3] * V(1.0 / 3);  // the same in all frames
    const V c = step.mean[3] * V(s.middle.c), sine = step.mean[3] * V(s.middle.s);
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < 3; ++k)
        pushed[i][k] = (step.mean[k] * top[i][kSlow + k] + top[i][kConstant + k]) +
                       V(s.response[i][k]) * noise[k];
      pushed[i][0] += c * top[i][kRoom] + sine * top[i][kRoom + 1];
      pushed[i][1] += c * top[i][kRoom + 1] - sine * top[i][kRoom];
    }
    if constexpr (Row<V>::kWide)
      multiplyRows(s, top, pushed);
    else
      multiplyTriangle(s, top, pushed);
  }

  /// The covariance of the next motion is the product of `top`, `pushed` and the derivatives of the
  /// motion, here a lane for each of its elements.
  void multiplyRows(const FilterSample& s, const Row<V> top[6], const V pushed[6][3]) {
    Lanes motion[6], response[3], by_thrust(0.0);
    for (Lanes& column : motion) column = Lanes(0.0);
    for (Lanes& column : response) column = Lanes(0.0);
    for (int j = 0; j < 6; ++j) {
      for (int k = 0; k < 6; ++k) motion[k][j] = s.motion[j][k];
      for (int k = 0; k < 3; ++k) response[k][j] = s.response[j][k];
      by_thrust[j] = s.by_thrust[j];
    }
    for (int i = 0; i < 6; ++i) {
      Lanes sum = Lanes(top[i][kThrust]) * by_thrust;
      for (int k = 0; k < 6; ++k) sum += Lanes(top[i][k]) * motion[k];
      for (int k = 0; k < 3; ++k) sum += Lanes(pushed[i][k]) * response[k];
      for (int j = i; j < 6; ++j) P[i][j] = P[j][i] = sum[j];
    }
  }

  /// The same for a covariance in each lane.
  void multiplyTriangle(const FilterSample& s, const Row<V> top[6], const V pushed[6][3]) {
    for (int i = 0; i < 6; ++i)
      for (int j = i; j < 6; ++j) {
        V sum = top[i][kThrust] * V(s.by_thrust[j]);
        for (int k = 0; k < 6; ++k) sum += top[i][k] * V(s.motion[j][k]);
        for (int k = 0; k < 3; ++k) sum += pushed[i][k] * V(s.response[j][k]);
        P[i][j] = P[j][i] = sum;
      }
  }

  /// Covariances with the wrench, the force in the room and the constant states.
  void moveWrench(const FilterSample& s, const typename Random<V>::Step& step,
                  const Row<V> top[6]) {
    for (int i = 0; i < 6; ++i) {
      const double* const body = s.response[i];
      const double response[5] = {body[0], body[1], body[2], body[0] * s.middle.c - body[1] * s.middle.s,
                                  body[0] * s.middle.s + body[1] * s.middle.c};
      for (int k = kSlow; k < kConstant; ++k) {
        const int process = processOf(k);
        // process noise of the step
        const V half = V(response[k - kSlow]) * step.added[process] * V(0.5);
        P[i][k] = P[k][i] = top[i][k] * step.left[process] + half;
      }
      for (int k = kConstant; k < kN; ++k) P[i][k] = P[k][i] = top[i][k];
    }
    for (int i = kSlow; i < kConstant; ++i) {
      const V left = step.left[processOf(i)];
      for (int j = i; j < kConstant; ++j)
        P[i][j] = P[j][i] = P[i][j] * left * step.left[processOf(j)];
      P[i][i] += step.added[processOf(i)];
      for (int k = kConstant; k < kN; ++k) P[i][k] = P[k][i] = P[i][k] * left;
    }
  }
};

/// Inverse of a symmetric matrix by its adjugate.
template <typename V>
void invert(const V S[3][3], V inverse[3][3]) {
  const V a = S[1][1] * S[2][2] - S[1][2] * S[1][2], b = S[0][2] * S[1][2] - S[0][1] * S[2][2],
          c = S[0][1] * S[1][2] - S[0][2] * S[1][1];
  const V over = V(1.0) / (S[0][0] * a + S[0][1] * b + S[0][2] * c);
  inverse[0][0] = over * a;
  inverse[0][1] = inverse[1][0] = over * b;
  inverse[0][2] = inverse[2][0] = over * c;
  inverse[1][1] = over * (S[0][0] * S[2][2] - S[0][2] * S[0][2]);
  inverse[1][2] = inverse[2][1] = over * (S[0][1] * S[0][2] - S[0][0] * S[1][2]);
  inverse[2][2] = over * (S[0][0] * S[1][1] - S[0][1] * S[0][1]);
}

/// The product of a matrix with three rows.
template <typename V>
void combine(const V by[3][3], const Row<V> rows[3], Row<V> result[3]) {
  for (int a = 0; a < 3; ++a)
    for (int j = 0; j < Row<V>::kParts; ++j)
      result[a].part[j] = Lanes(by[a][0]) * rows[0].part[j] + Lanes(by[a][1]) * rows[1].part[j] +
                          Lanes(by[a][2]) * rows[2].part[j];
}

/// Propagates `count` deviations of the filter's state by one step, in which processes have the
/// coefficients `left` and `mean`; x is (kN, count), row by row.
template <typename V, typename Step>
void moveDeviation(const FilterSample& s, const Step& step, V* x, int count) {
  const auto at = [&](int i) { return x + i * count; };
  V left[4], mean[4];
  for (int i = 0; i < 4; ++i) {
    left[i] = V(step.left[i]);
    mean[i] = V(step.mean[i]);
  }
  const V c = mean[3] * V(s.middle.c), sine = mean[3] * V(s.middle.s);
  for (int j = 0; j < count; ++j) {
    V push[3], next[6];
    for (int i = 0; i < 3; ++i) push[i] = mean[i] * at(kSlow + i)[j] + at(kConstant + i)[j];
    push[0] += c * at(kRoom)[j] + sine * at(kRoom + 1)[j];
    push[1] += c * at(kRoom + 1)[j] - sine * at(kRoom)[j];
    for (int i = 0; i < 6; ++i) {
      V sum = V(s.by_thrust[i]) * at(kThrust)[j];
      for (int k = 0; k < 6; ++k) sum += V(s.motion[i][k]) * at(k)[j];
      for (int k = 0; k < 3; ++k) sum += V(s.response[i][k]) * push[k];
      next[i] = sum;
    }
    for (int i = 0; i < 6; ++i) at(i)[j] = next[i];
    for (int i = kSlow; i < kConstant; ++i) at(i)[j] = left[processOf(i)] * at(i)[j];
  }
}

/// Sets deviations to zero at the start of a stretch, except for those of the constant states.
template <typename V>
void forgetDeviation(V* x, int count) {
  for (int i = 0; i < kConstant * count; ++i) x[i] = V(0.0);
}

/// Advances the actuators over a gap, in which the motion is not known.
inline void passGap(Simulation<Jet>& simulation, double until) {
  simulation.state() = {};
  simulation.advance(until);
}

/// Corrects `count` deviations of the state by the filter's gain. `white`: deviations of the
/// whitened innovation. `unseen`: direct changes of the measurement, or null.
template <typename V>
void correctDeviation(const FilterSample& s, const V* unseen, V* x, V* white, int count) {
  const Vector3<double> e = s.whitened();
  for (int j = 0; j < count; ++j) {
    V change[3];
    for (int a = 0; a < 3; ++a) {
      change[a] = unseen ? -unseen[a * count + j] : V(0.0);
      for (int i = 0; i < 3; ++i) change[a] -= V(s.seen[a][i]) * x[i * count + j];
    }
    for (int a = 0; a < 3; ++a)
      white[a * count + j] = V(s.whitening[a][0]) * change[0] + V(s.whitening[a][1]) * change[1] +
                             V(s.whitening[a][2]) * change[2];
    if (s.capped()) {
      // The gain falls with the square of the innovation's size, so that the correction falls with
      // the size.
      const V longer = V(2 / e.squaredNorm()) * (V(e(0)) * white[j] + V(e(1)) * white[count + j] +
                                                 V(e(2)) * white[2 * count + j]);
      for (int a = 0; a < 3; ++a) change[a] -= longer * V(s.innovation(a));
    }
    for (int i = 0; i < kN; ++i)
      x[i * count + j] += V(s.gain[0][i]) * change[0] + V(s.gain[1][i]) * change[1] +
                          V(s.gain[2][i]) * change[2];
  }
}

}  // namespace ground::detail
