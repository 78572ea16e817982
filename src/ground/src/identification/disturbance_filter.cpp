#include "disturbance_filter.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "checks.h"
#include "filter_steps.h"

namespace ground::detail {
namespace {

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

/// The state of the filter during a run.
class Pass {
 public:
  Pass(const Model& model, const RunData& run, const Eigen::MatrixX3d& poses,
       const DisturbanceLevels& levels)
      : run_(run),
        poses_(poses),
        dynamics_(model, coordinatesWithThrust(model)),
        random_(randomOf(levels, run.noise)),
        simulation_(dynamics_, run.inputs, {}, run.times[0], longestStep(dynamics_, run.noise)) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) mobility_(i, j) = dynamics_.mass()(i, j).a;
    mobility_ = mobility_.inverse().eval();
  }

  /// Begins a stretch at sample k, with measured pose and velocity.
  void start(std::size_t k) {
    if (k > 0) passGap(simulation_, run_.times[k]);
    const auto row = static_cast<Eigen::Index>(k);
    at_ = stateSeenAs(dynamics_, {poses_.row(row).transpose(), run_.nu.row(row).transpose()});
    push_.setZero();
    room_.setZero();
    covariance_.start(random_, k == 0);
  }

  /// Kalman correction by the pose of sample k; fills in its FilterSample.
  void correct(std::size_t k, double cap, FilterSample& s) {
    s.predicted = at_;
    compare(k, s);
    Row<double> HP[3], gain[3], white[3];
    double S[3][3], inverse[3][3];
    covariance_.see(s, random_, HP, S);
    invert(S, inverse);
    weigh(S, cap, inverse, s);
    combine(inverse, HP, gain);
    combine(s.whitening, HP, white);
    Row<double> change;
    for (int j = 0; j < Row<double>::kParts; ++j)
      change.part[j] = Lanes(s.innovation(0)) * gain[0].part[j] +
                       Lanes(s.innovation(1)) * gain[1].part[j] +
                       Lanes(s.innovation(2)) * gain[2].part[j];
    for (int a = 0; a < 3; ++a)
      for (int i = 0; i < kN; ++i) s.gain[a][i] = gain[a][i];
    for (int i = 0; i < 3; ++i) {
      at_.eta(i) += change[i];
      at_.nu(i) += change[3 + i];
      push_(i) += change[kSlow + i];
    }
    for (int i = 0; i < 2; ++i) room_(i) += change[kRoom + i];
    for (int i = 0; i < 4; ++i) constant_(i) += change[kConstant + i];
    covariance_.subtract(white, white);
    s.filtered = at_;
  }

  void keep(FilterBelief& belief) const {
    belief.mean << at_.eta, at_.nu, push_, room_, constant_;
    for (int i = 0; i < kN; ++i)
      for (int j = 0; j < kN; ++j) belief.covariance(i, j) = covariance_.P[i][j];
  }

  /// Kalman prediction from sample k to the next, s.dt later.
  void move(std::size_t k, FilterSample& s) {
    const double until = run_.times[k + 1];
    simulation_.restart(seeded());
    simulation_.advance(until);
    const RigidState<Jet>& to = simulation_.state();
    linearise(to, s);
    const Random<double>::Step step = random_.over(s.dt);
    for (int i = 0; i < 3; ++i) s.push(i) = step.mean[i] * push_(i) + constant_(i);
    pushInRoom(step.mean[3] * room_, s);
    if (run_.wrench.rows() > 0) s.push += run_.wrench.row(static_cast<Eigen::Index>(k)).transpose();
    covariance_.move(s, step);
    for (int i = 0; i < 3; ++i) {
      at_.eta(i) = to.eta(i).a + s.by_thrust[i] * constant_(3);
      at_.nu(i) = to.nu(i).a + s.by_thrust[3 + i] * constant_(3);
      for (int j = 0; j < 3; ++j) {
        at_.eta(i) += s.response[i][j] * s.push(j);
        at_.nu(i) += s.response[3 + i][j] * s.push(j);
      }
      push_(i) *= step.left[i];
    }
    room_ *= step.left[3];
  }

  bool finite() const { return std::isfinite(at_.eta.sum() + at_.nu.sum()); }
  /// The Ornstein-Uhlenbeck wrench and force, body.
  Vector3<double> wrench() const {
    Vector3<double> sum = push_;
    sum.head<2>() += worldToBody(at_.eta.z(), room_);
    return sum;
  }
  const Eigen::Vector4d& constants() const { return constant_; }
  Eigen::Vector4d constantsSigma() const {
    Eigen::Vector4d sigma;
    for (int i = 0; i < 4; ++i) sigma(i) = std::sqrt(std::max(0.0, covariance_.P[kConstant + i][kConstant + i]));
    return sigma;
  }

 private:
  static constexpr int kByThrust = 6;  ///< index of the derivative by thrust in a Jet

  static std::vector<Jet> coordinatesWithThrust(const Model& model) {
    std::vector<Jet> coordinates;
    for (const double value : model.coordinates()) coordinates.emplace_back(value);
    coordinates[static_cast<std::size_t>(model.index("k"))].v[kByThrust] = model.body.k;
    return coordinates;
  }

  /// The state as variables 0 to 5 of a Jet.
  RigidState<Jet> seeded() const {
    RigidState<Jet> state;
    for (int i = 0; i < 3; ++i) {
      state.eta(i) = Jet(at_.eta(i), i);
      state.nu(i) = Jet(at_.nu(i), 3 + i);
    }
    return state;
  }

  void compare(std::size_t k, FilterSample& s) const {
    const Measurement<Jet> seen = dynamics_.measure(seeded());
    for (int a = 0; a < 3; ++a) {
      s.innovation(a) = poses_(static_cast<Eigen::Index>(k), a) - seen.eta(a).a;
      for (int j = 0; j < 3; ++j) s.seen[a][j] = seen.eta(a).v[j];
    }
    s.innovation(2) = wrapAngle(s.innovation(2));
  }

  /// Increases the noise of an innovation beyond the Mahalanobis limit `cap` so that it equals the
  /// limit; sets the whitening and the log-density.
  static void weigh(const double S[3][3], double cap, double inverse[3][3], FilterSample& s) {
    double distance = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) distance += s.innovation(a) * inverse[a][b] * s.innovation(b);
    s.inflation = distance > cap ? distance / cap : 1;
    if (s.capped())
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) inverse[a][b] /= s.inflation;
    inverseRoot(S, 1 / std::sqrt(s.inflation), s.whitening);
    const double log_root = std::log(s.whitening[0][0] * s.whitening[1][1] * s.whitening[2][2]);
    s.log_density = s.starts ? 0 : log_root - 0.5 * distance / s.inflation;
  }

  void linearise(const RigidState<Jet>& to, FilterSample& s) const {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 6; ++j) {
        s.motion[i][j] = to.eta(i).v[j];
        s.motion[3 + i][j] = to.nu(i).v[j];
      }
    for (int i = 0; i < 3; ++i) {
      s.by_thrust[i] = to.eta(i).v[kByThrust];
      s.by_thrust[3 + i] = to.nu(i).v[kByThrust];
    }
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 3; ++j) {
        // mean of the derivatives by velocity at the step's start and end
        s.held[i][j] = 0.5 * s.dt * (s.motion[i][3 + j] + (i == 3 + j ? 1 : 0));
      }
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 3; ++j) {
        s.response[i][j] = 0;
        for (int l = 0; l < 3; ++l) s.response[i][j] += s.held[i][l] * mobility_(l, j);
      }
  }

  /// Adds a force in the room to the wrench that acts, by the heading in the middle of the step, and
  /// the derivative by this heading to that of the motion.
  void pushInRoom(const Vector2<double>& force, FilterSample& s) const {
    s.middle = Rotation<double>(at_.eta.z() + 0.5 * s.dt * at_.nu.z());
    const Vector2<double> body = s.middle.toBody(force);
    s.push.head<2>() += body;
    for (int i = 0; i < 6; ++i) {
      const double turned = s.response[i][0] * body.y() - s.response[i][1] * body.x();
      s.motion[i][2] += turned;
      s.motion[i][5] += 0.5 * s.dt * turned;
    }
  }

  const RunData& run_;
  const Eigen::MatrixX3d& poses_;
  Dynamics<Jet> dynamics_;
  Matrix3<double> mobility_;
  Random<double> random_;
  Simulation<Jet> simulation_;
  RigidState<double> at_;
  Vector3<double> push_ = Vector3<double>::Zero();  ///< the Ornstein-Uhlenbeck wrench, body
  Vector2<double> room_ = Vector2<double>::Zero();  ///< the Ornstein-Uhlenbeck force, room
  Eigen::Vector4d constant_ = Eigen::Vector4d::Zero();
  Covariance<double> covariance_;
};

}  // namespace

DisturbanceFilter::DisturbanceFilter(const RunData& run, double max_gap)
    : run_(run), poses_(run.poses.rows() == 0 ? run.eta : run.poses) {
  checkRun(run);
  checkGap(max_gap);
  const std::size_t count = run.times.size();
  starts_.assign(count, false);
  starts_[0] = true;
  for (std::size_t k = 1; k < count; ++k) starts_[k] = run.times[k] - run.times[k - 1] > max_gap;
  samples_.resize(count);
  wrench_.resize(static_cast<Eigen::Index>(count), 3);
  constants_.resize(static_cast<Eigen::Index>(count), 4);
}

double DisturbanceFilter::run(const Model& model, const DisturbanceLevels& levels, double cap,
                              std::vector<FilterBelief>* kept) {
  Pass pass(model, run_, poses_, levels);
  double likelihood = 0;
  std::size_t next = 0;  // belief to keep
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    FilterSample& s = samples_[k];
    s.starts = starts_[k];
    if (s.starts) pass.start(k);
    pass.correct(k, cap, s);
    likelihood += s.log_density;
    wrench_.row(static_cast<Eigen::Index>(k)) = pass.wrench();
    constants_.row(static_cast<Eigen::Index>(k)) = pass.constants();
    for (; kept && next < kept->size() && (*kept)[next].sample == static_cast<int>(k); ++next) {
      pass.keep((*kept)[next]);
      (*kept)[next].log_likelihood = likelihood;
    }
    const bool last = k + 1 == samples_.size() || starts_[k + 1];
    s.dt = last ? 0 : run_.times[k + 1] - run_.times[k];
    if (s.dt <= 0) continue;
    pass.move(k, s);
    if (!std::isfinite(likelihood) || !pass.finite())
      return std::numeric_limits<double>::quiet_NaN();
  }
  constants_sigma_ = pass.constantsSigma();
  levels_ = levels;
  return likelihood;
}

double requireFinite(double log_likelihood) {
  if (!std::isfinite(log_likelihood))
    throw std::runtime_error("the model's motion along the recordings is not finite");
  return log_likelihood;
}

std::size_t DisturbanceFilter::lastOfStretch(std::size_t sample) const {
  const auto next = std::find(starts_.begin() + static_cast<std::ptrdiff_t>(sample) + 1,
                              starts_.end(), true);
  return static_cast<std::size_t>(next - starts_.begin()) - 1;
}

int DisturbanceFilter::blockCount(double block) const {
  if (!(block > 0)) throw std::invalid_argument("blocks of time must be longer than 0 s");
  const double duration = run_.times.back() - run_.times.front();
  const auto most = static_cast<double>(samples_.size());
  return static_cast<int>(std::clamp(std::round(duration / block), 1.0, most));
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

Eigen::MatrixXd DisturbanceFilter::responses(const Eigen::MatrixXd& acting) const {
  const int count = static_cast<int>(acting.cols() / 3);
  const Eigen::MatrixXd by_sample = acting.transpose();  // a sample's wrenches are neighbours
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(3 * static_cast<Eigen::Index>(samples_.size()), count);
  std::vector<double> x(kN * count, 0.0), white(3 * count);
  const Random<double> random = randomOf(levels_, run_.noise);
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const FilterSample& s = samples_[k];
    if (s.starts) forgetDeviation(x.data(), count);
    correctDeviation<double>(s, nullptr, x.data(), white.data(), count);
    if (!s.starts)
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < count; ++j)
          result(3 * static_cast<Eigen::Index>(k) + a, j) = -white[a * count + j];
    if (s.dt <= 0) continue;
    const Random<double>::Step step = random.over(s.dt);
    moveDeviation(s, step, x.data(), count);
    const double* const now = by_sample.col(static_cast<Eigen::Index>(k)).data();
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < count; ++j)
        x[i * count + j] += s.response[i][0] * now[3 * j] + s.response[i][1] * now[3 * j + 1] +
                            s.response[i][2] * now[3 * j + 2];
  }
  return result;
}

}  // namespace ground::detail
