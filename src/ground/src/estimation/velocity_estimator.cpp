#include "ground/estimation/velocity_estimator.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace ground {
namespace {

constexpr int kSettled = 5;        // poses after which velocities are believed
constexpr int kMaxRejections = 5;  // poses in a row that are not believed before starting anew
constexpr double kBackwardJump =
    1;  // a stamp this much earlier is another clock, not a late pose [s]

class FiniteDifferenceEstimator : public VelocityEstimator {
 public:
  explicit FiniteDifferenceEstimator(const EstimatorParams& params) : VelocityEstimator(params) {
    window_.reserve(params.median);
    scratch_.reserve(params.median);
  }

 private:
  void start(const Vector3<double>& eta) override {
    window_.clear();
    next_ = 0;
    last_ = eta;
    previous_nu_.setZero();
  }

  bool advance(double dt, const Vector3<double>& eta) override {
    const Vector3<double> velocity = (eta - last_) / dt;
    last_ = eta;
    if (static_cast<int>(window_.size()) < params_.median) {
      window_.push_back(velocity);
    } else {
      window_[next_] = velocity;
      next_ = (next_ + 1) % params_.median;
    }
    Vector3<double> median;
    for (int i = 0; i < 3; ++i) {
      scratch_.clear();
      for (const auto& v : window_) scratch_.push_back(v(i));
      const auto middle = scratch_.begin() + scratch_.size() / 2;
      std::nth_element(scratch_.begin(), middle, scratch_.end());
      median(i) = *middle;
    }
    const bool first = window_.size() == 1;
    estimate_.eta = eta;
    bodyMotion(median, Vector3<double>::Zero(), eta.z(), estimate_.nu, estimate_.nu_dot);
    estimate_.nu_dot =
        first ? Vector3<double>::Zero() : Vector3<double>((estimate_.nu - previous_nu_) / dt);
    previous_nu_ = estimate_.nu;
    const double linear = params_.position_noise / dt, angular = params_.heading_noise / dt;
    // difference of two poses; the median of n has about pi/2 times the variance of their mean
    const double factor = 2 * M_PI / 2 / window_.size();
    estimate_.nu_covariance = Vector3<double>(factor * linear * linear, factor * linear * linear,
                                              factor * angular * angular)
                                  .asDiagonal();
    return true;
  }

  double heading(double) const override { return last_.z(); }

  std::vector<Vector3<double>> window_;
  std::vector<double> scratch_;
  int next_ = 0;
  Vector3<double> last_, previous_nu_;
};

class KalmanEstimator : public VelocityEstimator {
 public:
  using VelocityEstimator::VelocityEstimator;

 private:
  void start(const Vector3<double>& eta) override {
    for (int i = 0; i < 3; ++i) {
      const double spread = i < 2 ? 3.0 : 20.0;  // typical speeds [m/s], [rad/s]
      axes_[i].reset(eta(i), variance(i), spread * spread, 9 * spread * spread);
    }
  }

  bool advance(double dt, const Vector3<double>& eta) override {
    bool believed = true;
    Vector3<double> innovation;
    for (int i = 0; i < 3; ++i) {
      axes_[i].predict(dt, density(i));
      innovation(i) = eta(i) - axes_[i].x(0);
      const double s = axes_[i].P(0, 0) + variance(i);
      believed = believed && innovation(i) * innovation(i) <= params_.gate * params_.gate * s;
    }
    if (believed)
      for (int i = 0; i < 3; ++i) axes_[i].correct(innovation(i), variance(i));

    const auto column = [this](int row) {
      return Vector3<double>(axes_[0].x(row), axes_[1].x(row), axes_[2].x(row));
    };
    estimate_.eta = column(0);
    bodyMotion(column(1), column(2), estimate_.eta.z(), estimate_.nu, estimate_.nu_dot);
    // A wrong heading turns the velocity: (u, v) += (v, -u) d psi.
    const Vector2<double> turned(estimate_.nu.y(), -estimate_.nu.x());
    Matrix3<double>& C = estimate_.nu_covariance;
    C.setZero();
    C.topLeftCorner<2, 2>() = 0.5 * (axes_[0].P(1, 1) + axes_[1].P(1, 1)) *
                                  Matrix3<double>::Identity().topLeftCorner<2, 2>() +
                              axes_[2].P(0, 0) * turned * turned.transpose();
    C(2, 2) = axes_[2].P(1, 1);
    return believed;
  }

  double heading(double dt) const override {
    const Eigen::Vector3d& x = axes_[2].x;
    return x(0) + dt * x(1);
  }

  double variance(int axis) const {
    const double sigma = axis < 2 ? params_.position_noise : params_.heading_noise;
    return sigma * sigma;
  }
  double density(int axis) const {
    const double root = axis < 2 ? params_.linear_jerk : params_.angular_jerk;
    return root * root;
  }

  std::array<AxisFilter, 3> axes_;
};

}  // namespace

std::string EstimatorParams::validate() const {
  for (double x : {position_noise, heading_noise, max_gap, linear_jerk, angular_jerk})
    if (!(x > 0) || !std::isfinite(x)) return "noise levels, jerks and max_gap must be positive";
  if (!(gate >= 1)) return "gate must be at least 1";
  if (median < 1 || median > 101 || median % 2 == 0) return "median must be odd, 1 to 101";
  return "";
}

void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot) {
  const Vector2<double> v = velocity.head<2>(), a = acceleration.head<2>();
  nu << worldToBody<double>(psi, v), velocity.z();
  // d/dt (R' v) = R' a - r S R' v
  nu_dot << worldToBody<double>(psi, a) + nu.z() * Vector2<double>(nu.y(), -nu.x()),
      acceleration.z();
}

void VelocityEstimator::reset() {
  accepted_ = rejected_ = 0;
  estimate_ = StateEstimate();
  estimate_.status = "no pose yet";
}

const StateEstimate& VelocityEstimator::ignore(const char* status, bool still_valid) {
  estimate_.used = false;
  estimate_.valid = estimate_.valid && still_valid;
  if (!still_valid) estimate_.status = status;
  return estimate_;
}

const StateEstimate& VelocityEstimator::update(double stamp, const Vector3<double>& eta) {
  if (!std::isfinite(stamp) || !eta.allFinite()) return ignore("the pose is not finite", false);
  double dt = stamp - stamp_;
  if (accepted_ > 0 && (dt > params_.max_gap || dt < -kBackwardJump)) reset();
  if (accepted_ > 0 && dt <= 0)
    return ignore("", true);  // a repeated or late pose says nothing new

  if (accepted_ == 0) {
    stamp_ = stamp;
    accepted_ = 1;
    rejected_ = 0;
    estimate_ = StateEstimate();
    estimate_.eta = eta;
    start(eta);
  } else {
    const double expected = heading(dt);
    Vector3<double> unwrapped = eta;
    unwrapped.z() = expected + wrapAngle(eta.z() - expected);
    stamp_ = stamp;
    if (!advance(dt, unwrapped)) {
      if (++rejected_ < kMaxRejections) return ignore("the pose jumped", false);
      reset();
      return update(stamp, eta);
    }
    ++accepted_;
    rejected_ = 0;
  }
  estimate_.used = true;
  estimate_.valid = accepted_ >= kSettled;
  estimate_.status = estimate_.valid ? "" : "too few poses since the start";
  return estimate_;
}

std::unique_ptr<VelocityEstimator> makeFiniteDifferenceEstimator(const EstimatorParams& params) {
  return std::make_unique<FiniteDifferenceEstimator>(params);
}

std::unique_ptr<VelocityEstimator> makeKalmanEstimator(const EstimatorParams& params) {
  return std::make_unique<KalmanEstimator>(params);
}

}  // namespace ground
