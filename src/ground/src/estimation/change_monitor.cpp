#include "ground/estimation/change_monitor.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "ground/model/capability.h"

namespace ground {
namespace {

constexpr double kPosePeriod = 0.0095;  // between measurements that are used: more would cost time [s]
// Times [time scales of the model]
constexpr double kJudgePeriod = 0.1;    // time between judgements
constexpr double kStartSpacing = 0.25;  // time between the starts that are tried
constexpr double kStartMemory = 8;      // how long a start is tried
constexpr double kAfterLift = 0.5;      // that a craft takes to rise
constexpr double kUnknownAge = 1.0;     // shortest age of what is followed as an unknown force
constexpr double kRefining = 2.5;       // of a clear change
constexpr double kLongestRefining = 5;  // of one with alternatives
constexpr double kSettling = 3;         // of the size, while the filter follows it
constexpr double kScaleMemory = 20;     // of the innovations' variances
constexpr double kJumpTime = 0.5;       // full thrust for so long changes the velocity as a hit may
// Log-likelihood ratios
constexpr double kNaming = 6;    // that names a change
constexpr double kDistinct = 3;  // by which it exceeds explanations that are then left out
constexpr double kLead = 0.5;    // by which it exceeds an unknown force
constexpr double kUnknown = 6;   // by which an unknown force does, to be followed
constexpr double kExcluded = -1e9;

constexpr double kLargestInnovation = 12;  // squared innovation that counts for the scale
constexpr double kTilted = 2;              // change of the tilt, over its prior deviation
constexpr double kSigma95 = 1.96;
constexpr double kCurved = 0.05;  // error of sizes by the filter's linearisation

/// Probability of a normal deviate between two bounds.
double normalBetween(double low, double high) {
  return 0.5 * (std::erfc(-high / std::sqrt(2)) - std::erfc(-low / std::sqrt(2)));
}

/// Weights by which the forces of thrusters give the asymmetry; 0 for those on the x axis.
Eigen::VectorXd sidesOf(const ThrusterLayout& layout) {
  Eigen::VectorXd sides(layout.size());
  for (int i = 0; i < sides.size(); ++i) {
    const double starboard = layout.along(i) * layout.starboard(i) - layout.lever(i) * layout.forward(i);
    sides(i) = std::abs(starboard) < 1e-9 ? 0 : starboard > 0 ? -1 : 1;
  }
  return sides / std::max(1.0, sides.cwiseAbs().sum());
}

}  // namespace

ChangeMonitor::ChangeMonitor(const Model& model, const ObserverParams& params)
    : time_scale_(timeScale(model)),
      filter_(model, params),
      bank_(filter_.size(), kStartSpacing * time_scale_, kStartMemory * time_scale_),
      trust_(time_scale_) {
  addParts();
  reset();
}

void ChangeMonitor::addParts() {
  const CraftChange& craft = filter_.craft();
  const Model& model = craft.model();
  const Vector3<double>& most = filter_.most();
  constexpr int kFirst = ChangeFilter::kChange;
  const auto add = [&](const std::string& name, std::vector<int> states, const std::vector<double>& deviation,
                       bool of_craft, double least, double lowest, double highest) {
    const Eigen::VectorXd deviations =
        Eigen::Map<const Eigen::VectorXd>(deviation.data(), static_cast<Eigen::Index>(deviation.size()));
    parts_.push_back({name, {std::move(states), deviations.asDiagonal()}, of_craft, least, lowest, highest});
  };
  for (int i = 0; i < craft.thrusters(); ++i)
    add((*model.thrusters)[i].name + " thruster", {kFirst + i}, {0.3}, true, 0.07, -1,
        craft.parameters()[static_cast<std::size_t>(i)].most);
  const double lever = 0.12 * model.body.l;
  const int mass = kFirst + craft.mass();
  const auto& load = craft.parameters()[static_cast<std::size_t>(craft.mass())];
  add("mass", {mass, mass + 1, mass + 2, mass + 3}, {0.2, 0.08, lever, lever}, true, 0.05, load.least,
      load.most);
  parts_.back().hypothesis.prior(1, 0) = 0.12;  // a load adds inertia as well
  const auto& drag = craft.parameters()[static_cast<std::size_t>(craft.drag())];
  add("drag", {kFirst + craft.drag()}, {1.0}, true, 0.25, drag.least, drag.most);
  const int nu = ChangeFilter::kNu, bias = ChangeFilter::kBias, tilt = ChangeFilter::kTilt;
  const Vector3<double> hit = kJumpTime * time_scale_ * most;
  add("", {nu, nu + 1, nu + 2}, {hit.x(), hit.y(), hit.z()}, false, 0, 0, 0);
  const int push = ChangeFilter::kPush;
  add("", {push, push + 1, push + 2}, {0.3 * most.x(), 0.3 * most.y(), 0.3 * most.z()}, false, 0, 0, 0);
  add("", {bias, bias + 1, bias + 2}, {0.05 * most.x(), 0.05 * most.y(), 0.05 * most.z()}, false, 0, 0, 0);
  add("", {tilt, tilt + 1}, {kTilted * filter_.tilt(), kTilted * filter_.tilt()}, false, 0, 0, 0);
}

void ChangeMonitor::reset() {
  filter_.reset();
  bank_.clear();
  settled_.clear();
  puzzled_.reset();
  named_.reset();
  followed_.reset();
  trust_.reset();
  for (Part& part : parts_) part.shown.reset();
  scale_ = 1;
  last_ = judged_ = -std::numeric_limits<double>::infinity();
  lifted_ = std::numeric_limits<double>::infinity();
  report_ = Report();
  update();
}

void ChangeMonitor::command(double time, const Thrusters<double>& thrusters, double lift) {
  const InputSequence& inputs = filter_.inputs();
  if (inputs.size() > 0 && time < inputs.times.back()) {
    if (time < inputs.times.back() - DriveClock::kDisorder)
      reset();
    else
      time = inputs.times.back();
  }
  const std::size_t drives = inputs.drive.starts().size();
  if (lift <= 0) lifted_ = std::numeric_limits<double>::infinity();
  if (lift > 0 && std::isinf(lifted_)) lifted_ = time;
  filter_.command(time, thrusters, lift);
  if (drives > 0 && inputs.drive.starts().size() > drives) {
    reset();
    lifted_ = time;
    filter_.command(time, thrusters, lift);
  }
}

bool ChangeMonitor::measure(double time, const RigidState<double>& measured) {
  if (time < last_) reset();
  if (time - last_ < kPosePeriod) return false;
  last_ = time;
  if (!(time - lifted_ > kAfterLift * time_scale_)) {
    filter_.restart();
    bank_.clear();
    return false;
  }
  const std::optional<ChangeFilter::Step> step = filter_.measure(time, measured);
  if (!step || step->hit) {
    if (step) trust_.hit(time);
    bank_.clear();
    return false;
  }
  const double squared = step->innovation.dot(step->covariance.inverse() * step->innovation);
  scale_ += kPosePeriod / (kScaleMemory * time_scale_) * (std::min(squared, kLargestInnovation) / 3 - scale_);
  bank_.add(time, *step, std::max(1.0, scale_));
  if (time - judged_ < kJudgePeriod * time_scale_ - 1e-6) return false;
  judged_ = time;
  judge(time);
  update();
  return true;
}

/// The parts by their likelihood, the best first.
std::vector<ChangeMonitor::Finding> ChangeMonitor::findings() const {
  std::vector<Finding> found;
  for (const Part& part : parts_) {
    found.push_back({&part, bank_.test(part.hypothesis)});
    if (part.of_craft) found.back().evidence.log_ratio += possible(part, found.back().evidence);
  }
  std::sort(found.begin(), found.end(),
            [](const Finding& a, const Finding& b) { return a.evidence.log_ratio > b.evidence.log_ratio; });
  return found;
}

void ChangeMonitor::judge(double time) {
  if (followed_) settle(time);
  report_.changes = settled_;
  if (bank_.empty()) return;
  const std::vector<Finding> found = findings();
  if (named_) {
    refine(time, found, likeliest(found, true));
  } else if (found.front().evidence.log_ratio >= kNaming) {
    decide(time, found);
  } else {
    puzzled_.reset();
    if (found.front().evidence.log_ratio < kDistinct) prove(time);
  }
}

/// The first of the parts of the craft, or of the unknown forces.
const ChangeMonitor::Finding& ChangeMonitor::likeliest(const std::vector<Finding>& found, bool of_craft) {
  return *std::find_if(found.begin(), found.end(),
                       [&](const Finding& f) { return f.part->of_craft == of_craft; });
}

/// The motion is not as predicted: names a change, follows, or waits for more.
void ChangeMonitor::decide(double time, const std::vector<Finding>& found) {
  const Finding &first = found.front(), &best = likeliest(found, true);
  const double lead = best.evidence.log_ratio - likeliest(found, false).evidence.log_ratio;
  const double age = (time - first.evidence.start) / time_scale_;
  if (!puzzled_) puzzled_ = time;
  const bool clear = lead > kLead || -lead > kUnknown;
  const bool too_long = time - *puzzled_ > kLongestRefining * time_scale_;
  if (lead > 0 && std::abs(first.evidence.jump(0)) < first.part->least) {
    if (age > kRefining) follow(first);
  } else if (lead > kLead && believed(first)) {
    named_ = time;
    refine(time, found, first);
  } else if ((clear && age > kUnknownAge) || too_long) {
    fail(time, first);
  } else if (!believed(best)) {
    trust_.disturb(time);
  }
}

/// The motion is as predicted; notes which changes it would show.
void ChangeMonitor::prove(double time) {
  trust_.observe(time);
  for (Part& part : parts_) {
    if (!part.of_craft || part.shown) continue;
    const double usual = part.hypothesis.prior(0, 0);
    if (0.5 * usual * usual * bank_.oldestInformation(part.hypothesis.states.front()) > kNaming)
      part.shown = time;
  }
}

/// Whether the craft can have changed so: the model held until then, in a motion that shows such changes.
bool ChangeMonitor::believed(const Finding& finding) const {
  return finding.part->shown && *finding.part->shown < finding.evidence.start &&
         trust_.holdsBefore(finding.evidence.start);
}

/// No change of the craft explains the motion: the filter follows without a word.
void ChangeMonitor::fail(double time, const Finding& finding) {
  trust_.fail(time);
  if (!trust_.hasHeld())
    for (Part& part : parts_) part.shown.reset();
  named_.reset();
  follow(finding);
}

/// Log of what is left of a part's likelihood when impossible sizes are left out.
double ChangeMonitor::possible(const Part& part, const JumpBank::Evidence& evidence) const {
  const double was = before(part, evidence);
  if (bank_.empty() || !(was > 0)) return kExcluded;
  const double jump = evidence.jump(0), known = part.hypothesis.prior.row(0).norm();
  const double found = std::hypot(std::sqrt(evidence.covariance(0, 0)), kCurved * jump);
  const double low = was * part.lowest, high = was * part.highest;
  const double share = normalBetween((low - jump) / found, (high - jump) / found);
  return share > 0 ? std::log(share / normalBetween(low / known, high / known)) : kExcluded;
}

/// Describes the change by its best explanation, and follows it when it is clear.
void ChangeMonitor::refine(double time, const std::vector<Finding>& found, const Finding& best) {
  const Finding& first = found.front();
  const double lead = best.evidence.log_ratio - first.evidence.log_ratio;
  if (-lead > kUnknown && time - first.evidence.start > kUnknownAge * time_scale_) return fail(time, first);
  Change change = described(best);
  // One whose interval holds 0 is none yet; a load may leave the mass as it is and move its centre.
  if (best.part->hypothesis.states.size() == 1 && change.lower < 0 && change.upper > 0) {
    if (time - *named_ > kLongestRefining * time_scale_) named_.reset();
    return;
  }
  report_.changes.push_back(std::move(change));
  report_.changes.back().alternatives = alternatives(found, best);
  const bool clear = report_.changes.back().alternatives.empty();
  if (time - *named_ < (clear ? kRefining : kLongestRefining) * time_scale_) return;
  settled_ = report_.changes;
  named_.reset();
  followed_ = time;
  followed_part_ = best.part;
  trust_.named(time);
  before_ = before(*best.part, best.evidence);
  before_deviation_ = deviationOf(best.part->hypothesis.states.front());
  follow(best);
}

/// Takes the size of the newest change from the filter, which has followed it for a while.
void ChangeMonitor::settle(double time) {
  Change& change = settled_.back();
  const int state = followed_part_->hypothesis.states.front();
  change.size = (1 + filter_.x()(state)) / before_ - 1;
  const double variance = std::max(0.0, filter_.covariance()(state, state));
  // The size is relative to the parameter before the change, which is uncertain as well.
  const double deviation = std::hypot(std::sqrt(variance) / before_,
                                      (1 + change.size) * before_deviation_ / before_, kCurved * change.size);
  setSize(change, *followed_part_, change.size, deviation);
  change.parameters(state - ChangeFilter::kChange) = change.size;
  if (time - *followed_ > kSettling * time_scale_) followed_.reset();
}

/// What else explains the innovations nearly as well.
std::string ChangeMonitor::alternatives(const std::vector<Finding>& found, const Finding& best) const {
  std::string all;
  bool is_unknown = false;
  for (const Finding& one : found) {
    if (one.part == best.part || best.evidence.log_ratio - one.evidence.log_ratio > kDistinct) continue;
    if (!one.part->of_craft && std::exchange(is_unknown, true)) continue;
    all += (all.empty() ? "" : " or ") + partName(*one.part);
  }
  return all;
}

/// The parameter that a part's change begins with, before the change, over that of the model file.
double ChangeMonitor::before(const Part& part, const JumpBank::Evidence& evidence) const {
  const int first = part.hypothesis.states.front();
  return 1 + filter_.x()(first) + evidence.now(first) - evidence.jump(0);
}

double ChangeMonitor::deviationOf(int state) const {
  return std::sqrt(std::max(0.0, filter_.covariance()(state, state)));
}

/// Sets the size with its 95% interval; impossible sizes are left out.
void ChangeMonitor::setSize(Change& change, const Part& part, double size, double deviation) {
  const auto inside = [&](double value) { return std::clamp(value, part.lowest, part.highest); };
  change.size = inside(size);
  change.lower = inside(size - kSigma95 * deviation);
  change.upper = inside(size + kSigma95 * deviation);
}

JumpBank::Matrix ChangeMonitor::information(double start) const { return bank_.information(start); }

std::string ChangeMonitor::partName(const Part& part) {
  return part.of_craft ? part.name : "an unknown force";
}

std::map<std::string, double> ChangeMonitor::logRatios() const {
  std::map<std::string, double> ratios;
  if (bank_.empty()) return ratios;
  for (const Finding& one : findings()) ratios.emplace(partName(*one.part), one.evidence.log_ratio);
  return ratios;
}

/// The filter continues as if it had known of the jump.
void ChangeMonitor::follow(const Finding& finding) {
  filter_.shift(finding.evidence.now, finding.evidence.now_covariance);
  bank_.clear();
  puzzled_.reset();
}

ChangeMonitor::Change ChangeMonitor::described(const Finding& finding) const {
  const JumpBank::Evidence& evidence = finding.evidence;
  const std::vector<int>& states = finding.part->hypothesis.states;
  const int first = states.front();
  const double was = before(*finding.part, evidence), size = evidence.jump(0) / was;
  const double deviation =
      std::hypot(std::sqrt(evidence.covariance(0, 0)) / was, size * deviationOf(first) / was, kCurved * size);
  Change change{
      finding.part->name, evidence.start, 0, 0, 0, Eigen::VectorXd::Zero(filter_.craft().size()), "", ""};
  setSize(change, *finding.part, size, deviation);
  for (std::size_t i = 0; i < states.size(); ++i)
    change.parameters(states[i] - ChangeFilter::kChange) = evidence.jump(static_cast<Eigen::Index>(i));
  change.parameters(first - ChangeFilter::kChange) = change.size;
  if (first == ChangeFilter::kChange + filter_.craft().mass()) change.details = centreText(change.parameters);
  return change;
}

std::string ChangeMonitor::centreText(const Eigen::VectorXd& parameters) const {
  const int centre = filter_.craft().centre();
  const double x = 1e3 * parameters(centre), y = 1e3 * parameters(centre + 1);
  char text[96];
  std::snprintf(text, sizeof text, ", its centre %.1f mm %s and %.1f mm to %s", std::abs(x),
                x < 0 ? "back" : "forward", std::abs(y), y < 0 ? "port" : "starboard");
  return text;
}

void ChangeMonitor::update() {
  const int count = filter_.craft().size();
  report_.estimate = filter_.x().tail(count);
  report_.deviation = filter_.covariance().diagonal().tail(count).cwiseMax(0).cwiseSqrt();
  report_.change = Eigen::VectorXd::Zero(count);
  for (const Change& change : report_.changes) report_.change += change.parameters;
  report_.change = filter_.craft().bounded(report_.change);
  const Eigen::VectorXd sides = sidesOf(*filter_.craft().model().thrusters);
  report_.asymmetry = sides.dot(report_.estimate.head(sides.size()));
  const auto thrusters =
      filter_.covariance().block(ChangeFilter::kChange, ChangeFilter::kChange, sides.size(), sides.size());
  report_.asymmetry_deviation = std::sqrt(std::max(0.0, sides.dot(thrusters * sides)));
  const double began = filter_.inputs().drive.origin(last_);
  report_.began = std::isfinite(began) ? began : 0;
  report_.doubt = doubt();
}

std::string ChangeMonitor::doubt() const {
  if (!trust_.doubtSince()) return "";
  char since[48] = "the drive began";
  if (trust_.hasHeld()) std::snprintf(since, sizeof since, "%.1f s", *trust_.doubtSince() - report_.began);
  return "the model has not predicted the motion since " + std::string(since) + ": diagnose it";
}

}  // namespace ground
