#include "ground/estimation/model_monitor.h"

#include <algorithm>
#include <cmath>

#include "ground/model/drive_clock.h"

namespace ground {
namespace {

constexpr double kInputMemory = 12;  // commands kept before a prediction, for delay and lag [s]
constexpr double kSlack = 1.5;       // longest prediction, relative to the horizon
/// Smallest spread by which errors are divided, that of a craft at rest [m/s], [m/s], [rad/s].
const Vector3<double> kMinSpread(0.01, 0.01, 0.05);

}  // namespace

std::string MonitorParams::validate() const {
  if (!(horizon > 0)) return "horizon must be positive";
  if (!(window >= horizon)) return "window must not be shorter than the horizon";
  return "";
}

ModelMonitor::ModelMonitor(const Model& model, const MonitorParams& params)
    : model_(model), params_(params), dynamics_(model), observer_(model, params.observer) {}

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

/// The newest state that is at least one horizon old, or nullptr.
const ModelMonitor::Sample* ModelMonitor::start(double time) const {
  const auto after = std::upper_bound(samples_.begin(), samples_.end(), time - params_.horizon + 1e-6,
                                      [](double t, const Sample& s) { return t < s.time; });
  if (after == samples_.begin()) return nullptr;
  const Sample& found = *(after - 1);
  return time - found.time > kSlack * params_.horizon ? nullptr : &found;
}

Simulation<double> ModelMonitor::simulate(const Sample& from) const {
  return Simulation<double>(dynamics_, inputs_, from.state, from.time);
}

std::optional<ModelMonitor::Error> ModelMonitor::measure(double time, const RigidState<double>& measured) {
  if (!samples_.empty() && time < samples_.back().time) reset();
  if (!samples_.empty() && time == samples_.back().time) return std::nullopt;
  observer_.countFrom(inputs_.drive.origin(time));
  observer_.measure(time, measured);
  const DisturbanceObserver::Estimate estimate = observer_.at(time);
  samples_.push_back({time, estimate.state});
  while (time - samples_.front().time > kSlack * params_.horizon) samples_.pop_front();
  const Sample* from = start(time);
  if (!from) return std::nullopt;
  Error error;
  error.horizon = time - from->time;
  Simulation<double> simulation = simulate(*from);
  simulation.advance(time);
  error.predicted = simulation.measure();
  error.eta = measured.eta - error.predicted.eta;
  error.eta.z() = wrapAngle(error.eta.z());
  error.nu = measured.nu - error.predicted.nu;
  error.wrench = dynamics_.mass() * estimate.missing;
  if (!error.eta.allFinite() || !error.nu.allFinite() || !error.wrench.allFinite()) return std::nullopt;
  add({time, error.nu.cwiseAbs(), measured.nu});
  const double count = static_cast<double>(scores_.size());
  Vector3<double> mean_error = Vector3<double>::Zero(), mean = mean_error, square = mean_error;
  for (const Score& s : scores_) {
    mean_error += s.error / count;
    mean += s.nu / count;
  }
  for (const Score& s : scores_) square += (s.nu - mean).cwiseAbs2() / count;
  error.mean = mean_error;
  error.spread = square.cwiseSqrt().cwiseMax(kMinSpread);
  error.error = error.mean.cwiseQuotient(error.spread).sum();
  error.error_now = error.nu.cwiseAbs().cwiseQuotient(error.spread).sum();
  error.covered = time - scores_.front().time;
  return error;
}

void ModelMonitor::add(const Score& score) {
  scores_.push_back(score);
  while (score.time - scores_.front().time > params_.window) scores_.pop_front();
}

std::vector<Vector3<double>> ModelMonitor::path(double step) const {
  std::vector<Vector3<double>> poses;
  if (samples_.empty()) return poses;
  const double end = samples_.back().time;
  const Sample* from = start(end);
  if (!from) return poses;
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
  differences_.emplace_back(time, first.error_now - second.error_now);
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
