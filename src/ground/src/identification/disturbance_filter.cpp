#include "disturbance_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "ground/model/measurement.h"
#include "ground/model/simulation.h"

namespace ground::detail {
namespace {

constexpr int kN = kFilterStates;
// From pose to pose errors stay far below their noise; twice the step of a simulation.
constexpr double kFilterStep = 0.01;  // [s]
// Standard deviations of a stretch's first state, generously: pose as measured, velocity smoothed.
constexpr double kFirstPosition = 0.1, kFirstHeading = 0.5, kFirstSpeed = 0.3, kFirstYawRate = 3.0;

/// Levels as the recursion needs them, of one set (double) or eight side by side (Lanes).
template <typename V>
struct Random {
  V variance[3], time[3], white[3];  ///< of X, Y, N: stationary variance, [s], density
  V noise[3];                        ///< variance of x, y, psi
  V constant[4];                     ///< variance of the constant states

  /// Over a step of length h [s]: what is left of the wrench, its mean over the step, noise.
  struct Step {
    V left[3], mean[3], added[3], density[3];
  };
  Step over(double h) const {
    Step step;
    for (int i = 0; i < 3; ++i) {
      using std::exp;
      const V part = V(h) / time[i];
      step.left[i] = exp(-part);
      step.mean[i] = (1.0 - step.left[i]) / part;
      step.added[i] = variance[i] * (1.0 - step.left[i] * step.left[i]);
      step.density[i] = white[i] * V(1 / h);
    }
    return step;
  }
};

Random<double> randomOf(const DisturbanceLevels& levels, const Vector3<double>& noise) {
  Random<double> random;
  const double factor[3] = {levels.position, levels.position, levels.heading};
  for (int i = 0; i < 3; ++i) {
    random.variance[i] = levels.sigma(i) * levels.sigma(i);
    random.time[i] = levels.time(i);
    random.white[i] = levels.white(i) * levels.white(i);
    random.noise[i] = std::pow(factor[i] * noise(i), 2);
    random.constant[i] = levels.trim(i) * levels.trim(i);
  }
  random.constant[3] = levels.thrust * levels.thrust;
  return random;
}

/// Covariance of the filter's state, whole and symmetric.
template <typename V>
struct Covariance {
  V P[kN][kN];

  /// Pose and velocity anew; `first`: also what is constant.
  void start(const Random<V>& random, bool first) {
    const int known = first ? kN : 9;
    for (int i = 0; i < kN; ++i)
      for (int j = 0; j < kN; ++j)
        if (i < known || j < known) P[i][j] = V(0.0);
    const double sigma[6] = {kFirstPosition, kFirstPosition, kFirstHeading,
                             kFirstSpeed,    kFirstSpeed,    kFirstYawRate};
    for (int i = 0; i < 6; ++i) P[i][i] = V(sigma[i] * sigma[i]);
    for (int i = 0; i < 3; ++i) P[6 + i][6 + i] = random.variance[i];
    for (int i = 9; first && i < kN; ++i) P[i][i] = random.constant[i - 9];
  }

  /// S = H P H' + R and P H'.
  void see(const FilterSample& s, const Random<V>& random, V PH[kN][3], V S[3][3]) const {
    for (int i = 0; i < kN; ++i)
      for (int a = 0; a < 3; ++a) {
        V sum = P[i][0] * V(s.seen[a][0]);
        for (int j = 1; j < 6; ++j) sum += P[i][j] * V(s.seen[a][j]);
        PH[i][a] = sum;
      }
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        V sum = V(s.seen[a][0]) * PH[0][b];
        for (int j = 1; j < 6; ++j) sum += V(s.seen[a][j]) * PH[j][b];
        S[a][b] = a == b ? sum + random.noise[a] : sum;
      }
  }

  void correct(const V K[kN][3], const V PH[kN][3]) {
    for (int i = 0; i < kN; ++i)
      for (int j = i; j < kN; ++j) {
        P[i][j] -= K[i][0] * PH[j][0] + K[i][1] * PH[j][1] + K[i][2] * PH[j][2];
        P[j][i] = P[i][j];
      }
  }

  void move(const FilterSample& s, const typename Random<V>::Step& step) {
    V push[3][kN], top[6][kN];  // covariance of what acts, and of what is moved, with the state
    for (int j = 0; j < kN; ++j) {
      for (int i = 0; i < 3; ++i)
        push[i][j] = step.mean[i] * P[6 + i][j] + P[9 + i][j];
      for (int i = 0; i < 6; ++i) {
        V sum = V(s.motion[i][0]) * P[0][j];
        for (int k = 1; k < 6; ++k) sum += V(s.motion[i][k]) * P[k][j];
        for (int k = 0; k < 3; ++k) sum += V(s.response[i][k]) * push[k][j];
        top[i][j] = sum + V(s.by_thrust[i]) * P[12][j];
      }
    }
    V acting[6][3];  // covariance of what is moved with what acts
    for (int i = 0; i < 6; ++i)
      for (int k = 0; k < 3; ++k)
        acting[i][k] = step.mean[k] * top[i][6 + k] + top[i][9 + k];
    V third[6][3], half[6][3];  // of the noise that comes in on the way
    for (int i = 0; i < 6; ++i)
      for (int k = 0; k < 3; ++k) {
        third[i][k] = V(s.response[i][k]) * (step.added[k] * V(1.0 / 3) + step.density[k]);
        half[i][k] = V(s.response[i][k]) * step.added[k] * V(0.5);
      }
    for (int i = 0; i < 6; ++i)
      for (int j = i; j < 6; ++j) {
        V sum = top[i][12] * V(s.by_thrust[j]);
        for (int k = 0; k < 6; ++k) sum += top[i][k] * V(s.motion[j][k]);
        for (int k = 0; k < 3; ++k)
          sum += (acting[i][k] + third[i][k]) * V(s.response[j][k]);
        P[i][j] = P[j][i] = sum;
      }
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < 3; ++k)
        P[i][6 + k] = P[6 + k][i] = top[i][6 + k] * step.left[k] + half[i][k];
      for (int k = 9; k < kN; ++k) P[i][k] = P[k][i] = top[i][k];
    }
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        P[6 + i][6 + j] = P[6 + i][6 + j] * step.left[i] * step.left[j];
        P[6 + j][6 + i] = P[6 + i][6 + j];
      }
      P[6 + i][6 + i] += step.added[i];
      for (int k = 9; k < kN; ++k) P[6 + i][k] = P[k][6 + i] = P[6 + i][k] * step.left[i];
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

template <typename V>
void gainOf(const V PH[kN][3], const V inverse[3][3], V K[kN][3]) {
  for (int i = 0; i < kN; ++i)
    for (int a = 0; a < 3; ++a)
      K[i][a] = PH[i][0] * inverse[0][a] + PH[i][1] * inverse[1][a] + PH[i][2] * inverse[2][a];
}

/// Moves deviations of the filter's state, a row a state, each row `count` long.
template <typename V>
void moveDeviation(const FilterSample& s, const V left[3], const V mean[3], V* x, int count) {
  const auto at = [&](int i) { return x + i * count; };
  for (int j = 0; j < count; ++j) {
    V push[3], next[6];
    for (int i = 0; i < 3; ++i) push[i] = mean[i] * at(6 + i)[j] + at(9 + i)[j];
    for (int i = 0; i < 6; ++i) {
      V sum = V(s.by_thrust[i]) * at(12)[j];
      for (int k = 0; k < 6; ++k) sum += V(s.motion[i][k]) * at(k)[j];
      for (int k = 0; k < 3; ++k) sum += V(s.response[i][k]) * push[k];
      next[i] = sum;
    }
    for (int i = 0; i < 6; ++i) at(i)[j] = next[i];
    for (int i = 0; i < 3; ++i) at(6 + i)[j] = left[i] * at(6 + i)[j];
  }
}

/// Starts a stretch anew: only what is constant is carried over.
template <typename V>
void forgetDeviation(V* x, int count) {
  for (int i = 0; i < 9 * count; ++i) x[i] = V(0.0);
}

void inverseRoot(const double S[3][3], double weight, double root[3][3]) {
  const double a = std::sqrt(S[0][0]), b = S[1][0] / a, c = S[2][0] / a;
  const double d = std::sqrt(S[1][1] - b * b), e = (S[2][1] - b * c) / d;
  const double f = std::sqrt(S[2][2] - c * c - e * e);
  const double rows[3][3] = {{1 / a, 0, 0},
                             {-b / (a * d), 1 / d, 0},
                             {(b * e - c * d) / (a * d * f), -e / (d * f), 1 / f}};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) root[i][j] = weight * rows[i][j];
}

/// Lets actuators follow their commands while the motion is not known.
void passGap(Simulation<Jet>& simulation, double until) {
  simulation.state() = {};
  simulation.advance(until);
}

}  // namespace

DisturbanceFilter::DisturbanceFilter(const RunData& run, double max_gap)
    : run_(run), poses_(run.poses.rows() == 0 ? run.eta : run.poses) {
  const std::size_t count = run.times.size();
  if (count == 0 || static_cast<std::size_t>(run.eta.rows()) != count ||
      static_cast<std::size_t>(run.nu.rows()) != count ||
      static_cast<std::size_t>(poses_.rows()) != count)
    throw std::invalid_argument(run.name + ": times, eta, nu and poses differ in length");
  if (!run.eta.allFinite() || !run.nu.allFinite() || !poses_.allFinite())
    throw std::invalid_argument(run.name + ": a measurement is not finite");
  starts_.assign(count, false);
  starts_[0] = true;
  for (std::size_t k = 1; k < count; ++k) {
    const double dt = run.times[k] - run.times[k - 1];
    if (!(dt >= 0)) throw std::invalid_argument(run.name + ": times descend");
    starts_[k] = dt > max_gap;
  }
  samples_.resize(count);
  wrench_.resize(static_cast<Eigen::Index>(count), 3);
  constants_.resize(static_cast<Eigen::Index>(count), 4);
}

double DisturbanceFilter::run(const Model& model, const DisturbanceLevels& levels, double cap,
                              std::vector<FilterBelief>* kept) {
  constexpr int kThrust = 6;  // direction of a Jet
  std::vector<Jet> coordinates;
  for (const double value : model.coordinates()) coordinates.emplace_back(value);
  coordinates[static_cast<std::size_t>(model.index("k"))].v[kThrust] = model.body.k;
  const Dynamics<Jet> dynamics(model, coordinates);
  Matrix3<double> mobility;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) mobility(i, j) = dynamics.mass()(i, j).a;
  mobility = mobility.inverse().eval();
  const Random<double> random = randomOf(levels, run_.noise);

  double likelihood = 0;
  std::size_t next = 0;  // belief to keep
  RigidState<double> at;
  Vector3<double> push = Vector3<double>::Zero();  // the Ornstein-Uhlenbeck wrench
  Eigen::Vector4d constant = Eigen::Vector4d::Zero();
  Covariance<double> covariance;
  Simulation<Jet> simulation(dynamics, run_.inputs, {}, run_.times[0], kFilterStep);
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    FilterSample& s = samples_[k];
    s.starts = starts_[k];
    if (s.starts) {
      if (k > 0) passGap(simulation, run_.times[k]);
      const auto row = static_cast<Eigen::Index>(k);
      at = stateSeenAs(dynamics, {poses_.row(row).transpose(), run_.nu.row(row).transpose()});
      push.setZero();
      covariance.start(random, k == 0);
    }
    s.predicted = at;
    RigidState<Jet> seeded;
    for (int i = 0; i < 3; ++i) {
      seeded.eta(i) = Jet(at.eta(i), i);
      seeded.nu(i) = Jet(at.nu(i), 3 + i);
    }
    const Measurement<Jet> seen = dynamics.measure(seeded);
    for (int a = 0; a < 3; ++a) {
      s.innovation(a) = poses_(static_cast<Eigen::Index>(k), a) - seen.eta(a).a;
      for (int j = 0; j < 6; ++j) s.seen[a][j] = seen.eta(a).v[j];
    }
    s.innovation(2) = wrapAngle(s.innovation(2));
    double PH[kN][3], S[3][3], inverse[3][3];
    covariance.see(s, random, PH, S);
    invert(S, inverse);
    double distance = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) distance += s.innovation(a) * inverse[a][b] * s.innovation(b);
    s.capped = distance > cap;
    const double inflation = s.capped ? distance / cap : 1;
    if (s.capped)
      for (auto& row : inverse)
        for (double& x : row) x /= inflation;
    inverseRoot(S, 1 / std::sqrt(inflation), s.whitening);
    const double log_root = std::log(s.whitening[0][0] * s.whitening[1][1] * s.whitening[2][2]);
    s.log_density = s.starts ? 0 : log_root - 0.5 * distance / inflation;
    likelihood += s.log_density;
    gainOf(PH, inverse, s.gain);
    Vector13 change;
    for (int i = 0; i < kN; ++i)
      change(i) = s.gain[i][0] * s.innovation(0) + s.gain[i][1] * s.innovation(1) +
                  s.gain[i][2] * s.innovation(2);
    at.eta += change.segment<3>(0);
    at.nu += change.segment<3>(3);
    push += change.segment<3>(6);
    constant += change.tail<4>();
    covariance.correct(s.gain, PH);
    s.filtered = at;
    wrench_.row(static_cast<Eigen::Index>(k)) = push;
    constants_.row(static_cast<Eigen::Index>(k)) = constant;
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next) {
      FilterBelief& belief = (*kept)[next];
      belief.mean << at.eta, at.nu, push, constant;
      for (int i = 0; i < kN; ++i)
        for (int j = 0; j < kN; ++j) belief.covariance(i, j) = covariance.P[i][j];
      belief.log_likelihood = likelihood;
    }

    s.dt = 0;
    if (k + 1 == samples_.size() || starts_[k + 1]) continue;
    s.dt = run_.times[k + 1] - run_.times[k];
    if (s.dt <= 0) continue;
    for (int i = 0; i < 3; ++i) {
      seeded.eta(i) = Jet(at.eta(i), i);
      seeded.nu(i) = Jet(at.nu(i), 3 + i);
    }
    simulation.state() = seeded;
    simulation.advance(run_.times[k + 1]);
    const RigidState<Jet>& to = simulation.state();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 6; ++j) {
        s.motion[i][j] = to.eta(i).v[j];
        s.motion[3 + i][j] = to.nu(i).v[j];
      }
    for (int i = 0; i < 3; ++i) {
      s.by_thrust[i] = to.eta(i).v[kThrust];
      s.by_thrust[3 + i] = to.nu(i).v[kThrust];
    }
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 3; ++j) {
        double sum = 0;  // the mean of the motion by velocity at the step's start and end
        for (int l = 0; l < 3; ++l)
          sum += (s.motion[i][3 + l] + (i == 3 + l ? 1 : 0)) * mobility(l, j);
        s.response[i][j] = 0.5 * s.dt * sum;
      }
    const Random<double>::Step step = random.over(s.dt);
    for (int i = 0; i < 3; ++i) s.push(i) = step.mean[i] * push(i) + constant(i);
    covariance.move(s, step);
    for (int i = 0; i < 3; ++i) {
      at.eta(i) = to.eta(i).a + s.by_thrust[i] * constant(3);
      at.nu(i) = to.nu(i).a + s.by_thrust[3 + i] * constant(3);
      for (int j = 0; j < 3; ++j) {
        at.eta(i) += s.response[i][j] * s.push(j);
        at.nu(i) += s.response[3 + i][j] * s.push(j);
      }
      push(i) *= step.left[i];
    }
    if (!std::isfinite(likelihood + at.eta.sum() + at.nu.sum()))
      return std::numeric_limits<double>::quiet_NaN();
  }
  for (int i = 0; i < 4; ++i)
    constants_sigma_(i) = std::sqrt(std::max(0.0, covariance.P[9 + i][9 + i]));
  levels_ = levels;
  return likelihood;
}

std::size_t DisturbanceFilter::lastOfStretch(std::size_t sample) const {
  const auto next = std::find(starts_.begin() + static_cast<std::ptrdiff_t>(sample) + 1,
                              starts_.end(), true);
  return static_cast<std::size_t>(next - starts_.begin()) - 1;
}

int DisturbanceFilter::blockCount(double block) const {
  const double duration = run_.times.back() - run_.times.front();
  return std::max(1, static_cast<int>(std::lround(duration / block)));
}

int DisturbanceFilter::blockOf(std::size_t sample, int blocks) const {
  return static_cast<int>(sample * static_cast<std::size_t>(blocks) / samples_.size());
}

Eigen::VectorXd DisturbanceFilter::densities(double block) const {
  const int blocks = blockCount(block);
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(blocks);
  for (std::size_t k = 0; k < samples_.size(); ++k)
    sums(blockOf(k, blocks)) += samples_[k].log_density;
  return sums;
}

Vector3<double> DisturbanceFilter::whitened(std::size_t k) const {
  const FilterSample& s = samples_[k];
  Vector3<double> white;
  for (int a = 0; a < 3; ++a)
    white(a) = s.whitening[a][0] * s.innovation(0) + s.whitening[a][1] * s.innovation(1) +
               s.whitening[a][2] * s.innovation(2);
  return white;
}

namespace {

/// The part of a change of the innovation that is left of it as whitened; and the state's.
void correctDeviation(const FilterSample& s, const double* unseen, double* x, double* white,
                      int count) {
  for (int j = 0; j < count; ++j) {
    double change[3];
    for (int a = 0; a < 3; ++a) {
      change[a] = unseen ? -unseen[a * count + j] : 0;
      for (int i = 0; i < 6; ++i) change[a] -= s.seen[a][i] * x[i * count + j];
    }
    for (int i = 0; i < kN; ++i)
      x[i * count + j] +=
          s.gain[i][0] * change[0] + s.gain[i][1] * change[1] + s.gain[i][2] * change[2];
    for (int a = 0; a < 3; ++a)
      white[a * count + j] = s.whitening[a][0] * change[0] + s.whitening[a][1] * change[1] +
                             s.whitening[a][2] * change[2];
  }
}

}  // namespace

RunScores DisturbanceFilter::scores(const Model& model, const Free& free, double block,
                                    std::vector<FilterBelief>* kept) const {
  const int n = static_cast<int>(free.index.size());
  const int groups = (n + Jet::kDirections - 1) / Jet::kDirections, half = groups * Jet::kDirections;
  const int count = 2 * half;  // columns: the disturbance's wrench stays, the acceleration does
  std::vector<Dynamics<Jet>> dynamics;
  std::vector<Matrix3<Jet>> mobility;
  const std::vector<double> base = model.coordinates();
  for (int g = 0; g < groups; ++g) {
    std::vector<Jet> coordinates(base.begin(), base.end());
    for (int j = 0; j < Jet::kDirections && g * Jet::kDirections + j < n; ++j) {
      const int i = g * Jet::kDirections + j;
      coordinates[free.index[i]].v[j] = free.scale[i];
    }
    dynamics.emplace_back(model, coordinates);
    mobility.push_back(dynamics.back().mass().inverse());
  }
  std::vector<Simulation<Jet>> simulations;
  for (const auto& d : dynamics)
    simulations.emplace_back(d, run_.inputs, RigidState<Jet>(), run_.times[0], kFilterStep);

  const int blocks = blockCount(block);
  RunScores result;
  result.score.setZero(blocks, n);
  std::vector<double> x(kN * count, 0.0), white(3 * count), unseen(3 * count), sums(n * count, 0.0);
  const Random<double> random = randomOf(levels_, run_.noise);
  std::size_t next = 0;  // belief to fill in
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    if (s.starts && k > 0) {
      forgetDeviation(x.data(), count);
      for (int g = 0; g < groups; ++g)
        passGap(simulations[g], run_.times[k]);
    }
    RigidState<Jet> here;
    here.eta = s.predicted.eta.cast<Jet>();
    here.nu = s.predicted.nu.cast<Jet>();
    bool distorts = false;
    for (int g = 0; g < groups; ++g) {
      if (!dynamics[g].distorts()) continue;
      distorts = true;
      const Measurement<Jet> seen = dynamics[g].measure(here);
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < Jet::kDirections; ++j)
          for (const int side : {0, half})
            unseen[a * count + side + g * Jet::kDirections + j] = seen.eta(a).v[j];
    }
    correctDeviation(s, distorts ? unseen.data() : nullptr, x.data(), white.data(), count);
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next) {
      Eigen::MatrixXd& sensitivity = (*kept)[next].sensitivity;
      sensitivity.resize(kN, n);
      for (int i = 0; i < kN; ++i)
        for (int j = 0; j < n; ++j) sensitivity(i, j) = x[i * count + j];
    }
    if (!s.starts) {
      const Vector3<double> e = whitened(k);
      const int at = blockOf(k, blocks);
      for (int j = 0; j < n; ++j)
        result.score(at, j) -=
            white[j] * e(0) + white[count + j] * e(1) + white[2 * count + j] * e(2);
      for (int a = 0; a < 3; ++a) {
        const double* row = white.data() + a * count;
        for (int i = 0; i < n; ++i)
          for (const int side : {0, half}) {
            const double factor = row[side + i];
            double* sum = sums.data() + i * count + side;
            for (int j = 0; j < half; ++j) sum[j] += factor * row[side + j];
          }
      }
    }
    if (s.dt <= 0) continue;
    here.eta = s.filtered.eta.cast<Jet>();
    here.nu = s.filtered.nu.cast<Jet>();
    const Random<double>::Step step = random.over(s.dt);
    moveDeviation(s, step.left, step.mean, x.data(), count);
    for (int g = 0; g < groups; ++g) {
      simulations[g].state() = here;
      simulations[g].advance(run_.times[k + 1]);
      const RigidState<Jet>& to = simulations[g].state();
      const Vector3<Jet> pushed = mobility[g] * s.push.cast<Jet>();
      for (int j = 0; j < Jet::kDirections; ++j) {
        const int column = g * Jet::kDirections + j;
        for (int i = 0; i < 3; ++i) {
          double eta = to.eta(i).v[j], nu = to.nu(i).v[j];
          x[i * count + half + column] += eta;
          x[(3 + i) * count + half + column] += nu;
          for (int l = 0; l < 3; ++l) {
            eta += 0.5 * s.dt * s.motion[i][3 + l] * pushed(l).v[j];
            nu += 0.5 * s.dt * (s.motion[3 + i][3 + l] + (i == l ? 1 : 0)) * pushed(l).v[j];
          }
          x[i * count + column] += eta;
          x[(3 + i) * count + column] += nu;
        }
      }
    }
  }
  const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>
      both(sums.data(), n, count);
  result.information = both.leftCols(n);
  result.by_acceleration = both.middleCols(half, n);
  return result;
}

RunLevelScores DisturbanceFilter::levelScores(const DisturbanceLevels& levels) const {
  constexpr int kPasses = (kLevels + Lanes::kCount - 1) / Lanes::kCount;
  constexpr int kColumns = kPasses * Lanes::kCount;
  constexpr double kSmall = 1e-3;  // change of a logarithm
  // Rows of each sample: three of the whitened innovation's change, six of its covariance's.
  std::vector<std::array<double, kColumns>> rows(9 * samples_.size());
  for (int pass = 0; pass < kPasses; ++pass) {
    Random<Lanes> random;
    for (int lane = 0; lane < Lanes::kCount; ++lane) {
      auto values = levels.values();
      const int level = pass * Lanes::kCount + lane;
      if (level < kLevels) values[level] *= std::exp(kSmall);
      const Random<double> one = randomOf(DisturbanceLevels::of(values), run_.noise);
      for (int i = 0; i < 3; ++i) {
        random.variance[i][lane] = one.variance[i];
        random.time[i][lane] = one.time[i];
        random.white[i][lane] = one.white[i];
        random.noise[i][lane] = one.noise[i];
      }
      for (int i = 0; i < 4; ++i) random.constant[i][lane] = one.constant[i];
    }
    const Random<double> base = randomOf(levels, run_.noise);
    Covariance<Lanes> covariance;
    Lanes x[kN];
    Vector13 wrench = Vector13::Zero();
    for (Lanes& value : x) value = Lanes(0.0);
    for (std::size_t k = 0; k < samples_.size(); ++k) {
      const FilterSample& s = samples_[k];
      if (s.starts) {
        covariance.start(random, k == 0);
        forgetDeviation(x, 1);
      }
      Lanes PH[kN][3], S[3][3], inverse[3][3], K[kN][3], innovation[3];
      covariance.see(s, random, PH, S);
      invert(S, inverse);
      for (int a = 0; a < 3; ++a) {
        innovation[a] = Lanes(s.innovation(a));
        for (int j = 0; j < 6; ++j) innovation[a] -= Lanes(s.seen[a][j]) * x[j];
      }
      if (s.capped) {
        // The deviation follows the gain that the filter had.
        for (int i = 0; i < kN; ++i)
          for (int a = 0; a < 3; ++a) K[i][a] = Lanes(s.gain[i][a]);
      } else {
        gainOf(PH, inverse, K);
      }
      // Whitened by the unchanged levels.
      if (!s.starts && !s.capped) {
        Lanes de[3], dS[3][3];
        for (int a = 0; a < 3; ++a) {
          de[a] = Lanes(0.0);
          for (int b = 0; b <= a; ++b)
            de[a] += Lanes(s.whitening[a][b]) * (innovation[b] - Lanes(s.innovation(b)));
        }
        Lanes half[3][3];
        for (int a = 0; a < 3; ++a)
          for (int b = 0; b < 3; ++b) {
            half[a][b] = Lanes(0.0);
            for (int c = 0; c <= a; ++c) half[a][b] += Lanes(s.whitening[a][c]) * S[c][b];
          }
        for (int a = 0; a < 3; ++a)
          for (int b = 0; b <= a; ++b) {
            dS[a][b] = Lanes(a == b ? -1.0 : 0.0);
            for (int c = 0; c <= b; ++c) dS[a][b] += half[a][c] * Lanes(s.whitening[b][c]);
          }
        auto* row = rows.data() + 9 * k;
        for (int lane = 0; lane < Lanes::kCount; ++lane) {
          const int column = pass * Lanes::kCount + lane;
          for (int a = 0; a < 3; ++a) row[a][column] = de[a][lane] / kSmall;
          int at = 3;
          for (int a = 0; a < 3; ++a)
            for (int b = 0; b <= a; ++b) row[at++][column] = dS[a][b][lane] / kSmall;
        }
      } else {
        for (int i = 0; i < 9; ++i)
          for (int lane = 0; lane < Lanes::kCount; ++lane)
            rows[9 * k + i][pass * Lanes::kCount + lane] = 0;
      }
      for (int i = 0; i < kN; ++i) {
        const Lanes with = K[i][0] * innovation[0] + K[i][1] * innovation[1] + K[i][2] * innovation[2];
        const double without = s.gain[i][0] * s.innovation(0) + s.gain[i][1] * s.innovation(1) +
                               s.gain[i][2] * s.innovation(2);
        x[i] += with - Lanes(without);
        wrench(i) += without;
      }
      covariance.correct(K, PH);
      if (s.dt <= 0) {
        if (k + 1 < samples_.size() && samples_[k + 1].starts) wrench.head<9>().setZero();
        continue;
      }
      const auto step = random.over(s.dt);
      const auto unchanged = base.over(s.dt);
      covariance.move(s, step);
      moveDeviation(s, step.left, step.mean, x, 1);
      // The wrench itself decays otherwise.
      for (int i = 0; i < 3; ++i) {
        const Lanes more = (step.mean[i] - Lanes(unchanged.mean[i])) * Lanes(wrench(6 + i));
        for (int j = 0; j < 6; ++j) x[j] += Lanes(s.response[j][i]) * more;
        x[6 + i] += (step.left[i] - Lanes(unchanged.left[i])) * Lanes(wrench(6 + i));
        wrench(6 + i) *= unchanged.left[i];
      }
    }
  }
  RunLevelScores result{Eigen::VectorXd::Zero(kLevels), Eigen::MatrixXd::Zero(kLevels, kLevels)};
  double sums[kLevels][kColumns] = {}, score[kColumns] = {};
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    if (samples_[k].starts || samples_[k].capped) continue;
    const Vector3<double> e = whitened(k);
    const auto* row = rows.data() + 9 * k;
    int at = 3;
    for (int a = 0; a < 3; ++a) {
      for (int j = 0; j < kColumns; ++j) score[j] -= e(a) * row[a][j];
      for (int b = 0; b <= a; ++b, ++at) {
        const double weight = a == b ? 0.5 * (e(a) * e(a) - 1) : e(a) * e(b);
        for (int j = 0; j < kColumns; ++j) score[j] += weight * row[at][j];
      }
    }
    for (int i = 0; i < 9; ++i) {
      // Diagonal elements of the covariance count half, the others stand for two.
      const double weight = i == 3 || i == 5 || i == 8 ? 0.5 : 1.0;
      for (int l = 0; l < kLevels; ++l) {
        const double factor = weight * row[i][l];
        for (int j = 0; j < kColumns; ++j) sums[l][j] += factor * row[i][j];
      }
    }
  }
  for (int i = 0; i < kLevels; ++i) {
    result.score(i) = score[i];
    for (int j = 0; j < kLevels; ++j) result.information(i, j) = sums[i][j];
  }
  return result;
}

Eigen::MatrixXd DisturbanceFilter::responses(const Eigen::MatrixXd& acting,
                                             const std::vector<int>& channels) const {
  const int count = static_cast<int>(channels.size());
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(3 * static_cast<Eigen::Index>(samples_.size()), count);
  std::vector<double> x(kN * count, 0.0), white(3 * count);
  const Random<double> random = randomOf(levels_, run_.noise);
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    if (s.starts) forgetDeviation(x.data(), count);
    correctDeviation(s, nullptr, x.data(), white.data(), count);
    if (!s.starts)
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < count; ++j)
          result(3 * static_cast<Eigen::Index>(k) + a, j) = -white[a * count + j];
    if (s.dt <= 0) continue;
    const Random<double>::Step step = random.over(s.dt);
    moveDeviation(s, step.left, step.mean, x.data(), count);
    for (int j = 0; j < count; ++j)
      for (int i = 0; i < 6; ++i)
        x[i * count + j] +=
            s.response[i][channels[j]] * acting(static_cast<Eigen::Index>(k), j);
  }
  return result;
}

}  // namespace ground::detail
