#include "ground/estimation/velocity_estimator.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ground {
namespace {

constexpr int kMinAccepted = 5;        // number of poses after which an estimate is valid
constexpr int kMaxRejected = 3;        // largest count of rejected poses of a valid estimate
constexpr double kBackwardJump = 1.0;  // an earlier stamp than this means that time jumped [s]

class FiniteDifferenceEstimator : public VelocityEstimator {
 public:
  explicit FiniteDifferenceEstimator(const EstimatorParams& params) : VelocityEstimator(params) {}

 private:
  struct Sample {
    double time = 0;  // time since the start [s]
    double dt = 0;    // interval of the difference [s]
    Vector3<double> eta = Vector3<double>::Zero();
    Vector3<double> velocity = Vector3<double>::Zero();  // difference, world frame
    Vector3<double> nu = Vector3<double>::Zero();        // filtered, body
  };

  void start(const Vector3<double>& eta) override {
    const double before = estimate_.eta.z();
    time_ = 0;
    velocity_.setZero();
    count_ = 1;
    samples_[0] = Sample();
    samples_[0].eta << eta.x(), eta.y(), before + wrapAngle(eta.z() - before);
    publish(0);
  }

  bool advance(double dt, const Vector3<double>& eta) override {
    time_ += dt;
    const double since = time_ - past(0).time;
    const Vector3<double> expected = past(0).eta + since * velocity_;
    if (!sameMotion(expected, eta, since, count_ > 1 ? 1.0 : kUnknownMotion, params_)) return false;
    // Stamps of the same poll do not give the time between poses: use an older sample.
    int back = 0;
    while (back < std::min(count_, kMaxMedian) - 1 && time_ - past(back).time < kMinInterval) ++back;
    const Sample from = past(back);
    Sample& newest = samples_[count_++ % kCapacity];
    newest.time = time_;
    newest.dt = time_ - from.time;
    newest.eta << eta.x(), eta.y(), expected.z() + wrapAngle(eta.z() - expected.z());
    newest.velocity = (newest.eta - from.eta) / newest.dt;

    const int n = std::min(count_ - 1, params_.median);
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < n; ++k) scratch_[k] = past(k).velocity(i);
      std::nth_element(scratch_.begin(), scratch_.begin() + n / 2, scratch_.begin() + n);
      velocity_(i) = scratch_[n / 2];
    }
    publish(n);
    newest.nu = estimate_.nu;
    return true;
  }

  /// Sets the estimate; `n`: number of differences in the median.
  void publish(int n) {
    const Sample& newest = past(0);
    estimate_.eta = newest.eta;
    bodyMotion(velocity_, Vector3<double>::Zero(), newest.eta.z(), estimate_.nu, estimate_.nu_dot);
    // The median is not smooth in time, so its slope is taken over its own length.
    estimate_.nu_dot.setZero();
    if (n > 1) {
      const Sample& oldest = past(n - 1);
      estimate_.nu_dot = (estimate_.nu - oldest.nu) / (newest.time - oldest.time);
    }
    double dt = 0;
    for (int k = 0; k < n; ++k) dt += past(k).dt / n;
    for (int i = 0; i < 3; ++i) {
      const double variance = params_.noise(i) * params_.noise(i), speed = typicalSpeed(i);
      estimate_.eta_covariance(i, i) = variance;
      // Variance by the pose noise, without the median's delay. A difference has the variance
      // 2 sigma^2 / dt^2. Neighbours are anticorrelated, so the variance of the median of n
      // decreases faster than 1/n (exponent fitted to simulated noise, within 6% up to n = 31).
      estimate_.nu_covariance(i, i) =
          n > 0 ? 2 * variance / (dt * dt) / std::pow(n, kFallOff) : speed * speed;
    }
  }

  /// The sample k before the newest one.
  const Sample& past(int k) const { return samples_[(count_ - 1 - k) % kCapacity]; }

  static constexpr double kFallOff = 1.18;
  static constexpr double kMinInterval = 4e-3;  // [s]
  static constexpr int kCapacity = kMaxMedian + 1;

  std::array<Sample, kCapacity> samples_;
  std::array<double, kMaxMedian> scratch_;
  int count_ = 0;
  double time_ = 0;                                     // time since the start [s]
  Vector3<double> velocity_ = Vector3<double>::Zero();  // world frame
};

class KalmanEstimator : public VelocityEstimator {
 public:
  explicit KalmanEstimator(const EstimatorParams& params) : VelocityEstimator(params) {}

 private:
  void start(const Vector3<double>& eta) override {
    filter_.start(eta, params_);
    publish();
  }

  bool advance(double dt, const Vector3<double>& eta) override {
    filter_.predict(dt, params_);
    const bool accepted = filter_.correct(eta, params_);
    publish();
    return accepted;
  }

  void publish() {
    estimate_.eta = filter_.position();
    bodyMotion(filter_.velocity(), filter_.acceleration(), estimate_.eta.z(), estimate_.nu, estimate_.nu_dot);
    // A heading error rotates the velocity: (u, v) += (v, -u) d psi.
    const Vector2<double> turned(estimate_.nu.y(), -estimate_.nu.x());
    const Eigen::Matrix3d &x = filter_.axis(0).P, &y = filter_.axis(1).P, &psi = filter_.axis(2).P;
    estimate_.eta_covariance.diagonal() << x(0, 0), y(0, 0), psi(0, 0);
    Matrix3<double>& C = estimate_.nu_covariance;
    // x and y have the same model and noise, so rotation into the body frame preserves their mean.
    C.topLeftCorner<2, 2>() = psi(0, 0) * turned * turned.transpose();
    C.diagonal().head<2>().array() += 0.5 * (x(1, 1) + y(1, 1));
    C.topRightCorner<2, 1>() = psi(0, 1) * turned;
    C.bottomLeftCorner<1, 2>() = psi(0, 1) * turned.transpose();
    C(2, 2) = psi(1, 1);
  }

  MotionFilter filter_;
};

}  // namespace

void bodyMotion(const Vector3<double>& velocity, const Vector3<double>& acceleration, double psi,
                Vector3<double>& nu, Vector3<double>& nu_dot) {
  const Vector2<double> v = velocity.head<2>(), a = acceleration.head<2>();
  nu << worldToBody<double>(psi, v), velocity.z();
  // d/dt (R' v) = R' a - r S R' v
  nu_dot << worldToBody<double>(psi, a) + nu.z() * Vector2<double>(nu.y(), -nu.x()), acceleration.z();
}

void VelocityEstimator::reset() {
  accepted_ = rejected_ = 0;
  jump_.clear();
  estimate_ = StateEstimate();
}

const StateEstimate& VelocityEstimator::reject(const char* why) {
  estimate_.used = estimate_.ignored = false;
  rejected_ = std::min(rejected_ + 1, kMaxRejected + 1);
  estimate_.valid = estimate_.valid && rejected_ <= kMaxRejected;
  estimate_.status = why;
  return estimate_;
}

const StateEstimate& VelocityEstimator::update(double stamp, const Vector3<double>& eta) {
  if (!std::isfinite(stamp) || !eta.allFinite()) return reject("the pose is not finite");
  const double dt = stamp - stamp_;
  bool fresh = accepted_ == 0 || stamp - used_stamp_ > params_.max_gap || dt < -kBackwardJump;
  if (!fresh && dt <= 0) {
    estimate_.used = false;
    estimate_.ignored = true;
    return estimate_;
  }
  stamp_ = stamp;
  if (!fresh) scatter_.add(dt);
  params_ = given_;
  params_.stamp_noise = std::max(given_.stamp_noise, scatter_.stampNoise());
  if (!fresh && !advance(dt, eta)) {
    fresh = jump_.add(stamp, eta, params_);
    if (!fresh) return reject("the pose jumped");
  }
  if (fresh) {
    accepted_ = rejected_ = 0;
    start(eta);
  }
  ++accepted_;
  used_stamp_ = stamp;
  rejected_ = std::max(rejected_ - 1, 0);
  jump_.clear();
  estimate_.used = true;
  estimate_.ignored = false;
  estimate_.valid = accepted_ >= kMinAccepted;
  estimate_.status = estimate_.valid ? "" : "too few poses since the filter started";
  return estimate_;
}

std::unique_ptr<VelocityEstimator> makeFiniteDifferenceEstimator(const EstimatorParams& params) {
  return std::make_unique<FiniteDifferenceEstimator>(params);
}

std::unique_ptr<VelocityEstimator> makeKalmanEstimator(const EstimatorParams& params) {
  return std::make_unique<KalmanEstimator>(params);
}

}  // namespace ground
