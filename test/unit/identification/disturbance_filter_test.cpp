// The disturbance filter and its derivatives, compared with a plain Kalman filter of dense matrices
// and finite differences (docs/theory/likelihood.md).
#include "../../../src/ground/src/identification/disturbance_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "../artificial_run.h"
#include "../crafts.h"
#include "ground/model/measurement.h"
#include "ground/model/typical.h"

namespace ground::detail {
namespace disturbance_filter_test {

constexpr double kStep = 0.01;   // longest step of the filter's simulations [s]
constexpr double kMaxGap = 0.1;  // [s]
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// A craft whose motors lag and whose marker is off the centre.
Model craft() {
  return withValues(tinyWhoover(), {{"motor_lag.tau", 0.05},
                                    {"marker_offset.dx", 0.02},
                                    {"marker_offset.dy", -0.03},
                                    {"thrust_asymmetry.a", 0.05}});
}

/// Poses with noise, a missing sample, a repeated time, a gap and two outliers.
RunData flight(unsigned seed = 1) {
  RunData run = record(craft(), 2.4, 0, seed);
  run.noise = {4e-4, 6e-4, 5e-3};
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (Eigen::Index i = 0; i < run.eta.rows(); ++i)
    for (int c = 0; c < 3; ++c) run.eta(i, c) += 2 * run.noise(c) * normal(random);
  run.eta(70, 1) += 0.05;
  run.eta(200, 2) += 0.4;
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < run.eta.rows(); ++i)
    if (i != 40 && (i < 120 || i >= 150)) kept.push_back(i);
  RunData cut = run;
  cut.times.clear();
  for (std::size_t i = 0; i < kept.size(); ++i) {
    cut.times.push_back(run.times[static_cast<std::size_t>(kept[i])]);
    cut.eta.row(static_cast<Eigen::Index>(i)) = run.eta.row(kept[i]);
    cut.nu.row(static_cast<Eigen::Index>(i)) = run.nu.row(kept[i]);
  }
  const auto count = static_cast<Eigen::Index>(kept.size());
  cut.eta.conservativeResize(count, 3);
  cut.nu.conservativeResize(count, 3);
  cut.times[20] = cut.times[19];
  return cut;
}

/// Levels that all differ, in units of the craft.
DisturbanceLevels someLevels(const Model& model) {
  const double force = typical::force(model.body), moment = typical::moment(model.body);
  DisturbanceLevels levels;
  levels.sigma << 0.05 * force, 0.03 * force, 0.04 * moment;
  levels.time << 0.3, 0.2, 0.5;
  levels.sigma_room = 0.06 * force;
  levels.time_room = 0.7;
  levels.white << 0.004 * force, 0.003 * force, 0.002 * moment;
  levels.position = 1.3;
  levels.heading = 0.8;
  levels.trim << 0.01 * force, 0.02 * force, 0.015 * moment;
  levels.thrust = 0.03;
  return levels;
}

/// What a Kalman filter says at a sample.
struct Seen {
  Vector3<double> innovation, white;
  Matrix3<double> S;
  FilterVector mean, predicted;
  FilterMatrix covariance;
  double density = 0;
  bool capped = false, starts = false;
};

/// The filter by the textbook: dense matrices, derivatives by finite differences.
class PlainFilter {
 public:
  PlainFilter(const Model& model, const RunData& run)
      : run_(run),
        model_(model),
        dynamics_(model),
        slow_(dynamicsOf(1 - kChange)),
        fast_(dynamicsOf(1 + kChange)) {
    const Dynamics<double> plain(model);
    mobility_ = plain.mass().inverse();
  }

  /// `known`: outliers are corrected by these gains instead of the filter's own.
  std::vector<Seen> run(const DisturbanceLevels& levels, double cap,
                        const std::vector<FilterSample>* known = nullptr) const {
    const RigidState<double> rest;
    Simulation<double> middle(dynamics_, run_.inputs, rest, run_.times[0], kStep);
    Simulation<double> slow(slow_, run_.inputs, rest, run_.times[0], kStep);
    Simulation<double> fast(fast_, run_.inputs, rest, run_.times[0], kStep);
    FilterVector x = FilterVector::Zero();
    FilterMatrix P = FilterMatrix::Zero();
    std::vector<Seen> found;
    for (std::size_t k = 0; k < run_.times.size(); ++k) {
      const double now = run_.times[k];
      Seen seen;
      seen.starts = k == 0 || now - run_.times[k - 1] > kMaxGap;
      if (seen.starts) {
        if (k > 0)
          for (auto* simulation : {&middle, &slow, &fast}) {
            simulation->state() = {};
            simulation->advance(now);
          }
        start(k, levels, x, P);
      }
      seen.predicted = x;
      correct(k, levels, cap, known, x, P, seen);
      seen.mean = x;
      seen.covariance = P;
      found.push_back(seen);
      if (k + 1 == run_.times.size()) break;
      const double next = run_.times[k + 1], dt = next - now;
      if (dt == 0 || dt > kMaxGap) continue;
      FilterMatrix F = FilterMatrix::Identity(), Q = FilterMatrix::Zero();
      Eigen::Matrix<double, 6, 6> motion;
      for (int i = 0; i < 6; ++i) {
        Eigen::Matrix<double, 6, 1> up = x.head<6>(), down = up;
        up(i) += kChange;
        down(i) -= kChange;
        motion.col(i) = (moved(middle, up, next) - moved(middle, down, next)) / (2 * kChange);
      }
      const Eigen::Matrix<double, 6, 1> here = x.head<6>();
      const Eigen::Matrix<double, 6, 1> by_thrust =
          (moved(fast, here, next) - moved(slow, here, next)) / (2 * kChange);
      for (auto* simulation : {&middle, &slow, &fast}) {
        simulation->state() = stateOf(here);
        simulation->advance(next);
      }
      Eigen::Matrix<double, 6, 3> nearly = motion.rightCols<3>();
      nearly.bottomRows<3>() += Matrix3<double>::Identity();
      const Eigen::Matrix<double, 6, 3> response = 0.5 * dt * nearly * mobility_;
      Vector3<double> left, mean, added, density;
      for (int i = 0; i < 3; ++i) {
        left(i) = std::exp(-dt / levels.time(i));
        mean(i) = levels.time(i) / dt * (1 - left(i));
        added(i) = std::pow(levels.sigma(i), 2) * (1 - left(i) * left(i));
        density(i) = std::pow(levels.white(i), 2) / dt;
      }
      const double part = dt / levels.time_room, room_left = std::exp(-part);
      const double room_mean = (1 - room_left) / part;
      const double room_added = std::pow(levels.sigma_room, 2) * (1 - room_left * room_left);
      const Vector2<double> force = room_mean * x.segment<2>(9);
      const auto pushed = [&](const Eigen::Matrix<double, 6, 1>& from) {  // by the force in the room
        const double heading = from(2) + 0.5 * dt * from(5);
        return Eigen::Matrix<double, 6, 1>(response.leftCols<2>() * worldToBody(heading, force));
      };
      const Eigen::Rotation2Dd back(-here(2) - 0.5 * dt * here(5));
      const Eigen::Matrix<double, 6, 2> room = response.leftCols<2>() * back.toRotationMatrix();
      F.topLeftCorner<6, 6>() = motion;
      for (const int i : {2, 5}) {
        const Eigen::Matrix<double, 6, 1> step = kChange * Eigen::Matrix<double, 6, 1>::Unit(i);
        F.block<6, 1>(0, i) += (pushed(here + step) - pushed(here - step)) / (2 * kChange);
      }
      F.block<6, 3>(0, 6) = response * mean.asDiagonal();
      F.block<6, 2>(0, 9) = room * room_mean;
      F.block<6, 3>(0, 11) = response;
      F.block<6, 1>(0, 14) = by_thrust;
      F.block<3, 3>(6, 6) = left.asDiagonal();
      F.block<2, 2>(9, 9) *= room_left;
      Q.topLeftCorner<6, 6>() =
          response * Vector3<double>(added / 3 + density).asDiagonal() * response.transpose() +
          room * room_added / 3 * room.transpose();
      Q.block<6, 3>(0, 6) = response * Vector3<double>(added / 2).asDiagonal();
      Q.block<6, 2>(0, 9) = room * room_added / 2;
      Q.block<5, 6>(6, 0) = Q.block<6, 5>(0, 6).transpose();
      Q.block<3, 3>(6, 6) = added.asDiagonal();
      Q(9, 9) = Q(10, 10) = room_added;
      const FilterVector before = x;
      x = F * x;
      x.head<6>() += motionOf(middle.state()) - F.topLeftCorner<6, 6>() * before.head<6>();
      P = F * P * F.transpose() + Q;
    }
    return found;
  }

 private:
  static constexpr double kChange = 1e-5;

  static RigidState<double> stateOf(const Eigen::Matrix<double, 6, 1>& x) {
    return {x.head<3>(), x.tail<3>()};
  }
  static Eigen::Matrix<double, 6, 1> motionOf(const RigidState<double>& state) {
    Eigen::Matrix<double, 6, 1> x;
    x << state.eta, state.nu;
    return x;
  }
  static Eigen::Matrix<double, 6, 1> moved(Simulation<double> simulation,
                                           const Eigen::Matrix<double, 6, 1>& from, double until) {
    simulation.state() = stateOf(from);
    simulation.advance(until);
    return motionOf(simulation.state());
  }

  Dynamics<double> dynamicsOf(double thrust) const {
    Model model = model_;
    model.setValue("k", thrust * model.value("k"));
    return Dynamics<double>(model);
  }

  void start(std::size_t k, const DisturbanceLevels& levels, FilterVector& x, FilterMatrix& P) const {
    const auto row = static_cast<Eigen::Index>(k);
    const Dynamics<Jet> exact(model_);
    x.head<6>() = motionOf(stateSeenAs(exact, {run_.eta.row(row).transpose(), run_.nu.row(row).transpose()}));
    x.segment<5>(6).setZero();
    FilterVector variance = FilterVector::Zero();
    variance.head<9>() << 0.01, 0.01, 0.25, 0.09, 0.09, 9, levels.sigma.array().square();
    variance.segment<2>(9).setConstant(std::pow(levels.sigma_room, 2));
    if (k == 0) {
      variance.tail<4>() << levels.trim.array().square(), levels.thrust * levels.thrust;
      P = variance.asDiagonal();
      return;
    }
    const Eigen::Matrix4d constants = P.bottomRightCorner<4, 4>();
    P = variance.asDiagonal();
    P.bottomRightCorner<4, 4>() = constants;
  }

  Vector3<double> measured(const Eigen::Matrix<double, 6, 1>& x) const {
    return dynamics_.measure(stateOf(x)).eta;
  }

  void correct(std::size_t k, const DisturbanceLevels& levels, double cap,
               const std::vector<FilterSample>* known, FilterVector& x, FilterMatrix& P, Seen& seen) const {
    Eigen::Matrix<double, 3, 15> H = Eigen::Matrix<double, 3, 15>::Zero();
    for (int i = 0; i < 3; ++i) {
      Eigen::Matrix<double, 6, 1> up = x.head<6>(), down = up;
      up(i) += kChange;
      down(i) -= kChange;
      H.col(i) = (measured(up) - measured(down)) / (2 * kChange);
    }
    Vector3<double> noise = run_.noise;
    noise.head<2>() *= levels.position;
    noise(2) *= levels.heading;
    seen.S = H * P * H.transpose();
    seen.S.diagonal() += noise.array().square().matrix();
    seen.innovation = run_.eta.row(static_cast<Eigen::Index>(k)).transpose() - measured(x.head<6>());
    seen.innovation(2) = std::remainder(seen.innovation(2), 2 * M_PI);
    const double distance = seen.innovation.dot(seen.S.inverse() * seen.innovation);
    seen.capped = known ? (*known)[k].capped() : distance > cap;
    const double inflation = seen.capped ? distance / cap : 1;
    const Matrix3<double> root = seen.S.llt().matrixL();
    seen.white = root.inverse() * seen.innovation / std::sqrt(inflation);
    seen.density = seen.starts ? 0
                               : -std::log(root.diagonal().prod()) - 1.5 * std::log(inflation) -
                                     0.5 * distance / inflation;
    Eigen::Matrix<double, 15, 3> gain = P * H.transpose() * seen.S.inverse() / inflation;
    if (known && seen.capped)
      for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 15; ++i) gain(i, a) = (*known)[k].gain(i, a);
    x += gain * seen.innovation;
    P -= gain * H * P;
    P.triangularView<Eigen::StrictlyLower>() = P.transpose();
  }

  const RunData& run_;
  Model model_;
  Dynamics<double> dynamics_, slow_, fast_;
  Matrix3<double> mobility_;
};

class Filtered : public testing::TestWithParam<double> {
 protected:
  Filtered() : plain_(model_, run_), filter_(run_), kept_(4) {
    const int samples[] = {0, 30, 125, 205};
    for (std::size_t i = 0; i < kept_.size(); ++i) kept_[i].sample = samples[i];
    likelihood_ = filter_.run(model_, levels_, GetParam(), &kept_);
    seen_ = plain_.run(levels_, GetParam());
  }

  const Model model_ = craft();
  const RunData run_ = flight();
  const DisturbanceLevels levels_ = someLevels(model_);
  const PlainFilter plain_;
  DisturbanceFilter filter_;
  std::vector<FilterBelief> kept_;
  double likelihood_;
  std::vector<Seen> seen_;
};
INSTANTIATE_TEST_SUITE_P(Caps, Filtered, testing::Values(kInfinity, 25.0));

TEST_P(Filtered, AgreesWithAPlainKalmanFilter) {
  double sum = 0;
  int starts = 0, capped = 0;
  std::size_t belief = 0;
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const Seen& seen = seen_[k];
    const FilterSample& s = filter_.samples()[k];
    ASSERT_EQ(s.starts, seen.starts) << k;
    ASSERT_EQ(s.capped(), seen.capped) << k;
    starts += s.starts;
    capped += s.capped();
    sum += seen.density;
    EXPECT_NEAR(s.log_density, seen.density, 1e-5 * (1 + std::abs(seen.density))) << k;
    EXPECT_LT((filter_.samples()[k].whitened() - seen.white).norm(), 1e-5 * (1 + seen.white.norm())) << k;
    EXPECT_LT((s.innovation - seen.innovation).norm(), 1e-7) << k;
    const auto row = static_cast<Eigen::Index>(k);
    const FilterVector deviation = seen.covariance.diagonal().cwiseSqrt();
    const auto near = [&](const Vector3<double>& found, int at) {
      const Vector3<double> error = found - seen.mean.segment<3>(at);
      return (error.array() / deviation.segment<3>(at).array()).matrix().norm() < 1e-4;
    };
    EXPECT_TRUE(near(s.filtered.eta, 0)) << k;
    EXPECT_TRUE(near(s.filtered.nu, 3)) << k;
    Vector3<double> wrench = filter_.wrench().row(row).transpose();
    wrench.head<2>() -= worldToBody(seen.mean(2), Vector2<double>(seen.mean.segment<2>(9)));
    EXPECT_TRUE(near(wrench, 6)) << k;
    EXPECT_TRUE(near(filter_.constantsSoFar().row(row).head<3>(), 11)) << k;
    EXPECT_NEAR(filter_.constantsSoFar()(row, 3), seen.mean(14), 1e-4 * deviation(14)) << k;
    if (belief == kept_.size() || kept_[belief].sample != static_cast<int>(k)) continue;
    const FilterBelief& kept = kept_[belief++];
    EXPECT_LT(((kept.mean - seen.mean).array() / deviation.array()).matrix().norm(), 1e-4) << k;
    const FilterMatrix error = kept.covariance - seen.covariance;
    const FilterVector over = deviation.cwiseInverse();
    EXPECT_LT((over.asDiagonal() * error * over.asDiagonal()).norm(), 1e-5) << k;
    EXPECT_EQ(kept.covariance, kept.covariance.transpose());
    EXPECT_NEAR(kept.log_likelihood, sum, 1e-5 * std::abs(sum)) << k;
  }
  EXPECT_EQ(belief, kept_.size());
  EXPECT_EQ(starts, 2);
  EXPECT_EQ(capped > 0, std::isfinite(GetParam()));
  EXPECT_NEAR(likelihood_, sum, 1e-5 * std::abs(sum));
  const FilterVector deviation = seen_.back().covariance.diagonal().cwiseSqrt();
  EXPECT_LT((filter_.constantsSigma() - deviation.tail<4>()).norm(), 1e-5 * deviation.tail<4>().norm());
  EXPECT_EQ(filter_.constants(), Eigen::Vector4d(filter_.constantsSoFar().bottomRows<1>()));
  for (const double block : {0.3, 1.0, 1e9}) {
    const Eigen::VectorXd parts = filter_.densities(block);
    EXPECT_EQ(parts.size(), std::max(1L, std::lround(run_.times.back() / block)));
    EXPECT_NEAR(parts.sum(), likelihood_, 1e-9 * std::abs(likelihood_));
    double first = 0;  // samples are divided equally
    for (std::size_t k = 0; k * parts.size() < seen_.size(); ++k) first += seen_[k].density;
    EXPECT_NEAR(parts(0), first, 1e-4 * std::abs(first)) << block;
  }
}

/// The whitened innovations of the filter in a changed world. Its gains are fixed, but those of
/// capped poses fall with the squared distance of the innovation.
class FixedGains {
 public:
  FixedGains(const RunData& run, const DisturbanceFilter& filter, const DisturbanceLevels& levels)
      : run_(run), filter_(filter), levels_(levels) {}

  /// Mobility: inverse of the mass. `acting`: additional wrench at each sample. `states`: the
  /// filtered states, if they are asked for.
  Eigen::VectorXd whitened(const Dynamics<double>& dynamics, const Matrix3<double>& mobility,
                           const Eigen::MatrixX3d* acting = nullptr,
                           std::vector<FilterVector>* states = nullptr) const {
    Simulation<double> simulation(dynamics, run_.inputs, {}, run_.times[0], kStep);
    FilterVector x = FilterVector::Zero();
    Eigen::VectorXd white(3 * static_cast<Eigen::Index>(run_.times.size()));
    for (std::size_t k = 0; k < run_.times.size(); ++k) {
      const FilterSample& s = filter_.samples()[k];
      const auto row = static_cast<Eigen::Index>(k);
      if (s.starts) {
        if (k > 0) {
          simulation.state() = {};
          simulation.advance(run_.times[k]);
        }
        x.head<11>() << s.predicted.eta, s.predicted.nu, 0, 0, 0, 0, 0;
      }
      Vector3<double> innovation =
          run_.eta.row(row).transpose() - dynamics.measure({x.head<3>(), x.segment<3>(3)}).eta;
      innovation(2) = std::remainder(innovation(2), 2 * M_PI);
      double distance = 0, usual = 0;
      for (int a = 0; a < 3; ++a) {
        white(3 * row + a) = 0;
        for (int b = 0; b < 3; ++b) white(3 * row + a) += s.whitening(a, b) * innovation(b);
        distance += std::pow(white(3 * row + a), 2);
        usual += std::pow(filter_.samples()[k].whitened()(a), 2);
      }
      const double share = s.inflation > 1 ? usual / distance : 1;
      for (int a = 0; a < 3; ++a)
        for (int i = 0; i < 15; ++i) x(i) += share * s.gain(i, a) * innovation(a);
      if (states) states->push_back(x);
      if (s.dt == 0) continue;
      Vector3<double> push = x.segment<3>(11);
      for (int i = 0; i < 3; ++i) {
        const double decay = std::exp(-s.dt / levels_.time(i));
        push(i) += x(6 + i) * levels_.time(i) / s.dt * (1 - decay);
        x(6 + i) *= decay;
      }
      const double part = s.dt / levels_.time_room, decay = std::exp(-part);
      const Vector2<double> room = (1 - decay) / part * x.segment<2>(9);
      push.head<2>() += worldToBody(x(2) + 0.5 * s.dt * x(5), room);
      x.segment<2>(9) *= decay;
      if (acting) push += acting->row(row).transpose();
      simulation.state() = {x.head<3>(), x.segment<3>(3)};
      simulation.advance(run_.times[k + 1]);
      x.head<3>() = simulation.state().eta;
      x.segment<3>(3) = simulation.state().nu;
      const Vector3<double> faster = mobility * push;
      for (int i = 0; i < 6; ++i) {
        x(i) += s.by_thrust[i] * x(14);
        for (int l = 0; l < 3; ++l) x(i) += s.held(i, l) * faster(l);
      }
    }
    return white;
  }

 private:
  const RunData& run_;
  const DisturbanceFilter& filter_;
  const DisturbanceLevels& levels_;
};

/// Nine parameters: more than fit into a register.
const std::vector<std::string> kFree = {"I_z",
                                        "X_u",
                                        "Y_v",
                                        "N_r",
                                        "k",
                                        "motor_lag.tau",
                                        "marker_offset.dx",
                                        "marker_offset.dy",
                                        "thrust_asymmetry.a"};

TEST_P(Filtered, ParameterScoresAreThoseOfFiniteDifferencesWithFixedGains) {
  const Free free = makeFree(model_, kFree);
  const FixedGains fixed(run_, filter_, levels_);
  const auto n = static_cast<Eigen::Index>(kFree.size());
  Eigen::MatrixXd by_wrench(3 * seen_.size(), n), by_acceleration = by_wrench;
  std::vector<Eigen::MatrixXd> sensitivity(kept_.size(), Eigen::MatrixXd(15, n));
  const Matrix3<double> here = Dynamics<double>(model_).mass().inverse();
  for (Eigen::Index j = 0; j < n; ++j) {
    constexpr double kChange = 1e-4;
    std::vector<double> up = model_.coordinates(), down = up;
    const auto at = static_cast<std::size_t>(j);
    up[free.index[at]] += kChange * free.scale[at];
    down[free.index[at]] -= kChange * free.scale[at];
    const Dynamics<double> more(model_, up), less(model_, down);
    std::vector<FilterVector> above, below;
    by_wrench.col(j) = (fixed.whitened(more, more.mass().inverse(), nullptr, &above) -
                        fixed.whitened(less, less.mass().inverse(), nullptr, &below)) /
                       (2 * kChange);
    by_acceleration.col(j) = (fixed.whitened(more, here) - fixed.whitened(less, here)) / (2 * kChange);
    for (std::size_t i = 0; i < kept_.size(); ++i) {
      const auto sample = static_cast<std::size_t>(kept_[i].sample);
      sensitivity[i].col(j) = (above[sample] - below[sample]) / (2 * kChange);
    }
  }
  for (std::size_t k = 0; k < seen_.size(); ++k)
    if (seen_[k].starts)
      for (Eigen::MatrixXd* rows : {&by_wrench, &by_acceleration})
        rows->middleRows<3>(3 * static_cast<Eigen::Index>(k)).setZero();
  // The log-density of a capped pose is -3/2 log D at the squared distance D, that of others -D/2.
  Eigen::VectorXd weight = Eigen::VectorXd::Ones(3 * static_cast<Eigen::Index>(seen_.size()));
  for (std::size_t k = 0; k < seen_.size(); ++k)
    if (seen_[k].capped) weight.segment<3>(3 * static_cast<Eigen::Index>(k)).setConstant(3 / GetParam());
  const Eigen::MatrixXd information = by_wrench.transpose() * weight.asDiagonal() * by_wrench;
  const Eigen::MatrixXd accelerated = by_acceleration.transpose() * weight.asDiagonal() * by_acceleration;
  const Eigen::VectorXd size = information.diagonal().cwiseSqrt();
  std::vector<FilterBelief> kept = kept_;
  const RunScores found = filter_.scores(model_, free, 0.5, &kept);
  const auto relative = [](const Eigen::MatrixXd& error, const Eigen::VectorXd& of) {
    return (of.cwiseInverse().asDiagonal() * error * of.cwiseInverse().asDiagonal()).norm();
  };
  EXPECT_LT(relative(found.information - information, size), 1e-4);
  EXPECT_LT(relative(found.by_acceleration - accelerated, accelerated.diagonal().cwiseSqrt()), 1e-4);
  const Eigen::Index blocks = found.score.rows();
  EXPECT_EQ(blocks, std::lround(run_.times.back() / 0.5));
  Eigen::MatrixXd score = Eigen::MatrixXd::Zero(blocks, n);
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    score.row(row * blocks / static_cast<Eigen::Index>(seen_.size())) -=
        weight(3 * row) * filter_.samples()[k].whitened().transpose() * by_wrench.middleRows<3>(3 * row);
  }
  for (Eigen::Index j = 0; j < n; ++j)
    EXPECT_LT((found.score.col(j) - score.col(j)).norm(), 1e-3 * score.col(j).norm()) << kFree[j];
  for (std::size_t i = 0; i < kept.size(); ++i)
    for (int r = 0; r < 15; ++r)
      for (Eigen::Index j = 0; j < n; ++j)
        EXPECT_NEAR(kept[i].sensitivity(r, j), sensitivity[i](r, j),
                    1e-4 * (sensitivity[i].row(r).norm() + 1e-6))
            << i << r << j;
}

TEST_P(Filtered, LevelScoresAreThoseOfFiniteDifferences) {
  const RunLevelScores found = filter_.levelScores(levels_);
  const auto count = static_cast<Eigen::Index>(kLevels);
  std::vector<std::vector<Seen>> up, down;
  constexpr double kChange = 1e-3;
  for (std::size_t i = 0; i < kLevels; ++i)
    for (auto* changed : {&up, &down}) {
      auto values = levels_.values();
      values[i] *= std::exp(changed == &up ? kChange : -kChange);
      changed->push_back(plain_.run(DisturbanceLevels::of(values), GetParam(), &filter_.samples()));
    }
  Eigen::VectorXd score = Eigen::VectorXd::Zero(count);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(count, count);
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    if (seen_[k].starts || seen_[k].capped) continue;
    const Matrix3<double> inverse = seen_[k].S.inverse();
    std::vector<Vector3<double>> e;
    std::vector<Matrix3<double>> S;
    for (std::size_t i = 0; i < kLevels; ++i) {
      e.push_back((up[i][k].innovation - down[i][k].innovation) / (2 * kChange));
      S.push_back((up[i][k].S - down[i][k].S) / (2 * kChange));
      score(static_cast<Eigen::Index>(i)) += (up[i][k].density - down[i][k].density) / (2 * kChange);
      for (std::size_t j = 0; j <= i; ++j)
        information(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) +=
            e[i].dot(inverse * e[j]) + 0.5 * (inverse * S[i] * inverse * S[j]).trace();
    }
  }
  information.triangularView<Eigen::StrictlyUpper>() = information.transpose();
  // Changed levels change the linearisation, too, which the score leaves out.
  for (Eigen::Index i = 0; i < count; ++i) {
    const double size = std::sqrt(information(i, i));
    EXPECT_NEAR(found.score(i), score(i), 0.02 * std::abs(score(i)) + 0.02 * size)
        << DisturbanceLevels::names()[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < count; ++j)
      EXPECT_NEAR(found.information(i, j), information(i, j), 0.01 * size * std::sqrt(information(j, j)))
          << i << ' ' << j;
  }
}

TEST_P(Filtered, ResponsesAreThoseOfFiniteDifferencesWithFixedGains) {
  const std::vector<int> channels = {2, 0, 1};
  const auto samples = static_cast<Eigen::Index>(seen_.size());
  Eigen::MatrixXd acting = Eigen::MatrixXd::Zero(samples, 9);  // three wrenches, a channel each
  const Vector3<double> size(typical::moment(model_.body), typical::force(model_.body),
                             typical::force(model_.body));
  for (Eigen::Index k = 0; k < samples; ++k)
    for (int c = 0; c < 3; ++c)
      acting(k, 3 * c + channels[static_cast<std::size_t>(c)]) = size(c) * std::sin((3 + c) * 0.05 * k);
  const Eigen::MatrixXd found = filter_.responses(acting);
  const FixedGains fixed(run_, filter_, levels_);
  const Dynamics<double> dynamics(model_);
  for (int c = 0; c < 3; ++c) {
    constexpr double kChange = 1e-4;
    Eigen::MatrixX3d up = Eigen::MatrixX3d::Zero(samples, 3);
    up.col(channels[static_cast<std::size_t>(c)]) =
        kChange * acting.col(3 * c + channels[static_cast<std::size_t>(c)]);
    const Eigen::MatrixX3d down = -up;
    const Matrix3<double> mobility = dynamics.mass().inverse();
    // Minus the change of the innovations: the wrench that a model without it leaves unexplained.
    Eigen::VectorXd finite =
        (fixed.whitened(dynamics, mobility, &down) - fixed.whitened(dynamics, mobility, &up)) / (2 * kChange);
    for (std::size_t k = 0; k < seen_.size(); ++k)
      if (seen_[k].starts) finite.segment<3>(3 * static_cast<Eigen::Index>(k)).setZero();
    EXPECT_LT((found.col(c) - finite).norm(), 1e-4 * finite.norm()) << c;
  }
}

}  // namespace disturbance_filter_test
}  // namespace ground::detail
