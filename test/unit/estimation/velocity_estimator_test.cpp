// Velocities from poses: the estimator and the smoother, also with bad poses.
#include "ground/estimation/velocity_estimator.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "ground/estimation/smoother.h"

namespace ground {
namespace velocity_estimator_test {

constexpr double kDt = 0.01;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// A craft on a circle: forward speed 1.5 m/s, sway 0.2 m/s, yaw rate 2 rad/s.
const Vector3<double> kCircleNu(1.5, 0.2, 2.0);

Vector3<double> circle(double t) {
  const double psi = 2.5 + 2 * t;  // wraps several times in some seconds
  const Vector2<double> p = bodyToWorld<double>(psi, {0.1, -0.75});
  // p' = r k x p = R (u, v) for u = 1.5, v = 0.2
  return {p.x(), p.y(), psi};
}

Vector3<double> wrapped(Vector3<double> eta) {
  eta.z() = wrapAngle(eta.z());
  return eta;
}

Eigen::MatrixX3d rows(const std::vector<Vector3<double>>& eta) {
  Eigen::MatrixX3d matrix(eta.size(), 3);
  for (std::size_t i = 0; i < eta.size(); ++i) matrix.row(i) = eta[i];
  return matrix;
}

/// Feeds the circle from pose `first` up to but not including pose `last`.
void feed(VelocityEstimator& estimator, int first, int last) {
  for (int i = first; i < last; ++i) estimator.update(i * kDt, wrapped(circle(i * kDt)));
}

void expectOnCircle(const StateEstimate& estimate, double t) {
  EXPECT_TRUE(estimate.valid) << estimate.status;
  EXPECT_LT((wrapped(estimate.eta) - wrapped(circle(t))).norm(), 2e-3);
  EXPECT_LT((estimate.nu - kCircleNu).norm(), 0.03) << estimate.nu.transpose();
}

TEST(VelocityEstimator, RampIsExact) {
  VelocityEstimator estimator({});
  const double psi = 0.4;
  for (int i = 0; i < 200; ++i) {
    const double t = i * kDt;
    estimator.update(1e9 + t, {1.2 * t, -0.5 * t + 3, psi});
  }
  const Vector2<double> expected = worldToBody<double>(psi, {1.2, -0.5});
  const StateEstimate& e = estimator.estimate();
  EXPECT_LT((e.nu.head<2>() - expected).norm(), 1e-5);  // stamps of 1e9 s resolve 1e-7 s
  EXPECT_LT(std::abs(e.nu.z()), 1e-9);
  EXPECT_LT(e.nu_dot.norm(), 1e-3);
}

TEST(VelocityEstimator, IsValidAfterFivePoses) {
  VelocityEstimator estimator({});
  EXPECT_FALSE(estimator.estimate().valid);
  EXPECT_STREQ(estimator.estimate().status, "no pose yet");
  for (int i = 0; i < 4; ++i) {
    feed(estimator, i, i + 1);
    EXPECT_TRUE(estimator.estimate().used);
    EXPECT_FALSE(estimator.estimate().valid);
    EXPECT_NE(std::string(estimator.estimate().status).find("too few"), std::string::npos);
  }
  feed(estimator, 4, 5);
  EXPECT_TRUE(estimator.estimate().valid);
  EXPECT_STREQ(estimator.estimate().status, "");
  estimator.reset();
  EXPECT_FALSE(estimator.estimate().valid);
}

TEST(VelocityEstimator, RepeatedAndLateStampsChangeNothing) {
  VelocityEstimator clean({}), disturbed({});
  for (int i = 0; i < 300; ++i) {
    const Vector3<double> pose = wrapped(circle(i * kDt));
    clean.update(i * kDt, pose);
    disturbed.update(i * kDt, pose);
    if (i % 20 == 7) {
      const Vector3<double> other = pose + Vector3<double>(0.001, 0, 0.01);
      const StateEstimate& same = disturbed.update(i * kDt, other);
      EXPECT_TRUE(same.ignored);
      EXPECT_FALSE(same.used);
      EXPECT_EQ(same.valid, i >= 4);
      EXPECT_TRUE(disturbed.update(i * kDt - 0.03, other).ignored);
    }
    ASSERT_EQ(clean.estimate().eta, disturbed.estimate().eta);
    ASSERT_EQ(clean.estimate().nu, disturbed.estimate().nu);
    ASSERT_EQ(clean.estimate().nu_dot, disturbed.estimate().nu_dot);
  }
}

TEST(VelocityEstimator, PosesThatAreNotFiniteAreLeftOut) {
  VelocityEstimator estimator({});
  feed(estimator, 0, 200);
  for (int i = 200; i < 206; ++i) {
    Vector3<double> pose = circle(i * kDt);
    pose(i % 3) = i % 2 ? kNan : std::numeric_limits<double>::infinity();
    const StateEstimate& e = estimator.update(i * kDt, pose);
    EXPECT_FALSE(e.used);
    EXPECT_FALSE(e.ignored);
    EXPECT_STREQ(e.status, "the pose is not finite");
    EXPECT_TRUE(e.nu.allFinite() && e.eta.allFinite());
    EXPECT_EQ(e.valid, i < 203) << "three in a row are tolerated";
  }
  EXPECT_FALSE(estimator.update(kNan, circle(2.06)).used);
  feed(estimator, 206, 207);
  EXPECT_TRUE(estimator.estimate().valid);
  feed(estimator, 207, 240);
  expectOnCircle(estimator.estimate(), 2.39);
}

TEST(VelocityEstimator, SingleSpikesAndTurnedHeadingsAreLeftOut) {
  VelocityEstimator estimator({});
  int left_out = 0;
  for (int i = 0; i < 400; ++i) {
    Vector3<double> pose = wrapped(circle(i * kDt));
    const bool bad = i > 20 && i % 25 == 0;
    if (bad && i % 2) pose.x() += 0.3;
    if (bad && i % 2 == 0) pose.z() = -pose.z();  // the mocap's single-frame flip
    const double wrong = std::abs(wrapAngle(pose.z() - circle(i * kDt).z()));
    const StateEstimate& e = estimator.update(i * kDt, pose);
    if (i < 10) continue;
    EXPECT_TRUE(e.valid);
    if (bad && (i % 2 || wrong > 0.5)) {
      EXPECT_FALSE(e.used) << i;
      EXPECT_STREQ(e.status, "the pose jumped");
      ++left_out;
    } else if (!bad) {
      EXPECT_TRUE(e.used);
      expectOnCircle(e, i * kDt);
    }
  }
  EXPECT_GT(left_out, 10);
}

TEST(VelocityEstimator, FindsACraftThatWasMoved) {
  VelocityEstimator estimator({});
  feed(estimator, 0, 200);
  int invalid = 0, i = 200;
  for (; i < 240; ++i) {
    const StateEstimate& e = estimator.update(i * kDt, wrapped(circle(i * kDt) + Vector3<double>(2, 1, 1.5)));
    invalid += !e.valid;
    EXPECT_TRUE(e.used || i < 204);
  }
  EXPECT_GE(invalid, 4);  // the jump of the state must be visible
  EXPECT_LE(invalid, 8);
  EXPECT_TRUE(estimator.estimate().valid);
  EXPECT_NEAR(estimator.estimate().eta.x(), circle(2.39).x() + 2, 2e-3);
  EXPECT_NEAR(estimator.estimate().nu.z(), 2, 0.02);
}

class VelocityErrors : public testing::TestWithParam<double> {};

TEST_P(VelocityErrors, HaveTheCovarianceOfTheEstimate) {
  VelocityEstimator estimator({});
  EstimatorParams params;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Vector3<double> ratio = Vector3<double>::Zero();
  const int count = 20000;
  for (int i = 0; i < count; ++i) {
    Vector3<double> pose(0.8 * i * kDt, 0, 0.6);
    for (int k = 0; k < 3; ++k) pose(k) += GetParam() * params.noise(k) * normal(random);
    const StateEstimate& e = estimator.update(i * kDt, pose);
    if (i < 100) continue;
    const Vector2<double> nu = worldToBody<double>(0.6, {0.8, 0.0});
    const Vector3<double> error = e.nu - Vector3<double>(nu.x(), nu.y(), 0);
    ratio += error.cwiseAbs2().cwiseQuotient(e.nu_covariance.diagonal()) / count;
  }
  // The Kalman filter expects the craft to manoeuvre, which it does not here.
  for (int k = 0; k < 3; ++k) {
    EXPECT_GT(ratio(k), 0.4) << k;
    EXPECT_LT(ratio(k), 1.1) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(NoiseRelativeToParams, VelocityErrors, testing::Values(1, 2, 3));

TEST(VelocityEstimator, ToleratesStampsOfAPoll) {
  // Frames at 120 Hz, fetched and stamped by a poll at 100 Hz: as in data/epfl_2019, a fifth of the
  // poses comes immediately after the previous one.
  VelocityEstimator estimator({});
  int left_out = 0, bursts = 0;
  double worst = 0, last = 0;
  for (int i = 0; i < 2400; ++i) {
    const double exposed = i / 120.0, poll = std::ceil(exposed * 100) / 100;
    const bool burst = last >= poll;
    const double stamp = burst ? last + 1e-4 : poll;
    bursts += burst;
    last = stamp;
    const StateEstimate& e = estimator.update(stamp, wrapped(circle(exposed)));
    left_out += !e.used;
    if (exposed > 1) {
      EXPECT_TRUE(e.valid) << e.status;
      worst = std::max(worst, (e.nu - kCircleNu).norm());
    }
  }
  EXPECT_GT(bursts, 300);
  EXPECT_LT(left_out, 24);
  EXPECT_LT(worst, 0.6);
}

TEST(Smoother, RestartsAfterALongGapAndAfterAJump) {
  std::vector<double> stamps;
  std::vector<Vector3<double>> eta;
  for (int i = 0; i < 300; ++i) {
    const double t = i * kDt + (i >= 100 ? 3.0 : 0.0);
    const double carried = i >= 200 ? 1.0 : 0.0;
    stamps.push_back(t);
    eta.push_back(wrapped(circle(t) + Vector3<double>(carried, 0, 0)));
  }
  eta[50].x() += 0.4;
  stamps[150] = stamps[149];  // a repeated stamp
  eta[150] = eta[149];
  const SmoothedMotion motion = smooth(stamps, rows(eta), {});
  for (int i = 0; i < 300; ++i) {
    EXPECT_EQ(motion.used[i], i != 50) << i;
    EXPECT_LT((Vector3<double>(motion.nu.row(i)) - kCircleNu).norm(), 0.03) << i;
    if (i == 50) continue;
    EXPECT_LT((wrapped(motion.eta.row(i)) - eta[i]).head<2>().norm(), 1e-3) << i;
    EXPECT_LT(std::abs(wrapAngle(motion.eta(i, 2) - eta[i].z())), 1e-3) << i;
  }
  for (int i = 1; i < 300; ++i) EXPECT_LT(std::abs(motion.eta(i, 2) - motion.eta(i - 1, 2)), M_PI + 0.1);
}

/// Motion of one axis by least squares over all poses: constant acceleration driven by white jerk.
struct LeastSquares {
  Eigen::MatrixX3d x;               ///< position, velocity, acceleration at each stamp
  Matrix3<double> last_covariance;  ///< of the last row

  LeastSquares(const std::vector<double>& stamps, const Eigen::VectorXd& z, double noise, double jerk,
               double typical_speed) {
    const Eigen::Index count = z.size();
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(3 * count, 3 * count);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(3 * count);
    A(0, 0) = 1 / (noise * noise);
    b(0) = z(0) / (noise * noise);
    A(1, 1) = std::pow(typical_speed, -2);
    A(2, 2) = std::pow(3 * typical_speed, -2);
    for (Eigen::Index k = 1; k < count; ++k) {
      const double h = stamps[static_cast<std::size_t>(k)] - stamps[static_cast<std::size_t>(k) - 1];
      // The covariance of a jump by white jerk, in units in which it hardly depends on h.
      Matrix3<double> Q;
      Q << 1.0 / 20, 1.0 / 8, 1.0 / 6, 1.0 / 8, 1.0 / 3, 1.0 / 2, 1.0 / 6, 1.0 / 2, 1;
      const Vector3<double> unit =
          jerk * Vector3<double>(std::pow(h, 2.5), std::pow(h, 1.5), std::pow(h, 0.5));
      Eigen::Matrix<double, 3, 6> jump;  // x_k - F x_(k-1)
      jump << -1, -h, -h * h / 2, 1, 0, 0, 0, -1, -h, 0, 1, 0, 0, 0, -1, 0, 0, 1;
      jump = unit.cwiseInverse().asDiagonal() * jump;
      A.block<6, 6>(3 * k - 3, 3 * k - 3) += jump.transpose() * Q.inverse() * jump;
      A(3 * k, 3 * k) += 1 / (noise * noise);
      b(3 * k) += z(k) / (noise * noise);
    }
    const Eigen::VectorXd size = A.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd even = size.asDiagonal() * A * size.asDiagonal();
    const Eigen::MatrixXd inverse = size.asDiagonal() * even.inverse() * size.asDiagonal();
    const Eigen::VectorXd found = inverse * b;
    x.resize(count, 3);
    for (Eigen::Index k = 0; k < count; ++k) x.row(k) = found.segment<3>(3 * k);
    last_covariance = inverse.bottomRightCorner<3, 3>();
  }
};

/// A turning craft at the stamps, with noise.
Eigen::MatrixX3d noisyPoses(const std::vector<double>& stamps) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  Eigen::MatrixX3d eta(stamps.size(), 3);
  for (std::size_t k = 0; k < stamps.size(); ++k) {
    const double t = stamps[k];
    eta.row(static_cast<Eigen::Index>(k)) << std::sin(2 * t) + 5e-4 * normal(random),
        0.5 * t * t + 5e-4 * normal(random), 1.5 * t - 0.3 * t * t + 5e-3 * normal(random);
  }
  return eta;
}

EstimatorParams openGate() {
  EstimatorParams params;
  params.gate = 1e3;
  params.linear_jerk = 7;
  params.angular_jerk = 90;
  return params;
}

/// Body velocities and accelerations of rows of the three axes, by their definition.
std::pair<Vector3<double>, Vector3<double>> bodyOf(const LeastSquares (&axes)[3], Eigen::Index k) {
  const double psi = axes[2].x(k, 0), r = axes[2].x(k, 1), c = std::cos(psi), s = std::sin(psi);
  Eigen::Matrix2d R, spin;
  R << c, -s, s, c;
  spin << 0, -1, 1, 0;
  const Vector2<double> v(axes[0].x(k, 1), axes[1].x(k, 1)), a(axes[0].x(k, 2), axes[1].x(k, 2));
  const Vector2<double> nu = R.transpose() * v, nu_dot = R.transpose() * a - r * spin * nu;
  return {{nu.x(), nu.y(), r}, {nu_dot.x(), nu_dot.y(), axes[2].x(k, 2)}};
}

TEST(Smoother, IsTheLeastSquaresSolutionOfAllPoses) {
  std::vector<double> stamps = {0};
  for (int k = 1; k < 50; ++k) stamps.push_back(stamps.back() + (k % 7 == 3 ? 0.05 : 0.01));
  const Eigen::MatrixX3d eta = noisyPoses(stamps);
  const EstimatorParams params = openGate();
  const LeastSquares axes[3] = {
      {stamps, eta.col(0), 5e-4, 7, 3}, {stamps, eta.col(1), 5e-4, 7, 3}, {stamps, eta.col(2), 5e-3, 90, 20}};
  const SmoothedMotion found = smooth(stamps, eta, params);
  for (Eigen::Index k = 0; k < eta.rows(); ++k) {
    const auto [nu, nu_dot] = bodyOf(axes, k);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(found.eta(k, i), axes[i].x(k, 0), 1e-7) << k;
    EXPECT_LT((found.nu.row(k).transpose() - nu).norm(), 1e-5) << k;
    EXPECT_LT((found.nu_dot.row(k).transpose() - nu_dot).norm(), 1e-3) << k;
    EXPECT_EQ(found.starts[static_cast<std::size_t>(k)], k == 0);
    EXPECT_TRUE(found.used[static_cast<std::size_t>(k)]);
  }
}

}  // namespace velocity_estimator_test
}  // namespace ground
