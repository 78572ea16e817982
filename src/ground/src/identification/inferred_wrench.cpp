#include "ground/identification/inferred_wrench.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "checks.h"
#include "ground/model/measurement.h"
#include "ground/model/typical.h"

namespace ground {
namespace detail {

/// An additional wrench whose value, with derivatives, is set from outside.
class OutsideWrench final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo info{"outside wrench", "wrench from outside the model", {}, 0};
    return info;
  }
  unsigned hooks() const override { return kWrench; }
  /// The object itself, because one thread sets the value and steps the dynamics.
  std::shared_ptr<const Effect> forThread() const override {
    return std::shared_ptr<const Effect>(std::shared_ptr<const Effect>(), this);
  }
  void wrench(const double*, const Point<double>&, Vector3<double>&) const override {}
  void wrench(const Jet*, const Point<Jet>&, Vector3<Jet>& wrench) const override { wrench += value; }

  Vector3<Jet> value = Vector3<Jet>::Zero();
};

}  // namespace detail
namespace {

using detail::OutsideWrench;

constexpr int kSettling = 10;  // samples for the filter to settle at the start of a stretch
// Limit of an innovation's squared Mahalanobis distance, 3 degrees of freedom.
constexpr double kMaxDistance = 25.0;

/// The state at a linearisation point, with zero wrench, as variables of a Jet. `columns`: which of
/// the nine elements of state and wrench are variables.
struct Seeded {
  RigidState<Jet> state;
  Vector3<Jet> wrench = Vector3<Jet>::Zero();

  Seeded(const RigidState<double>& at, const std::vector<int>& columns) {
    state.eta = at.eta.cast<Jet>();
    state.nu = at.nu.cast<Jet>();
    for (std::size_t j = 0; j < columns.size(); ++j) {
      const int i = columns[j];
      (i < 3 ? state.eta(i) : i < 6 ? state.nu(i - 3) : wrench(i - 6)).v[j] = 1;
    }
  }
};

/// Wrench of the thrusters: the acceleration that the inputs cause, times the mass matrix.
Vector3<double> thrustWrench(const Dynamics<Jet>& dynamics, OutsideWrench& outside, double t,
                             const RigidState<double>& at, const Thrusters<Jet>& input, double lift) {
  const Seeded seeded(at, {6, 7, 8});
  outside.value = seeded.wrench;
  const Vector3<Jet> with = dynamics.derivative(Jet(t), seeded.state, input, lift).nu;
  const Vector3<Jet> without =
      dynamics.derivative(Jet(t), seeded.state, Thrusters<Jet>::zero(input.size()), lift).nu;
  Matrix3<double> mobility;
  Vector3<double> change;
  for (int i = 0; i < 3; ++i) {
    mobility.row(i) = with(i).v.head<3>();
    change(i) = with(i).a - without(i).a;
  }
  return mobility.inverse() * change;
}

/// Throws std::invalid_argument on noise levels with which the filter is not defined.
void checkNoise(const WrenchNoise& noise) {
  const Eigen::Vector4d levels(noise.force, noise.moment, noise.position, noise.heading);
  if (!(levels.allFinite() && levels.minCoeff() >= 0 && levels.tail<2>().minCoeff() > 0))
    throw std::invalid_argument(
        "noise levels must be finite: of poses positive, of force and moment not negative");
}

double liftAt(const InputSequence& inputs, double t) {
  const auto next = std::upper_bound(inputs.times.begin(), inputs.times.end(), t);
  return next == inputs.times.begin() ? 0.0 : inputs.lift[next - inputs.times.begin() - 1];
}

}  // namespace

/// Results of the forward pass that the smoother needs, per sample.
struct WrenchFilter::Pass {
  explicit Pass(std::size_t count)
      : predicted(count),
        filtered(count),
        predicted_covariance(count),
        filtered_covariance(count),
        smoothing_gain(count),
        gain(count) {}

  std::vector<Vector9> predicted, filtered;
  std::vector<Matrix9> predicted_covariance, filtered_covariance, smoothing_gain;
  std::vector<Eigen::Matrix<double, 9, 3>> gain;
};

WrenchFilter::WrenchFilter(const Model& model, const RunData& run, double max_gap)
    : force_scale_(typical::force(model.body)), moment_scale_(typical::moment(model.body)) {
  detail::checkFree(run);
  detail::checkGap(max_gap);
  const int count = static_cast<int>(run.times.size());
  stretches_.push_back(0);
  for (int k = 1; k < count; ++k)
    if (run.times[k] - run.times[k - 1] > max_gap) stretches_.push_back(k);
  stretches_.push_back(count);
  linearise(model, run, run.poses.rows() == 0 ? run.eta : run.poses);
}

/// Simulations from sample to sample along the measured motion, with derivatives.
class WrenchFilter::Lineariser {
 public:
  Lineariser(const Model& model, const RunData& run, const Eigen::MatrixX3d& poses)
      : run_(run), poses_(poses), dynamics_(with(outside_, model)) {
    if (!model.effects.empty()) passes_.push_back({1});
    for (std::size_t k = 0; k < run.times.size(); ++k)
      along_.push_back(stateSeenAs(dynamics_, {run.eta.row(k), run.nu.row(k)}));
  }

  /// Begins a stretch at sample k.
  void start(std::size_t k) {
    simulations_.clear();
    for (std::size_t p = 0; p < passes_.size(); ++p)
      simulations_.emplace_back(dynamics_, run_.inputs, RigidState<Jet>(), run_.times[k]);
  }

  /// Linearises the measurement at sample k.
  void see(std::size_t k, Sample& sample) const {
    const Seeded here(along_[k], {0, 1, 2});  // a measured pose does not depend on the velocity
    const Measurement<Jet> seen = dynamics_.measure(here.state);
    for (int i = 0; i < 3; ++i) {
      sample.deviation(i) = poses_(k, i) - seen.eta(i).a;
      sample.seen.row(i).head<3>() = seen.eta(i).v.head<3>();
    }
    sample.deviation(2) = wrapAngle(sample.deviation(2));
    sample.heading = along_[k].eta(2);
  }

  /// The wrench of the thrusters at sample k, body.
  Vector3<double> thrust(std::size_t k) {
    return thrustWrench(dynamics_, outside_, run_.inputs.drive.since(run_.times[k]), along_[k],
                        simulations_[0].actuated(),
                        liftAt(run_.inputs, run_.times[k] - dynamics_.inputDelay().a));
  }

  /// Linearises the motion from sample k to the next.
  void move(std::size_t k, Sample& sample) {
    sample.dt = run_.times[k + 1] - run_.times[k];
    for (std::size_t p = 0; p < passes_.size(); ++p) {
      const Seeded seeded(along_[k], passes_[p]);
      outside_.value = seeded.wrench;
      simulations_[p].restart(seeded.state);
      simulations_[p].advance(run_.times[k + 1]);
      const RigidState<Jet>& to = simulations_[p].state();
      for (int i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < passes_[p].size(); ++j) {
          sample.transition(i, passes_[p][j]) = to.eta(i).v[j];
          sample.transition(3 + i, passes_[p][j]) = to.nu(i).v[j];
        }
        sample.offset(i) = to.eta(i).a - along_[k + 1].eta(i);
        sample.offset(3 + i) = to.nu(i).a - along_[k + 1].nu(i);
      }
    }
    sample.offset(2) = wrapAngle(sample.offset(2));
    if (!sample.transition.allFinite() || !sample.offset.allFinite())
      throw std::runtime_error("the model's motion is not finite in " + run_.name + " at " +
                               std::to_string(run_.times[k]) + " s");
  }

 private:
  static Model with(const OutsideWrench& outside, const Model& model) {
    Model augmented = model;
    augmented.effects.push_back({outside.forThread(), {}});
    return augmented;
  }

  const RunData& run_;
  const Eigen::MatrixX3d& poses_;
  detail::OutsideWrench outside_;
  Dynamics<Jet> dynamics_;
  /// The elements by which to differentiate in each pass. A Jet has eight derivatives; the ninth,
  /// by y, takes a second pass and matters only to effects that depend on the position.
  std::vector<std::vector<int>> passes_ = {{0, 2, 3, 4, 5, 6, 7, 8}};
  std::vector<RigidState<double>> along_;  ///< the measured motion
  std::vector<Simulation<Jet>> simulations_;
};

void WrenchFilter::linearise(const Model& model, const RunData& run, const Eigen::MatrixX3d& poses) {
  Lineariser lineariser(model, run, poses);
  samples_.resize(run.times.size());
  thrust_.resize(static_cast<Eigen::Index>(run.times.size()), 3);
  for (std::size_t s = 0; s + 1 < stretches_.size(); ++s) {
    const auto first = static_cast<std::size_t>(stretches_[s]);
    const auto end = static_cast<std::size_t>(stretches_[s + 1]);
    lineariser.start(first);
    for (std::size_t k = first; k < end; ++k) {
      lineariser.see(k, samples_[k]);
      thrust_.row(static_cast<Eigen::Index>(k)) = lineariser.thrust(k);
      if (k + 1 < end) lineariser.move(k, samples_[k]);
    }
  }
}

WrenchFilter::Matrix9 WrenchFilter::initialCovariance(WrenchNature nature, const WrenchNoise& noise) const {
  // Standard deviations of smoothed velocities, deliberately large [m/s], [rad/s].
  constexpr double kSpeed = 0.3, kYawRate = 3.0;
  Vector9 sigma;
  sigma << 3 * noise.position, 3 * noise.position, 3 * noise.heading, kSpeed, kSpeed, kYawRate, force_scale_,
      force_scale_, moment_scale_;
  if (nature == WrenchNature::kWhite) sigma.tail<3>().setZero();
  return sigma.cwiseAbs2().asDiagonal();
}

WrenchFilter::Matrix9 WrenchFilter::processNoise(const Sample& sample, WrenchNature nature,
                                                 const WrenchNoise& noise) const {
  Matrix9 Q = Matrix9::Zero();
  if (sample.dt <= 0) return Q;
  const Vector3<double> density = Vector3<double>(noise.force, noise.force, noise.moment).cwiseAbs2();
  const Eigen::Matrix<double, 6, 3> by_wrench = sample.transition.topRightCorner<6, 3>();
  const Eigen::Matrix<double, 6, 3> scaled = by_wrench * density.asDiagonal();
  if (nature == WrenchNature::kWhite) {
    Q.topLeftCorner<6, 6>() = scaled * by_wrench.transpose() / sample.dt;
    return Q;
  }
  // Integrals over a step during which the response to a wrench grows linearly.
  Q.topLeftCorner<6, 6>() = scaled * by_wrench.transpose() * (sample.dt / 3);
  Q.topRightCorner<6, 3>() = scaled * (sample.dt / 2);
  Q.bottomLeftCorner<3, 6>() = Q.topRightCorner<6, 3>().transpose();
  Q.bottomRightCorner<3, 3>() = (density * sample.dt).asDiagonal();
  return Q;
}

Innovations WrenchFilter::filter(WrenchNature nature, const WrenchNoise& noise, Pass* pass) const {
  const std::size_t count = samples_.size();
  Innovations result;
  result.normalised.resize(count, 3);
  result.valid.assign(count, false);
  const Vector3<double> variance = Vector3<double>(noise.position, noise.position, noise.heading).cwiseAbs2();
  const Matrix9 start = initialCovariance(nature, noise);
  for (std::size_t s = 0; s + 1 < stretches_.size(); ++s) {
    Vector9 x = Vector9::Zero();
    Matrix9 P = start;
    for (int k = stretches_[s]; k < stretches_[s + 1]; ++k) {
      const Sample& sample = samples_[k];
      if (pass) {
        pass->predicted[k] = x;
        pass->predicted_covariance[k] = P;
      }
      const Vector3<double> innovation = sample.deviation - sample.seen * x;
      const Eigen::Matrix<double, 9, 3> PH = P * sample.seen.transpose();
      Matrix3<double> S = sample.seen * PH;
      S.diagonal() += variance;
      Matrix3<double> inverse = S.inverse();
      const double distance = innovation.dot(inverse * innovation);
      const double inflation = std::max(1.0, distance / kMaxDistance);
      inverse /= inflation;
      const Vector2<double> ahead = worldToBody<double>(sample.heading, innovation.head<2>());
      const double c = std::cos(sample.heading), si = std::sin(sample.heading);
      const double same = 2 * c * si * S(0, 1);
      result.normalised.row(k) << ahead(0) / std::sqrt(c * c * S(0, 0) + si * si * S(1, 1) + same),
          ahead(1) / std::sqrt(si * si * S(0, 0) + c * c * S(1, 1) - same),
          innovation(2) / std::sqrt(S(2, 2));
      result.normalised.row(k) /= std::sqrt(inflation);
      if (k - stretches_[s] >= kSettling) {
        result.valid[k] = true;
        result.log_likelihood -=
            0.5 * (std::log(S.determinant()) + 3 * std::log(inflation) + std::min(distance, kMaxDistance));
      }
      const Eigen::Matrix<double, 9, 3> K = PH * inverse;
      x += K * innovation;
      P -= K * PH.transpose();
      if (pass) {
        pass->filtered[k] = x;
        pass->filtered_covariance[k] = P;
        pass->gain[k] = K;
      }
      x = (sample.transition * x + sample.offset).eval();
      const Matrix9 moved = sample.transition * P * sample.transition.transpose();
      P = 0.5 * (moved + moved.transpose()) + processNoise(sample, nature, noise);
    }
  }
  return result;
}

Innovations WrenchFilter::innovations(WrenchNature nature, const WrenchNoise& noise) const {
  checkNoise(noise);
  return filter(nature, noise, nullptr);
}

WrenchNoise WrenchFilter::likeliestNoise(WrenchNature nature) const {
  using Levels = std::array<double, 4>;
  const auto toNoise = [](const Levels& logs) {
    return WrenchNoise{std::exp(logs[0]), std::exp(logs[1]), std::exp(logs[2]), std::exp(logs[3])};
  };
  const auto likelihood = [&](const Levels& logs) {
    const double value = filter(nature, toNoise(logs), nullptr).log_likelihood;
    return std::isfinite(value) ? value : -std::numeric_limits<double>::infinity();
  };
  const double memory = nature == WrenchNature::kWhite ? 0.1 : 1.0;
  Levels logs = {std::log(0.3 * memory * force_scale_), std::log(0.3 * memory * moment_scale_),
                 std::log(5e-4), std::log(5e-3)};
  const Levels lowest = {std::log(1e-6 * force_scale_), std::log(1e-6 * moment_scale_), std::log(1e-6),
                         std::log(1e-5)};
  double best = likelihood(logs);
  for (const double factor : {6.0, 2.5, 1.6, 1.25}) {
    const double step = std::log(factor);
    for (bool moved = true; moved;) {
      moved = false;
      for (std::size_t i = 0; i < logs.size(); ++i) {
        for (const double sign : {1.0, -1.0}) {
          Levels other = logs;
          bool better = false;
          for (;;) {
            other[i] += sign * step;
            const double value = other[i] > lowest[i] ? likelihood(other) : best;
            if (!(value > best + 1e-3)) break;
            best = value;
            logs = other;
            moved = better = true;
          }
          if (better) break;
        }
      }
    }
  }
  return toNoise(logs);
}

InferredWrench WrenchFilter::smooth(const WrenchNoise& noise, const Eigen::MatrixXd& acting,
                                    const std::vector<int>& channels) const {
  const auto count = static_cast<Eigen::Index>(samples_.size());
  checkNoise(noise);
  detail::checkActing(acting, channels, samples_.size());
  Pass pass(samples_.size());
  filter(WrenchNature::kRandomWalk, noise, &pass);

  InferredWrench result;
  result.wrench.resize(count, 3);
  result.sigma.resize(count, 3);
  for (std::size_t s = 0; s + 1 < stretches_.size(); ++s) {
    const int first = stretches_[s], last = stretches_[s + 1] - 1;
    Vector9 x = pass.filtered[last];
    Matrix9 P = pass.filtered_covariance[last];
    for (int k = last; k >= first; --k) {
      if (k < last) {
        // Rauch, Tung, Striebel 1965; scaled, because the states differ by orders of magnitude.
        const Matrix9& next = pass.predicted_covariance[k + 1];
        const Vector9 scale = next.diagonal().cwiseSqrt().cwiseInverse();
        const Matrix9 scaled = scale.asDiagonal() * next * scale.asDiagonal();
        const Matrix9 cross = scale.asDiagonal() * samples_[k].transition * pass.filtered_covariance[k];
        const Matrix9 gain = (scale.asDiagonal() * scaled.ldlt().solve(cross)).transpose();
        pass.smoothing_gain[k] = gain;
        x = pass.filtered[k] + gain * (x - pass.predicted[k + 1]);
        P = (pass.filtered_covariance[k] + gain * (P - next) * gain.transpose()).eval();
      }
      result.wrench.row(k) = x.tail<3>();
      result.sigma.row(k) = P.diagonal().tail<3>().cwiseMax(0).cwiseSqrt();
    }
  }
  respond(pass, acting, channels, result.responses);
  return result;
}

/// Responses to acting wrenches. The filter is linear, so its error under one wrench alone follows
/// from the same gains.
void WrenchFilter::respond(const Pass& pass, const Eigen::MatrixXd& acting, const std::vector<int>& channels,
                           Eigen::MatrixXd& responses) const {
  constexpr int kBatch = 16;  // wrenches computed together
  using Errors = Eigen::Matrix<double, 9, kBatch>;
  std::vector<Errors> predicted(samples_.size()), filtered(samples_.size());
  responses.resize(static_cast<Eigen::Index>(samples_.size()), acting.cols());
  for (Eigen::Index begin = 0; begin < acting.cols(); begin += kBatch) {
    const Eigen::Index end = std::min<Eigen::Index>(acting.cols(), begin + kBatch);
    for (std::size_t s = 0; s + 1 < stretches_.size(); ++s) {
      const int first = stretches_[s], last = stretches_[s + 1] - 1;
      for (int k = first; k <= last; ++k) {
        Errors error = Errors::Zero();
        if (k > first) error = samples_[k - 1].transition * filtered[k - 1];
        for (Eigen::Index j = begin; j < end; ++j)
          error(6 + channels[j], j - begin) += acting(k, j) - (k > first ? acting(k - 1, j) : 0.0);
        predicted[k] = error;
        filtered[k] = error - pass.gain[k] * (samples_[k].seen * error);
      }
      Errors error = filtered[last];
      for (int k = last; k >= first; --k) {
        if (k < last) error = (filtered[k] + pass.smoothing_gain[k] * (error - predicted[k + 1])).eval();
        for (Eigen::Index j = begin; j < end; ++j)
          responses(k, j) = acting(k, j) - error(6 + channels[j], j - begin);
      }
    }
  }
}

}  // namespace ground
