#include "lifecycle_world.h"

#include <algorithm>
#include <limits>

namespace ground {
namespace lifecycle_search {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFrame = 1.0 / 16;  // time between states that are fed [s]
constexpr double kStall = 3;         // nobody calls for so long [s]
constexpr double kDrift = 0.1;       // a clock that is set by less is not noticed [s]
constexpr double kFast = 3;          // a craft at this speed cannot stop inside the room [m/s]
constexpr double kQuick = 1.5;       // at this one it can, unless thrust goes on [m/s]
constexpr double kPush = 3;          // acceleration by the thrust, forwards and backwards in turn [m/s^2]
const Inputs kDrive{0.5, 0.25, 0}, kBrake{0.25, 0.5, 0};

}  // namespace

Vector2<double> SearchPilot::acceleration(double, const Inputs& inputs) const {
  called();
  return pushed(inputs);
}

Vector2<double> SearchPilot::pushed(const Inputs& inputs) const {
  const double difference = inputs.thrusters(0) - inputs.thrusters(1);
  return {difference > 0 ? kPush : difference < 0 ? -kPush : 0, 0};
}

Inputs SearchPilot::update(double elapsed, double, const RigidState<double>& state, double lift) {
  called();
  asked = elapsed;
  invented = invented || (blind && (state.eta.array() == state.eta.array()).any());
  const bool by_state = loop == Loop::kClosed || switched;
  switched = switched || (loop == Loop::kOpenThenClosed && elapsed >= kOpenFor);
  failed = fails || (by_state && !state.eta.allFinite());
  disregarded = disregarded || (objects && by_state);
  if (failed) return {kNan, 0, lift};
  const bool forwards = static_cast<int>(elapsed / kBit) % 2 == 0;
  computed.push_back((forwards ? kDrive : kBrake).thrusters);
  return {computed.back(), lift};
}

double SearchPilot::nextChange(double elapsed) const {
  if (loop == Loop::kClosed || (loop == Loop::kOpenThenClosed && (switched || elapsed >= kOpenFor)))
    return kByState;
  return kBit * (std::floor(elapsed / kBit) + 1);
}

const std::vector<search::Event<LifecycleWorld>>& LifecycleWorld::table() {
  using W = LifecycleWorld;
  static const std::vector<search::Event<W>> all = {
      {"state", [](W& w) { w.state(); }},
      {"old state", [](W& w) { w.state(0, 0, true, w.spec_.params.state_timeout - kTick); }},
      {"stale state", [](W& w) { w.state(0, 0, true, w.spec_.params.state_timeout); }},
      {"state a second ahead", [](W& w) { w.state(0, 0, true, -1); }},
      {"state from the future", [](W& w) { w.state(0, 0, true, -1 - kTick); }},
      {"invalid state", [](W& w) { w.state(0, 0, false); }},
      {"state of NaN", [](W& w) { w.state(kNan); }},
      {"state 0.15 m off", [](W& w) { w.state(0.15); }},
      {"state 0.25 m off", [](W& w) { w.state(0.25); }},
      {"state 1 m off", [](W& w) { w.state(1); }},
      {"state turned by 0.5 rad", [](W& w) { w.state(0, 0, true, 0, 0.5); }},
      {"state turned by 0.65 rad", [](W& w) { w.state(0, 0, true, 0, 0.65); }},
      {"state of a quick craft", [](W& w) { w.state(0, kQuick); }},
      {"old state of a quick craft", [](W& w) { w.state(0, kQuick, true, 0.125); }},
      {"state of a craft that leaves the room", [](W& w) { w.state(0, kFast); }},
      {"start", [](W& w) { w.start(); }},
      {"stop", [](W& w) { w.stop(); }},
      {"the sender is armed", [](W& w) { w.sender(true); }},
      {"the sender is not armed", [](W& w) { w.sender(false); }},
      {"another controller drives", [](W& w) { w.other(1); }},
      {"another controller, without lift", [](W& w) { w.other(0); }},
      {"zero command", [](W& w) { w.zero(); }},
      {"clock set back by 2 s", [](W& w) { w.clockSet(-2); }},
      {"clock set ahead by 2 s", [](W& w) { w.clockSet(2); }},
      {"clock set back by 0.1 s", [](W& w) { w.clockSet(-kDrift); }},
      {"clock set ahead by 0.1 s", [](W& w) { w.clockSet(kDrift); }},
      {"the pilot objects", [](W& w) { w.objects_ = !w.objects_; }},
      {"the pilot computes NaN", [](W& w) { w.fails_ = !w.fails_; }},
      {"the pilot throws", [](W& w) { w.throws_ = !w.throws_; }},
      {"until just before a limit", [](W& w) { w.waitForLimit(-1, false); }},
      {"until a limit", [](W& w) { w.waitForLimit(0, false); }},
      {"until just after a limit", [](W& w) { w.waitForLimit(1, false); }},
      {"with states, until just before a limit", [](W& w) { w.waitForLimit(-1, true); }},
      {"with states, until a limit", [](W& w) { w.waitForLimit(0, true); }},
      {"with states, until just after a limit", [](W& w) { w.waitForLimit(1, true); }},
      {"5 ms pass", [](W& w) { w.pass(w.now_ + 5 * kTick, false); }},
      {"nobody calls for 3 s", [](W& w) { w.now_ += kStall; }},
  };
  return all;
}

struct LifecycleWorld::Before {
  LifecycleSpec::State state;
  std::string reason;
  bool started;
  int changes;
};

LifecycleWorld::LifecycleWorld(const LifecycleParams& params, SearchPilot& pilot)
    : pilot_(&pilot),
      life_(
          pilot, [at = &pilot](const Inputs& inputs) { at->sent.push_back(inputs); },
          [at = &pilot] { ++at->changes; }) {
  life_.setParams(params);
  life_.setFence(spec_.room.fence);
  spec_.params = params;
  spec_.end = pilot.end();
  pilot.blind = !params.require_state;
  spec_.closed_loop = pilot.loop == SearchPilot::Loop::kClosed;
}

void LifecycleWorld::show(Key& key) const {
  life_.visit(key);
  spec_.visit(key);
  key.value(objects_);
  key.value(fails_);
  key.value(switched_);
  key.value(throws_);
  key.value(threw_);
}

// --- Events

void LifecycleWorld::state(double x, double u, bool valid, double age, double heading) {
  const Before seen = before();
  MeasuredState measured;
  measured.stamp = instant().time - age;
  measured.state.eta = Vector3<double>(x, 0, heading);
  measured.state.nu = Vector3<double>(u, 0, 0);
  measured.valid = valid;
  if (!valid) measured.problem = "lost";
  spec_.measure(instant(), {measured.stamp, x, u, heading, valid, std::isfinite(x)});
  life_.state(instant(), measured);
  check(seen, "state");
}

void LifecycleWorld::start() {
  const Before seen = before();
  const bool must = spec_.start(instant());
  if (must) pilot_->threw = false;
  const std::string refused = life_.start(instant());
  if (must != refused.empty() && violation_.empty())
    violation_ = must ? "start: it is refused: " + refused : "start: it is not refused";
  check(seen, "start");
}

void LifecycleWorld::stop() {
  const Before seen = before();
  spec_.change(LifecycleSpec::State::kStopped);
  life_.stop(instant(), "by hand");
  check(seen, "stop");
}

void LifecycleWorld::sender(bool armed) {
  const Before seen = before();
  spec_.sender(armed);
  life_.sender(instant(), armed, armed ? "" : "disarmed by hand");
  check(seen, "sender");
}

void LifecycleWorld::other(double lift) {
  const Before seen = before();
  spec_.otherDrives(instant(), lift);
  life_.otherDrives(instant(), "another", lift);
  expect(pilot_->sent.empty(), "other: a command was sent beside another's");
  check(seen, "other");
}

void LifecycleWorld::tick() {
  const Before seen = before();
  const double sent_before = sent_at_;
  spec_.pass(instant());
  life_.tick(instant());
  check(seen, "tick");
  const bool waits = spec_.closed_loop && seen.state == LifecycleSpec::State::kRunning &&
                     spec_.state == LifecycleSpec::State::kRunning;
  expect(!waits || pilot_->sent.empty() ||
             now_ - sent_before >= ControllerLifecycle::kKeepalive + 1 / spec_.params.rate - kTick,
         "keepalive: a closed loop does not wait for the next state");
  if (violation_.empty()) violation_ = pauseProblem();
}

void LifecycleWorld::zero() {
  before();
  life_.sendZero(instant());
  noteThrown();
  active_ += pilot_->active;
  switched_ = pilot_->switched;
  const bool sent = pilot_->sent.size() == 1 && pilot_->sent.back().zero();
  expect(sent != spec_.othersDrive(instant()), "zeros: none was sent, or beside another's");
  if (!sent) return;
  sent_at_ = now_;
  spec_.room.sends(instant().time, 0);
}

void LifecycleWorld::clockSet(double by) {
  const Before seen = before();
  ahead_ += onTick(by);
  if (std::abs(by) > kDrift) {
    spec_.clockSet();
    life_.timeJumped(instant(), "time jumped");
  }
  check(seen, "clock");
}

// --- Time

void LifecycleWorld::waitForLimit(int ticks, bool fed) {
  using State = LifecycleSpec::State;
  std::vector<double> limits;
  const auto add = [&](double t) {
    if (t > now_ && std::isfinite(t)) limits.push_back(onTick(t));
  };
  if (spec_.state == State::kLifting) add(spec_.lifting_since + spec_.liftTime() - ahead_);
  if (spec_.driving()) add(spec_.running_since + spec_.end - ahead_);
  if (spec_.driving() && !spec_.closed_loop) add(spec_.running_since + SearchPilot::kOpenFor - ahead_);
  add(spec_.others_until);
  if (spec_.started()) add(spec_.started_at + LifecycleSpec::kHandover);
  if (!fed && spec_.room.seen) {
    add(spec_.seen_at + spec_.params.state_timeout);
    add(spec_.room.seen->stamp + spec_.params.state_timeout - ahead_);
    if (spec_.lost_since) add(*spec_.lost_since + spec_.params.recovery_time);
  }
  if (!limits.empty()) pass(*std::min_element(limits.begin(), limits.end()) + ticks * kTick, fed);
}

/// Ticks when they are due; with `fed`, states come.
void LifecycleWorld::pass(double until, bool fed) {
  double next_state = fed ? now_ : until + 1;
  while (violation_.empty()) {
    if (now_ >= next_state) {
      state();
      next_state += kFrame;
    }
    if (now_ >= until) break;
    const Instant due = life_.due();
    const double next = onTick(std::max(std::min(due.steady, due.time - ahead_), now_ + kTick));
    now_ = std::min({until, next, std::max(next_state, now_ + kTick)});
    tick();
  }
}

// --- Checks

LifecycleWorld::Before LifecycleWorld::before() const {
  pilot_->begin(objects_, fails_, switched_, throws_, threw_);
  return {life_.current(), life_.reason(), life_.started(), pilot_->changes};
}

void LifecycleWorld::check(const Before& seen, const std::string& call) {
  using State = LifecycleSpec::State;
  active_ += pilot_->active;
  const bool drove_by_state = switched_;
  switched_ = pilot_->switched;
  if (!pilot_->sent.empty()) {
    sent_at_ = now_;
    sent_ = pilot_->sent.back();
  }
  for (const Inputs& inputs : pilot_->sent) spec_.room.sends(instant().time, pilot_->pushed(inputs).x());
  if (!violation_.empty()) return;
  // The pilot may end the drive whenever it is asked, and on the bench when it begins to drive by the state.
  const bool by_pilot = life_.current() == State::kStopped && spec_.state == State::kRunning &&
                        (pilot_->failed || objects_ || (pilot_->blind && drove_by_state));
  expect(!pilot_->failed || life_.current() == State::kStopped, "finite: a command of NaN stops nothing");
  expect(!pilot_->disregarded, "pilot: it objects, and is asked for a command");
  if (violation_.empty()) violation_ = sentProblem();
  if (by_pilot) spec_.change(State::kStopped);
  noteThrown();
  if (violation_.empty()) violation_ = stateProblem(seen);
  if (told_ && !violation_.empty()) tell("  (" + call + ") " + violation_);
}

/// A pilot that throws ends the drive at once, and is called no more.
void LifecycleWorld::noteThrown() {
  threw_ = pilot_->threw;
  expect(!pilot_->pestered, "pilot: it has thrown, and is called");
  if (!pilot_->throws_now) return;
  expect(life_.current() == LifecycleSpec::State::kStopped, "pilot: it throws, and that stops nothing");
  spec_.change(LifecycleSpec::State::kStopped);
}

/// Which commands it may send.
std::string LifecycleWorld::sentProblem() const {
  using State = LifecycleSpec::State;
  auto computed = pilot_->computed.begin();
  for (const Inputs& inputs : pilot_->sent) {
    if (spec_.othersDrive(instant())) return "other: a command was sent while another controller drives";
    if (!inputs.finite()) return "finite: a command of NaN was sent";
    if (inputs.thrust() > 0) {
      if (spec_.state != State::kRunning) return std::string("thrust: sent while ") + nameOf(spec_.state);
      if (!spec_.supported(instant())) return "state: thrust without a valid state";
      if (!spec_.maySend()) return "armed: thrust while the sender is not armed";
      if (computed == pilot_->computed.end() || inputs.thrusters != *computed++)
        return "thrust: not what the pilot computes";
    }
    if (inputs.lift != 0 && inputs.lift != spec_.params.lift) return "lift: not that of the parameters";
  }
  const bool takes_over = spec_.state == State::kWaiting && spec_.lifted;
  if (!pilot_->sent.empty() && sent_.lift > 0 && !spec_.flying() && !takes_over)
    return std::string("lift: sent while ") + nameOf(spec_.state);
  return "";
}

/// Which state it must be in.
std::string LifecycleWorld::stateProblem(const Before& seen) const {
  using State = LifecycleSpec::State;
  const State is = life_.current();
  const std::string became =
      std::string(nameOf(seen.state)) + " became " + nameOf(is) + ": " + life_.reason();
  if (is != spec_.state) return std::string("cause: it must be ") + nameOf(spec_.state) + ": " + became;
  const bool ended = seen.started && !spec_.started();
  const bool sent_now = sent_at_ == now_ && !pilot_->sent.empty();
  if (ended && !spec_.othersDrive(instant()) && !(sent_now && sent_.zero()))
    return "zeros: none follows the end: " + became;
  const bool begins =
      seen.state != State::kRunning && seen.state != State::kRecovering && is == State::kRunning;
  if (begins && !spec_.closed_loop && !(sent_now && sent_.thrust() > 0))
    return "thrust: an open loop begins late";
  if (pilot_->invented) return "pilot: it is given a state, and none is required";
  const double newest = std::max(instant().time, spec_.room.seen ? spec_.room.seen->stamp : 0);
  if (pilot_->asked > std::max(0.0, newest - spec_.running_since) + 1e-9)
    return "pilot: it is asked for a time that is to come";
  if (seen.state == State::kRunning && is == State::kRecovering && !(sent_now && sent_.thrust() == 0))
    return "zeros: thrust is not cut when the state is lost";
  if (is == State::kRecovering && sent_.thrust() > 0) return "zeros: thrust goes on without a state";
  if (is == State::kLifting && !(sent_.lift == spec_.params.lift)) return "lift: it is not on while LIFTING";
  if (active_ != (spec_.driving() ? 1 : 0))
    return "pilot: it is active while it does not drive, or the reverse";
  if ((is != seen.state || life_.reason() != seen.reason) && pilot_->changes == seen.changes)
    return "report: a change is not told";
  if (life_.reason().empty() || (is != seen.state && life_.reason() == seen.reason))
    return "report: the reason of a change is missing";
  if (life_.elapsed(instant().time) != (spec_.driving() ? instant().time - spec_.running_since : 0))
    return "report: the time of the drive is wrong";
  return "";
}

/// Whether commands come often enough, and whether it asks for the next tick in time.
std::string LifecycleWorld::pauseProblem() const {
  const Instant due = life_.due(), at = instant();
  if (!(due.steady > at.steady && due.time > at.time)) return "keepalive: it asks for a tick that is over";
  if (std::min(due.steady - at.steady, due.time - at.time) > spec_.untilLimit(at) + 1e-9)
    return "keepalive: it asks for a tick that misses a limit";
  const double longest = ControllerLifecycle::kKeepalive +
                         (spec_.closed_loop || spec_.driving() ? 1 / spec_.params.rate : 0) + 2 * kTick;
  if (!spec_.othersDrive(at) && now_ - std::max(sent_at_, spec_.others_until) > longest)
    return "keepalive: no command for too long";
  return "";
}

}  // namespace lifecycle_search
}  // namespace ground
