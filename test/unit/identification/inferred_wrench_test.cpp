// The missing wrench of a model from noisy poses, and predictions from a measured state.
#include "ground/identification/inferred_wrench.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <random>

#include "ground/control/input_design.h"
#include "ground/identification/prediction.h"
#include "ground/model/effect_registry.h"
#include "ground/model/measurement.h"
#include "ground/model/model_file.h"
#include "ground/model/typical.h"

namespace ground {
namespace inferred_wrench_test {

constexpr double kPositionNoise = 3e-4, kHeadingNoise = 5e-3;

Model nominal() { return loadModel("cfg/hovercraft/tiny_whoover.yaml"); }

Model with(const std::string& effects) {
  const std::string text = formatModel(nominal());
  return parseModel(text.substr(0, text.find("effects:")) + "effects:\n" + effects, "test");
}

/// A run with the true motion, along which the filter linearises, and noisy poses.
RunData record(const Model& model, double noise, unsigned seed = 1, double duration = 12) {
  RunData run;
  run.name = "artificial";
  PrbsParams params;
  params.clock = 15;
  params.duration = duration;
  const InputSignal prbs = playBits({makePrbs(9, seed), 1}, params);
  for (double t = 0; t < duration; t = prbs.nextChange(t)) run.inputs.add(t, prbs.at(t).thrusters, 1);
  const Dynamics<double> dynamics(model);
  Simulation<double> simulation(dynamics, run.inputs, {}, 0);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.6, 1.4);
  const int count = static_cast<int>(duration * 100);
  run.eta.resize(count, 3);
  run.nu.resize(count, 3);
  run.poses.resize(count, 3);
  double t = 0;
  for (int i = 0; i < count; ++i) {
    simulation.advance(t);
    run.times.push_back(t);
    run.eta.row(i) = simulation.measure().eta;
    run.nu.row(i) = simulation.measure().nu;
    const Vector3<double> sigma(kPositionNoise, kPositionNoise, kHeadingNoise);
    for (int c = 0; c < 3; ++c) run.poses(i, c) = run.eta(i, c) + noise * sigma(c) * normal(random);
    run.poses(i, 2) = wrapAngle(run.poses(i, 2));
    t += 0.01 * uniform(random);  // stamps are not uniform
  }
  return run;
}

/// Share of samples in which the inferred wrench is within two standard deviations of the truth.
double covered(const InferredWrench& inferred, const Eigen::MatrixX3d& truth, int channel) {
  const auto off = (inferred.wrench.col(channel) - truth.col(channel)).cwiseAbs();
  return (off.array() < 2 * inferred.sigma.col(channel).array()).cast<double>().mean();
}

TEST(Prediction, FollowsTheModelFromAMeasuredState) {
  for (const char* effects : {"  - {name: motor_lag, tau: 0.05}\n",
                              "  - {name: heading_offset, psi0: 3.0}\n"
                              "  - {name: marker_offset, dx: 0.02, dy: -0.01}\n"}) {
    const Model model = with(effects);
    const RunData recorded = record(model, 0);
    const std::vector<Window> windows = {{0, 100, 500}, {0, 300, 301}};
    Eigen::MatrixX3d nu(2, 3);
    for (int w = 0; w < 2; ++w) nu.row(w) = recorded.nu.row(windows[w].first);
    const WindowSimulation found = predict(model, recorded, windows, nu);
    for (int w = 0; w < 2; ++w) {
      const int rows = windows[w].last - windows[w].first + 1;
      const Eigen::MatrixXd eta = recorded.eta.middleRows(windows[w].first, rows);
      EXPECT_LT((found.eta[w] - eta).cwiseAbs().maxCoeff(), 1e-6) << effects;
    }
  }
  const RunData recorded = record(nominal(), 0, 1, 1);
  EXPECT_THROW(predict(nominal(), recorded, {{0, 50, 100}}, Eigen::MatrixX3d::Zero(1, 3)),
               std::invalid_argument);
  EXPECT_THROW(predict(nominal(), recorded, {{0, 0, 10}}, Eigen::MatrixX3d::Zero(2, 3)),
               std::invalid_argument);
}

TEST(InferredWrench, IsZeroWithTheTrueModel) {
  const RunData recorded = record(nominal(), 1);
  const WrenchFilter filter(nominal(), recorded);
  const WrenchNoise noise = filter.likeliestNoise(WrenchNature::kRandomWalk);
  EXPECT_NEAR(noise.position, kPositionNoise, 0.2 * kPositionNoise);
  EXPECT_NEAR(noise.heading, kHeadingNoise, 0.2 * kHeadingNoise);
  const InferredWrench inferred = filter.smooth(noise);
  EXPECT_LT(inferred.wrench.leftCols<2>().cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_LT(inferred.wrench.col(2).cwiseAbs().maxCoeff(), 3e-5);
}

TEST(InferredWrench, InnovationsOfTheTrueModelAreWhiteWithUnitVariance) {
  // Forces that depend on the place need the second pass of derivatives.
  const std::string tilt =
      "  - name: bowl\n"
      "    expression: {X: \"-c*(x*cos(psi)+y*sin(psi))\", Y: \"c*(x*sin(psi)-y*cos(psi))\"}\n"
      "    parameters:\n      c: {value: 0.05, unit: N/m, lower: 0, upper: 1}\n";
  for (const Model& model : {nominal(), with(tilt)}) {
    const RunData recorded = record(model, 1, 2);
    const WrenchFilter filter(model, recorded);
    const WrenchNoise noise = filter.likeliestNoise(WrenchNature::kWhite);
    const Innovations found = filter.innovations(WrenchNature::kWhite, noise);
    const int count = static_cast<int>(recorded.times.size());
    for (int c = 0; c < 3; ++c) {
      double square = 0, product = 0;
      int n = 0;
      for (int i = 1; i < count; ++i) {
        if (!found.valid[i] || !found.valid[i - 1]) continue;
        square += std::pow(found.normalised(i, c), 2);
        product += found.normalised(i, c) * found.normalised(i - 1, c);
        ++n;
      }
      EXPECT_NEAR(square / n, 1, 0.25) << "channel " << c;
      EXPECT_LT(std::abs(product / square), 3 / std::sqrt(n)) << "channel " << c;
    }
  }
}

TEST(InferredWrench, FindsAConstantWrench) {
  const Model truth = with(
      "  - {name: body_force_bias, x0: 0.01, y0: -0.02}\n"
      "  - {name: yaw_bias, n0: 2.0e-4}\n");
  const RunData recorded = record(truth, 1);
  const WrenchFilter filter(nominal(), recorded);
  const InferredWrench inferred = filter.smooth(filter.likeliestNoise(WrenchNature::kRandomWalk));
  const Vector3<double> wrench(0.01, -0.02, 2e-4);
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(inferred.wrench.col(c).mean(), wrench(c), 0.1 * std::abs(wrench(c))) << "channel " << c;
}

TEST(InferredWrench, FollowsAVaryingWrench) {
  const Model truth = with(
      "  - name: swell\n"
      "    expression: {X: \"a*sin(3*t)\", Y: \"a*cos(2*t)\", N: \"0.01*a*sin(4*t)\"}\n"
      "    parameters:\n      a: {value: 0.02, unit: N, lower: 0, upper: 1}\n");
  const RunData recorded = record(truth, 1, 3);
  const WrenchFilter filter(nominal(), recorded);
  const InferredWrench inferred = filter.smooth(filter.likeliestNoise(WrenchNature::kRandomWalk));
  const auto count = static_cast<Eigen::Index>(recorded.times.size());
  Eigen::MatrixX3d wrench(count, 3);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double t = recorded.times[i];
    wrench.row(i) << 0.02 * std::sin(3 * t), 0.02 * std::cos(2 * t), 2e-4 * std::sin(4 * t);
  }
  const Vector3<double> size(0.02, 0.02, 2e-4);
  for (int c = 0; c < 3; ++c) {
    const double rms = std::sqrt((inferred.wrench.col(c) - wrench.col(c)).squaredNorm() / count);
    EXPECT_LT(rms, 0.25 * size(c)) << "channel " << c;
    const double share = covered(inferred, wrench, c);
    EXPECT_GT(share, 0.85) << "channel " << c;
  }
}

TEST(InferredWrench, RespondsToAnActingWrenchAsPredicted) {
  // The force changes faster than the smoother can follow.
  const Model truth = with(
      "  - name: buzz\n"
      "    expression: {Y: \"a*(sin(12*t) > 0 ? 1 : -1)\"}\n"
      "    parameters:\n      a: {value: 0.01, unit: N, lower: 0, upper: 1}\n");
  const RunData with_force = record(truth, 0);
  const WrenchFilter filter(nominal(), with_force);
  const auto count = static_cast<Eigen::Index>(with_force.times.size());
  Eigen::MatrixXd acting(count, 1);
  for (Eigen::Index i = 0; i < count; ++i) acting(i) = std::sin(12 * with_force.times[i]) > 0 ? 0.01 : -0.01;
  WrenchNoise noise;
  noise.force = 0.005;
  noise.moment = 1e-3;
  noise.position = kPositionNoise;
  noise.heading = kHeadingNoise;
  const InferredWrench inferred = filter.smooth(noise, acting, {1});
  const Eigen::VectorXd found = inferred.wrench.col(1), predicted = inferred.responses.col(0);
  EXPECT_LT((found - predicted).norm(), 0.1 * found.norm());
  // The smoother attenuates the force.
  EXPECT_LT(found.norm(), 0.8 * acting.norm());
  EXPECT_GT(found.norm(), 0.2 * acting.norm());
}

TEST(InferredWrench, GivesTheModelsThrust) {
  const RunData recorded = record(nominal(), 0, 1, 2);
  const double k = nominal().body.k, l = nominal().body.l;
  const auto thrustOf = [&](const Model& model) { return WrenchFilter(model, recorded).modelThrust(); };
  const Eigen::MatrixX3d plain = thrustOf(nominal());
  const Eigen::MatrixX3d turned =
      thrustOf(with("  - {name: thrust_misalignment, angle: 1.5707963267948966}\n"
                    "  - {name: added_mass, mx: 0.01, my: 0.03}\n"));
  for (Eigen::Index i = 0; i < plain.rows(); ++i) {
    const auto& times = recorded.inputs.times;
    const auto at = std::upper_bound(times.begin(), times.end(), recorded.times[i]);
    const Thrusters<double> u = recorded.inputs.thrusters[at - times.begin() - 1];
    EXPECT_NEAR(plain(i, 0), k * (u(0) + u(1)), 1e-9);
    EXPECT_NEAR(plain(i, 1), 0, 1e-9);
    EXPECT_NEAR(plain(i, 2), k * l * (u(0) - u(1)), 1e-9);
    EXPECT_NEAR(turned(i, 0), 0, 1e-9);
    EXPECT_NEAR(turned(i, 1), k * (u(0) + u(1)), 1e-9);
  }
}

using Vector9 = Eigen::Matrix<double, 9, 1>;
using Matrix9 = Eigen::Matrix<double, 9, 9>;

/// Filter and smoother by the textbook (Kalman 1960; Rauch, Tung and Striebel 1965), about the
/// measured motion, with derivatives by finite differences.
class PlainFilter {
 public:
  PlainFilter(const Model& model, const RunData& run) : model_(model), run_(run) {
    for (const char* effect : {"body_force_bias", "yaw_bias"}) model_.addEffect(makeEffect(effect));
    const Dynamics<double> dynamics(model_);
    const Dynamics<Jet> exact(model_);
    const auto count = static_cast<Eigen::Index>(run.times.size());
    for (Eigen::Index k = 0; k < count; ++k) {
      const RigidState<double> at = stateSeenAs(exact, {run.eta.row(k), run.nu.row(k)});
      Vector9 x = Vector9::Zero();
      x.head<6>() << at.eta, at.nu;
      along_.push_back(x);
    }
    for (std::size_t k = 0; k < along_.size(); ++k) {
      const auto seen = [&](const Vector9& x) -> Eigen::VectorXd {
        return dynamics.measure({x.head<3>(), x.segment<3>(3)}).eta;
      };
      H_.push_back(jacobian(seen, along_[k], 3));
      const Vector3<double> measured = run.poses.row(static_cast<Eigen::Index>(k));
      Vector3<double> z = measured - seen(along_[k]);
      z(2) = std::remainder(z(2), 2 * M_PI);
      z_.push_back(z);
      F_.push_back(Matrix9::Identity());
      offset_.push_back(Vector9::Zero());
      dt_.push_back(0);
      if (k + 1 == along_.size() || run.times[k + 1] - run.times[k] > 0.1) continue;
      dt_[k] = run.times[k + 1] - run.times[k];
      const auto next = [&](const Vector9& x) -> Eigen::VectorXd { return moved(x, k); };
      F_[k].topRows<6>() = jacobian(next, along_[k], 6);
      offset_[k].head<6>() = next(along_[k]) - along_[k + 1].head<6>();
      offset_[k](2) = std::remainder(offset_[k](2), 2 * M_PI);
    }
  }

  struct Result {
    Eigen::MatrixX3d innovation, normalised, wrench, sigma;
    std::vector<double> density;  ///< of each pose, with its noise increased if it is an outlier
  };

  /// The model's deviations from the measured motion, seen by the run's poses.
  Result run(WrenchNature nature, const WrenchNoise& noise) const { return run(nature, noise, z_, offset_); }

  /// The wrench that is inferred if only the `acting` one disturbs and nothing else is random.
  Eigen::VectorXd response(const WrenchNoise& noise, const Eigen::VectorXd& acting, int channel) const {
    std::vector<Vector3<double>> z;
    Vector9 x = Vector9::Zero();
    for (std::size_t k = 0; k < along_.size(); ++k) {
      x(6 + channel) = acting(static_cast<Eigen::Index>(k));
      z.push_back(H_[k] * x);
      x = dt_[k] == 0 ? Vector9::Zero().eval() : (F_[k] * x).eval();
    }
    const std::vector<Vector9> none(along_.size(), Vector9::Zero());
    return run(WrenchNature::kRandomWalk, noise, z, none).wrench.col(channel);
  }

 private:
  template <typename F>
  static Eigen::MatrixXd jacobian(const F& f, const Vector9& at, int rows) {
    const double change[] = {1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-6};
    Eigen::MatrixXd found(rows, 9);
    for (int i = 0; i < 9; ++i) {
      const Vector9 step = change[i] * Vector9::Unit(i);
      found.col(i) = (f(at + step) - f(at - step)) / (2 * change[i]);
    }
    return found;
  }

  Eigen::VectorXd moved(const Vector9& x, std::size_t k) const {
    Model pushed = model_;
    pushed.setValue("body_force_bias.x0", x(6));
    pushed.setValue("body_force_bias.y0", x(7));
    pushed.setValue("yaw_bias.n0", x(8));
    const Dynamics<double> dynamics(pushed);
    Simulation<double> simulation(dynamics, run_.inputs, {x.head<3>(), x.segment<3>(3)}, run_.times[k]);
    simulation.advance(run_.times[k + 1]);
    Eigen::VectorXd to(6);
    to << simulation.state().eta, simulation.state().nu;
    return to;
  }

  Result run(WrenchNature nature, const WrenchNoise& noise, const std::vector<Vector3<double>>& z,
             const std::vector<Vector9>& offset) const {
    const bool white = nature == WrenchNature::kWhite;
    const auto count = static_cast<Eigen::Index>(along_.size());
    const double force = typical::force(model_.body), moment = typical::moment(model_.body);
    const Vector3<double> R(std::pow(noise.position, 2), std::pow(noise.position, 2),
                            std::pow(noise.heading, 2));
    const Vector3<double> density(std::pow(noise.force, 2), std::pow(noise.force, 2),
                                  std::pow(noise.moment, 2));
    Vector9 start;
    start << 9 * R, 0.09, 0.09, 9, force * force, force * force, moment * moment;
    if (white) start.tail<3>().setZero();
    Result result;
    for (Eigen::MatrixX3d* rows : {&result.innovation, &result.normalised, &result.wrench, &result.sigma})
      rows->resize(count, 3);
    std::vector<Vector9> x_before, x_after;
    std::vector<Matrix9> P_before, P_after;
    Vector9 x = Vector9::Zero();
    Matrix9 P = start.asDiagonal();
    for (Eigen::Index k = 0; k < count; ++k) {
      const auto at = static_cast<std::size_t>(k);
      x_before.push_back(x);
      P_before.push_back(P);
      const Vector3<double> e = z[at] - H_[at] * x;
      Matrix3<double> S = H_[at] * P * H_[at].transpose();
      S += R.asDiagonal();
      const double distance = e.dot(S.inverse() * e), more = std::max(1.0, distance / 25);
      Matrix3<double> turn = Matrix3<double>::Identity();  // to the axes of the craft
      turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(-along_[at](2)).toRotationMatrix();
      result.normalised.row(k) =
          (turn * e).array() / (turn * S * turn.transpose()).diagonal().array().sqrt() / std::sqrt(more);
      result.density.push_back(-0.5 * (std::log(S.determinant()) + 3 * std::log(more) + distance / more));
      const Eigen::Matrix<double, 9, 3> K = P * H_[at].transpose() * S.inverse() / more;
      x += K * e;
      P -= K * H_[at] * P;
      x_after.push_back(x);
      P_after.push_back(P);
      if (dt_[at] == 0) {  // a gap follows, or a repeated time
        const bool gap = k + 1 == count || run_.times[at + 1] > run_.times[at];
        if (gap) x.setZero();
        if (gap) P = start.asDiagonal();
        continue;
      }
      const Eigen::Matrix<double, 6, 3> by_wrench = F_[at].topRightCorner<6, 3>();
      Matrix9 Q = Matrix9::Zero();
      const Eigen::Matrix<double, 6, 6> shaken = by_wrench * density.asDiagonal() * by_wrench.transpose();
      if (white) {
        Q.topLeftCorner<6, 6>() = shaken / dt_[at];
      } else {
        Q.topLeftCorner<6, 6>() = shaken * dt_[at] / 3;
        Q.topRightCorner<6, 3>() = by_wrench * density.asDiagonal() * dt_[at] / 2;
        Q.bottomLeftCorner<3, 6>() = Q.topRightCorner<6, 3>().transpose();
        Q.bottomRightCorner<3, 3>() = (density * dt_[at]).asDiagonal();
      }
      x = F_[at] * x + offset[at];
      P = F_[at] * P * F_[at].transpose() + Q;
    }
    for (Eigen::Index k = count; k-- > 0;) {
      const auto at = static_cast<std::size_t>(k);
      if (dt_[at] == 0) {
        x = x_after[at];
        P = P_after[at];
      } else {
        const Vector9 unit = P_before[at + 1].diagonal().cwiseSqrt().cwiseInverse();
        const Matrix9 next = unit.asDiagonal() * P_before[at + 1] * unit.asDiagonal();
        const Matrix9 gain =
            P_after[at] * F_[at].transpose() * unit.asDiagonal() * next.inverse() * unit.asDiagonal();
        x = x_after[at] + gain * (x - x_before[at + 1]);
        P = P_after[at] + gain * (P - P_before[at + 1]) * gain.transpose();
      }
      result.wrench.row(k) = x.tail<3>();
      result.sigma.row(k) = P.diagonal().tail<3>().cwiseSqrt();
    }
    return result;
  }

  Model model_;
  const RunData& run_;
  std::vector<Vector9> along_, offset_;
  std::vector<Vector3<double>> z_;
  std::vector<Eigen::MatrixXd> H_;
  std::vector<Matrix9> F_;
  std::vector<double> dt_;
};

/// A craft on a floor that rises from its middle, with a marker off the centre and a turned frame.
Model bowl(double rise = 0.05) {
  return with(
      "  - name: bowl\n"
      "    expression: {X: \"-c*(x*cos(psi)+y*sin(psi))\", Y: \"c*(x*sin(psi)-y*cos(psi))\"}\n"
      "    parameters:\n      c: {value: " +
      std::to_string(rise) +
      ", unit: N/m, lower: 0, upper: 1}\n"
      "  - {name: heading_offset, psi0: 0.4}\n"
      "  - {name: marker_offset, dx: 0.02, dy: -0.03}\n");
}

/// A run of another craft than the model's, with a gap and outliers.
RunData disturbed() {
  RunData run = record(bowl(0.09), 1, 5, 3);
  for (std::size_t i = 170; i < run.times.size(); ++i) run.times[i] += 0.3;
  run.eta.col(0).array() += 1e-3;
  run.eta.col(2).array() += 0.01;
  run.nu.col(1).array() -= 0.02;
  return run;
}

WrenchNoise someNoise(WrenchNature nature) {
  const double memory = nature == WrenchNature::kWhite ? 0.1 : 1;
  const Body<double> body = nominal().body;
  return {0.2 * memory * typical::force(body), 0.3 * memory * typical::moment(body), 4e-4, 6e-3};
}

void expectNear(const Eigen::MatrixXd& found, const Eigen::MatrixXd& expected, double relative) {
  for (Eigen::Index c = 0; c < found.cols(); ++c)
    EXPECT_LT((found.col(c) - expected.col(c)).norm(), relative * expected.col(c).norm()) << c;
}

TEST(WrenchFilter, AgreesWithAPlainKalmanFilterAndSmoother) {
  RunData run = disturbed();
  run.poses(60, 0) += 0.02;
  run.poses(200, 2) += 0.3;
  const PlainFilter plain(bowl(), run);
  const WrenchFilter filter(bowl(), run);
  for (const WrenchNature nature : {WrenchNature::kRandomWalk, WrenchNature::kWhite}) {
    const WrenchNoise noise = someNoise(nature);
    const Innovations found = filter.innovations(nature, noise);
    const PlainFilter::Result expected = plain.run(nature, noise);
    expectNear(found.normalised, expected.normalised, 1e-4);
    double likelihood = 0;
    for (std::size_t k = 0; k < run.times.size(); ++k) {
      const bool settled = (k >= 10 && k < 170) || k >= 180;
      EXPECT_EQ(found.valid[k], settled) << k;
      if (settled) likelihood += expected.density[k];
    }
    EXPECT_NEAR(found.log_likelihood, likelihood, 1e-4 * std::abs(likelihood));
  }
  const WrenchNoise noise = someNoise(WrenchNature::kRandomWalk);
  const PlainFilter::Result expected = plain.run(WrenchNature::kRandomWalk, noise);
  const InferredWrench found = filter.smooth(noise);
  expectNear(found.wrench, expected.wrench, 1e-4);
  expectNear(found.sigma, expected.sigma, 1e-4);
}

TEST(WrenchFilter, TheLikeliestNoiseIsAMaximum) {
  const RunData run = disturbed();
  const WrenchFilter filter(bowl(), run);
  for (const WrenchNature nature : {WrenchNature::kRandomWalk, WrenchNature::kWhite}) {
    const WrenchNoise found = filter.likeliestNoise(nature);
    const double best = filter.innovations(nature, found).log_likelihood;
    double WrenchNoise::*const levels[] = {&WrenchNoise::force, &WrenchNoise::moment, &WrenchNoise::position,
                                           &WrenchNoise::heading};
    for (double WrenchNoise::*const level : levels)
      for (const double factor : {0.25, 0.8, 1.25, 4.0}) {
        WrenchNoise other = found;
        other.*level *= factor;
        EXPECT_LT(filter.innovations(nature, other).log_likelihood, best + 2e-3) << factor;
      }
  }
}

}  // namespace inferred_wrench_test
}  // namespace ground
