#include "ground/estimation/model_monitor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "ground/model/capability.h"
#include "ground/model/drive_clock.h"
#include "ground/model/plausibility.h"

namespace ground {
namespace {

constexpr double kInputMemory = 12;  // commands kept before a prediction, for delay and lag [s]
constexpr double kSlack = 1.5;       // longest prediction, relative to the horizon
constexpr double kExcited = 10;      // least motion within a horizon, relative to noise

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kUsual = 0.03;  // disturbance of a model without one, as a share of the largest acceleration
constexpr double kObserverLag = 0.045;  // over which the noise of poses makes a missing acceleration [s]
constexpr double kFar = 3;  // deviations of the mean missing acceleration that a right model hardly exceeds
// Times [time scales]
constexpr double kMean = 0.15;    // of the mean, taken twice; a longer gap begins anew
constexpr double kFailing = 1.1;  // shortest excess that is a failure; a collision's lasts 0.7
constexpr double kHolding = 10;   // longest time after which a model that holds again has not failed

/// Squares of the change of position and of heading.
Vector2<double> squares(const Vector3<double>& change) {
  const double turned = wrapAngle(change.z());
  return {change.head<2>().squaredNorm(), turned * turned};
}

PoseError root(const Vector2<double>& squares) { return {std::sqrt(squares.x()), std::sqrt(squares.y())}; }

}  // namespace

FailureWatch::FailureWatch(const Model& model) : time_scale_(timeScale(model)) {
  const Vector2<double> most = capability(model).accelerations(model.body.m, model.body.I_z);
  const Vector3<double> mass(model.body.m, model.body.m, model.body.I_z), full(most.x(), most.x(), most.y());
  const Disturbance& known = model.disturbance;
  usual_ = (kUsual * full).cwiseAbs2();
  if (!known.empty()) {
    const Vector3<double> variance = known.sigma.cwiseAbs2() + known.trim.cwiseAbs2() +
                                     known.white.cwiseAbs2() / (4 * kMean * time_scale_);
    usual_ = variance.cwiseQuotient(mass.cwiseAbs2()).cwiseMax(0.04 * usual_);
  }
  reset();
}

void FailureWatch::reset() {
  time_ = -std::numeric_limits<double>::infinity();
  excess_.setZero();
  since_.setConstant(kNaN);
}

void FailureWatch::add(double time, const Vector3<double>& missing, const Vector3<double>& variance,
                       bool moves) {
  const double passed = (time - time_) / time_scale_;
  time_ = time;
  if (!(passed < kMean)) {
    once_.setZero();
    mean_.setZero();
    return;
  }
  const double part = 1 - std::exp(-passed / kMean);
  once_ += part * (missing - once_);
  mean_ += part * (once_ - mean_);
  const double noise = std::pow(std::min(1.0, kObserverLag / (kMean * time_scale_)), 2);
  for (int i = 0; i < 3; ++i) {
    const double square = mean_(i) * mean_(i) / (usual_(i) + noise * noise * variance(i));
    const double by = std::clamp(square / (kFar * kFar) - 1, -1.0, 1.0) * passed;
    const bool fails = std::isfinite(since_(i));
    if (excess_(i) == 0) began_(i) = time;
    if (by > 0 || moves || !fails) excess_(i) = std::clamp(excess_(i) + by, 0.0, kHolding);
    if (excess_(i) == 0) since_(i) = kNaN;
    if (!fails && excess_(i) > kFailing) since_(i) = began_(i);
  }
}

std::string failureText(const Vector3<double>& since) {
  constexpr std::array<const char*, 3> kChannels = {"surge", "sway", "yaw"};
  std::vector<std::pair<double, std::string>> failing;
  for (int i = 0; i < 3; ++i)
    if (std::isfinite(since(i))) failing.emplace_back(since(i), kChannels[static_cast<std::size_t>(i)]);
  std::sort(failing.begin(), failing.end());
  std::string text;
  for (const auto& [time, channel] : failing) {
    char when[32];
    std::snprintf(when, sizeof when, " since %.1f s", time);
    text += (text.empty() ? "" : ", ") + channel + when;
  }
  return text;
}

std::string MonitorParams::validate() const {
  if (!(horizon > 0)) return "horizon must be positive";
  if (!(window >= horizon)) return "window must not be shorter than the horizon";
  return "";
}

ModelMonitor::ModelMonitor(const Model& model, const MonitorParams& params)
    : model_(model), params_(params), dynamics_(model), observer_(model, params.observer), failure_(model) {}

void ModelMonitor::setParams(const MonitorParams& params) {
  params_ = params;
  observer_.setParams(params.observer);
  scores_.clear();
}

void ModelMonitor::reset() {
  const DriveClock drive = inputs_.drive;
  inputs_ = InputSequence(model_.thrusters->size());
  inputs_.drive = drive;
  samples_.clear();
  scores_.clear();
  failure_.reset();
  observer_.reset();
}

void ModelMonitor::command(double time, const Thrusters<double>& thrusters, double lift) {
  if (inputs_.size() > 0 && time < inputs_.times.back()) {
    if (time < inputs_.times.back() - DriveClock::kDisorder)
      reset();
    else
      time = inputs_.times.back();
  }
  inputs_.add(time, thrusters, lift);
  observer_.command(time, thrusters, lift);
  inputs_.dropBefore(time - params_.horizon * kSlack - kInputMemory);
}

void ModelMonitor::voltage(double time, double volts) {
  if (!isPlausibleVoltage(volts, model_.body.volts)) return;
  if (!inputs_.battery.empty() && time < inputs_.battery.times.back()) return;
  inputs_.battery.add(time, volts);
  observer_.voltage(volts);
}

/// The newest state that is at least one horizon old, or the end.
ModelMonitor::Samples::const_iterator ModelMonitor::start(double time) const {
  const auto after = std::upper_bound(samples_.begin(), samples_.end(), time - params_.horizon + 1e-6,
                                      [](double t, const Sample& s) { return t < s.time; });
  if (after == samples_.begin()) return samples_.end();
  const auto found = after - 1;
  return time - found->time > kSlack * params_.horizon ? samples_.end() : found;
}

Simulation<double> ModelMonitor::simulate(const Sample& from) const {
  return Simulation<double>(dynamics_, inputs_, from.state, from.time);
}

/// Variances of position and heading between the newest pose and the one that a right model predicts from
/// an earlier estimate: both have the noise of poses, the estimate through the filter and the motion since.
Vector2<double> ModelMonitor::noiseAfter(Samples::const_iterator from) const {
  Matrix6 noise = from->noise;
  for (auto next = from + 1; next != samples_.end(); ++next)
    noise = (next->transition * noise * next->transition.transpose()).eval();
  noise.topLeftCorner<3, 3>() += samples_.back().pose_noise;
  return {noise(0, 0) + noise(1, 1), noise(2, 2)};
}

std::optional<ModelMonitor::Error> ModelMonitor::measure(double time, const RigidState<double>& state,
                                                         const PoseMeasurement& measured) {
  if (!measured.eta.allFinite()) return std::nullopt;
  if (!samples_.empty() && time < samples_.back().time) reset();
  if (!samples_.empty() && time == samples_.back().time) return std::nullopt;
  observer_.countFrom(inputs_.drive.origin(time));
  observer_.measure(time, state, measured);
  const DisturbanceObserver::Estimate estimate = observer_.at(time);
  samples_.push_back({time, estimate.state, measured.eta, measured.covariance,
                      observer_.noise().topLeftCorner<6, 6>(), observer_.transition()});
  while (time - samples_.front().time > kSlack * params_.horizon) samples_.pop_front();
  const auto from = start(time);
  if (from == samples_.end()) return std::nullopt;
  Error error;
  error.horizon = time - from->time;
  Simulation<double> simulation = simulate(*from);
  simulation.advance(time);
  error.predicted = simulation.measure();
  error.eta = measured.eta - error.predicted.eta;
  error.eta.z() = wrapAngle(error.eta.z());
  const Matrix3<double> mass = dynamics_.mass();
  error.wrench = mass * estimate.missing;
  error.wrench_noise =
      (mass * observer_.noise().bottomRightCorner<3, 3>() * mass.transpose()).diagonal().cwiseSqrt();
  if (!error.eta.allFinite() || !error.wrench.allFinite()) return std::nullopt;
  error.now = root(squares(error.eta));
  const Vector2<double> motion =
      squares(measured.eta - from->measured).cwiseMax(squares(error.predicted.eta - from->measured));
  if (hasLift(from->time)) scores_.push_back({time, squares(error.eta), noiseAfter(from), motion});
  pool(time, error);
  if (const double began = inputs_.drive.origin(time); began != drive_) {
    drive_ = began;
    failure_.reset();
  }
  if (hasLift(from->time))
    failure_.add(time, estimate.missing, observer_.noise().diagonal().tail<3>(), error.excited);
  error.failing_since = failure_.since();
  return error;
}

/// Whether the craft has had lift since a time; without it, it lies on the floor, which models leave out.
bool ModelMonitor::hasLift(double since) const {
  const auto next = std::upper_bound(inputs_.times.begin(), inputs_.times.end(), since);
  if (next == inputs_.times.begin()) return false;
  const auto acting = inputs_.lift.begin() + (next - inputs_.times.begin() - 1);
  return std::all_of(acting, inputs_.lift.end(), [](double lift) { return lift > 0; });
}

/// Reports the means over the window that ends at a time.
void ModelMonitor::pool(double time, Error& error) {
  while (!scores_.empty() && time - scores_.front().time > params_.window) scores_.pop_front();
  const double count = static_cast<double>(scores_.size());
  Score sum{0, Vector2<double>::Zero(), Vector2<double>::Zero(), Vector2<double>::Zero()};
  for (const Score& s : scores_) {
    sum.error += s.error / count;
    sum.noise += s.noise / count;
    sum.motion += s.motion / count;
  }
  error.rms = root(sum.error);
  error.noise = root(sum.noise);
  const bool is_newest = !scores_.empty() && scores_.back().time == time;
  error.excited = is_newest && (sum.motion.array() > kExcited * kExcited * sum.noise.array()).any();
  error.covered = scores_.empty() ? 0 : time - scores_.front().time;
}

std::vector<Vector3<double>> ModelMonitor::path(double step) const {
  std::vector<Vector3<double>> poses;
  if (samples_.empty()) return poses;
  const double end = samples_.back().time;
  const auto from = start(end);
  if (from == samples_.end()) return poses;
  Simulation<double> simulation = simulate(*from);
  const int steps = std::max(1, static_cast<int>(std::lround((end - from->time) / step)));
  for (int i = 0; i <= steps; ++i) {
    simulation.advance(from->time + (end - from->time) * i / steps);
    const Vector3<double> eta = simulation.measure().eta;
    if (!eta.allFinite()) break;
    poses.push_back(eta);
  }
  return poses;
}

void ModelContest::add(double time, const ModelMonitor::Error& first, const ModelMonitor::Error& second) {
  if (!differences_.empty() && time < differences_.back().first) differences_.clear();
  const double position = std::min(first.noise.position, second.noise.position);
  const double heading = std::min(first.noise.heading, second.noise.heading);
  const auto relative = [&](const PoseError& e) {
    return std::hypot(e.position / position, e.heading / heading);
  };
  differences_.emplace_back(time, relative(first.now) - relative(second.now));
  while (time - differences_.front().first > window_) differences_.pop_front();
}

std::optional<Preference> ModelContest::preference() const {
  // Errors of overlapping predictions are correlated; means over blocks of one horizon hardly are.
  constexpr int kMinBlocks = 4;
  std::vector<double> means;
  double sum = 0, count = 0;
  double end = differences_.empty() ? 0 : differences_.front().first + horizon_;
  for (const auto& [time, value] : differences_) {
    if (time >= end) {
      if (count > 0) means.push_back(sum / count);
      sum = count = 0;
      while (time >= end) end += horizon_;
    }
    sum += value;
    count += 1;
  }
  const double blocks = static_cast<double>(means.size());
  if (means.size() < kMinBlocks) return std::nullopt;
  Preference found;
  for (const double m : means) found.difference += m / blocks;
  double square = 0;
  for (const double m : means) square += (m - found.difference) * (m - found.difference);
  found.standard_error = std::sqrt(square / (blocks * (blocks - 1)));
  return found;
}

}  // namespace ground
