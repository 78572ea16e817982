#include "link_world.h"

#include <algorithm>
#include <limits>

#include "../crafts.h"
#include "wire.h"

namespace ground {
namespace link_search {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFeed = 1.0 / 16;  // time between commands, states and telemetry that are fed [s]
constexpr double kStall = 3;        // nobody calls for so long [s]
const UdpAddress kCraft{0x0a000002, 4000}, kRestarted{0x0a000002, 4001}, kStranger{0x0a000003, 4000};
constexpr std::uint32_t kCount = 1000;  // first count of a craft; no sequence reaches 0
const MotorCommand kZero{}, kDrive{0.5, 0.25, 1}, kStrong{0.5, 0.75, 1}, kOther{0.125, 0.375, 0.5};
const MotorCommand kInvalid{kNan, 0, 1}, kWithoutLift{0, 0.5, 0}, kLift{0, 0, 0.5};

const char* nameOf(GroundLink::State state) {
  static const char* const names[] = {"DISARMED", "ARMED", "FAULT"};
  return names[static_cast<int>(state)];
}

}  // namespace

using W = LinkWorld;
using Events = std::vector<search::Event<W>>;

const Events& W::table() {
  static const Events all = [] {
    Events result = inputs();
    for (const auto& part : {faults(), times()}) result.insert(result.end(), part.begin(), part.end());
    return result;
  }();
  return all;
}

Events W::inputs() {
  return {
      {"state", [](W& w) { w.state(); }},
      {"old state", [](W& w) { w.state(true, w.params_.state_timeout - kTick); }},
      {"stale state", [](W& w) { w.state(true, w.params_.state_timeout); }},
      {"state from the future", [](W& w) { w.state(true, -1 - kTick); }},
      {"state a second ahead", [](W& w) { w.state(true, -1); }},
      {"state of age NaN", [](W& w) { w.state(true, kNan); }},
      {"invalid state", [](W& w) { w.state(false); }},
      {"zero command", [](W& w) { w.command(kZero); }},
      {"command", [](W& w) { w.command(kDrive); }},
      {"strong command", [](W& w) { w.command(kStrong); }},
      {"old command", [](W& w) { w.command(kDrive, "/a", w.params_.command_timeout - kTick); }},
      {"stale command", [](W& w) { w.command(kDrive, "/a", w.params_.command_timeout); }},
      {"command from the future", [](W& w) { w.command(kDrive, "/a", -1 - kTick); }},
      {"command a second ahead", [](W& w) { w.command(kDrive, "/a", -1); }},
      {"command of NaN", [](W& w) { w.command(kInvalid); }},
      {"command without lift", [](W& w) { w.command(kWithoutLift); }},
      {"lift alone", [](W& w) { w.command(kLift); }},
      {"command for more thrusters", [](W& w) { w.command(kDrive, "/a", 0, 1); }},
      {"zero command of another", [](W& w) { w.command(kZero, "/b"); }},
      {"command of another", [](W& w) { w.command(kOther, "/b"); }},
      {"hello", [](W& w) { w.datagram(kCraft, {}); }},
      {"telemetry", [](W& w) { w.telemetry(kCraft); }},
      {"telemetry with a new count", [](W& w) { w.telemetry(kCraft, w.spec_.count.value_or(kCount) + 1); }},
      {"telemetry with the same count", [](W& w) { w.telemetry(kCraft, w.spec_.count.value_or(kCount)); }},
      {"telemetry with a lower count", [](W& w) { w.telemetry(kCraft, w.spec_.count.value_or(kCount) - 1); }},
      {"telemetry with a boot id", [](W& w) { w.telemetry(kCraft, {}, w.spec_.boot.value_or(0)); }},
      {"telemetry of a restarted craft with a boot id",
       [](W& w) { w.telemetry(kCraft, kCount - 100, w.spec_.boot.value_or(0) + 1); }},
      {"telemetry of the other port", [](W& w) { w.telemetry(kRestarted); }},
      {"telemetry of a stranger", [](W& w) { w.telemetry(kStranger); }},
      {"hello of a stranger", [](W& w) { w.datagram(kStranger, {}); }},
  };
}

Events W::faults() {
  return {
      {"arm", [](W& w) { w.arm(); }},
      {"disarm", [](W& w) { w.disarm(); }},
      {"end", [](W& w) { w.stop(); }},
      {"silence of 0.5 s", [](W& w) { w.silence(0.5); }},
      {"silence of 2 s", [](W& w) { w.silence(2); }},
      {"silence of no time", [](W& w) { w.silence(0); }},
      {"too long a silence", [](W& w) { w.silence(2 + kTick); }},
      {"zero packet", [](W& w) { w.zero(); }},
      {"clock set", [](W& w) { w.clockSet(); }},
      {"the craft does not obey", [](W& w) { w.disobeyed(); }},
      {"the craft leaves the room", [](W& w) { w.confine(false); }},
      {"the craft is in the room", [](W& w) { w.confine(true); }},
      {"packets cannot be sent", [](W& w) { w.broken_ = true; }},
      {"packets can be sent", [](W& w) { w.broken_ = false; }},
      {"half as long timeouts", [](W& w) { w.setParams(true); }},
      {"timeouts as before", [](W& w) { w.setParams(false); }},
      {"bad parameters", [](W& w) { w.setBadParams(); }},
  };
}

Events W::times() {
  using F = Feed;
  return {
      {"until just before a limit", [](W& w) { w.waitForLimit(-1, F::kNothing); }},
      {"until a limit", [](W& w) { w.waitForLimit(0, F::kNothing); }},
      {"until just after a limit", [](W& w) { w.waitForLimit(1, F::kNothing); }},
      {"driving, until just before a limit", [](W& w) { w.waitForLimit(-1, F::kDrive); }},
      {"driving, until a limit", [](W& w) { w.waitForLimit(0, F::kDrive); }},
      {"driving, until just after a limit", [](W& w) { w.waitForLimit(1, F::kDrive); }},
      {"driving, the count stands still until just before its limit",
       [](W& w) { w.waitForLimit(-1, F::kStuckCount); }},
      {"driving, the count stands still until its limit", [](W& w) { w.waitForLimit(0, F::kStuckCount); }},
      {"driving, the count stands still until just after its limit",
       [](W& w) { w.waitForLimit(1, F::kStuckCount); }},
      {"5 ms pass", [](W& w) { w.pass(w.now_ + 5 * kTick, F::kNothing); }},
      {"nobody calls for 3 s", [](W& w) { w.now_ += kStall; }},
  };
}

/// What could be seen before a call.
struct LinkWorld::Before {
  GroundLink::State state;
  std::string reason;
  UdpAddress peer;
  std::uint64_t revision;
  GroundLink::Counters counters;
  bool silent, lost, refused;
  MotorCommand blind;
};

LinkWorld::LinkWorld(const GroundLinkParams& params, Wire& wire, const UdpAddress& craft,
                     const ThrusterLayoutPtr& layout)
    : params_(params),
      wire_(&wire),
      link_(
          params, craft,
          [at = &wire, layout](const MotorCommand& command, const UdpAddress& to) {
            at->packets.push_back({search::overTheWire(command, *layout), to});
            return at->broken ? std::string("the network is unreachable") : std::string();
          },
          layout),
      attempted_(MotorCommand::off(layout->size())) {
  spec_.params = params;
  spec_.thrusters = layout->size();
  spec_.fixed = spec_.craft = craft;
  if (craft.port != 0) known_since_ = now_;
}

bool LinkWorld::possible(int event) const {
  const std::string& name = events()[static_cast<std::size_t>(event)];
  if (name == "packets can be sent") return broken_;
  return name != "packets cannot be sent" || !broken_;
}

void LinkWorld::show(Key& key) const {
  link_.visit(key);
  spec_.visit(key);
  key.value(broken_);
}

// --- Events

void LinkWorld::command(const MotorCommand& of_two, const std::string& source, double age, int more) {
  const Before seen = before();
  MotorCommand command = MotorCommand::off(spec_.thrusters + more, of_two.lift);
  std::copy(of_two.thrusters.begin(), of_two.thrusters.end(), command.thrusters.begin());
  const bool accepted = spec_.command(now_, age, source, command);
  link_.command(now_, age, source, command);
  if (link_.counters().refused - seen.counters.refused != (accepted ? 0u : 1u) && violation_.empty())
    violation_ = std::string("commands: one was ") + (accepted ? "refused: " + link_.refusal() : "accepted");
  expect(accepted || link_.refusal().rfind("a command of " + source, 0) == 0,
         "report: it does not say which command was refused");
  check(seen, "command", accepted);
}

void LinkWorld::state(bool valid, double age) {
  const Before seen = before();
  spec_.measure(now_, age, valid);
  link_.state(now_, age, valid, valid ? "" : "lost");
  check(seen, "state");
}

void LinkWorld::datagram(const UdpAddress& from, const std::optional<CraftTelemetry>& content) {
  const Before seen = before();
  const bool known = spec_.datagram(now_, from, content.has_value());
  if (spec_.craft != seen.peer) known_since_ = now_;
  if (known && content) spec_.telemetry(now_, content->commands, content->boot);
  const bool taken = link_.datagram(now_, content, from);
  const GroundLink::Counters &is = link_.counters(), &was = seen.counters;
  const bool counted = is.malformed - was.malformed == (content ? 0u : 1u) &&
                       is.foreign - was.foreign == (known ? 0u : 1u) &&
                       is.received - was.received == (known && content ? 1u : 0u);
  if ((taken != (known && content) || !counted) && violation_.empty())
    violation_ =
        std::string("craft: a datagram was ") + (taken ? "taken" : "ignored") + " or counted wrongly";
  check(seen, "datagram");
}

void LinkWorld::telemetry(const UdpAddress& from, std::optional<std::uint32_t> count,
                          std::optional<std::uint32_t> boot) {
  CraftTelemetry content;
  content.commands = count;
  content.boot = boot;
  datagram(from, content);
}

void LinkWorld::arm() {
  const Before seen = before();
  const bool must = spec_.arm(now_);
  const std::string refused = link_.arm(now_);
  if (must != refused.empty() && violation_.empty())
    violation_ = must ? "arming: it is refused: " + refused : "arming: it armed, and something was missing";
  check(seen, "arm");
}

void LinkWorld::silence(double duration) {
  const Before seen = before();
  const bool must = spec_.silence(now_, duration) && !broken_;
  begins_silence_ = true;
  const std::string refused = link_.silence(now_, duration);
  if (must != refused.empty() && violation_.empty())
    violation_ = must ? "silence: it is refused: " + refused : "silence: it was allowed";
  if (must) spec_.silent_until = now_ + duration;
  expect(!must || link_.revision() != seen.revision, "report: the silence is not told");
  check(seen, "silence");
  begins_silence_ = false;
}

void LinkWorld::disarm() {
  const Before seen = before();
  spec_.end(GroundLink::State::kDisarmed);
  link_.disarm(now_, "by hand");
  check(seen, "disarm");
}

void LinkWorld::stop() {
  const Before seen = before();
  spec_.end(GroundLink::State::kDisarmed);
  spec_.stopped = true;
  link_.stop(now_, "the end");
  check(seen, "stop");
}

void LinkWorld::tick() {
  const Before seen = before();
  spec_.pass(now_);
  link_.tick(now_);
  const double pause = now_ - std::max(attempted_at_, known_since_);
  expect(spec_.craft.port == 0 || spec_.silent_until || !wire_->packets.empty() ||
             pause < 1 / spec_.params.keepalive_rate + kTick,
         "keepalive: no packet for longer than the period");
  expect(link_.nextPacket() > now_, "keepalive: the next packet is overdue");
  check(seen, "tick");
}

void LinkWorld::zero() {
  const Before seen = before();
  link_.sendZero(now_);
  expect(spec_.craft.port == 0 || !wire_->packets.empty(), "zeros: none was sent");
  check(seen, "zero");
}

void LinkWorld::clockSet() {
  const Before seen = before();
  spec_.clockSet(now_);
  link_.timeJumped(now_, "time jumped");
  check(seen, "clock");
}

void LinkWorld::disobeyed() {
  const Before seen = before();
  if (spec_.armed() && !spec_.silent_until) spec_.end(GroundLink::State::kFault);
  link_.disobeyed(now_, "it moves as without thrust");
  check(seen, "disobeyed");
}

void LinkWorld::confine(bool inside) {
  const Before seen = before();
  spec_.in_room = inside;
  if (spec_.armed() && !inside) spec_.end(GroundLink::State::kFault);
  link_.confine(now_, inside ? "" : "the craft is outside of the room");
  check(seen, "confine");
}

void LinkWorld::setParams(bool shorter) {
  const Before seen = before();
  GroundLinkParams params = params_;
  if (shorter) {
    params.state_timeout /= 2;
    params.command_timeout /= 2;
    params.recovery_time /= 2;
    params.keepalive_rate *= 2;
  }
  spec_.params = params;
  link_.setParams(params);
  check(seen, "params");
}

void LinkWorld::setBadParams() {
  const Before seen = before();
  GroundLinkParams params = params_;
  params.state_timeout = -1;
  const auto send = [](const MotorCommand&, const UdpAddress&) { return std::string(); };
  expect(!refusal([&] { link_.setParams(params); }).empty(), "parameters: bad ones are taken");
  expect(!refusal([&] { GroundLink(params, {}, send); }).empty(), "parameters: bad ones are taken");
  check(seen, "params");
}

// --- Time

double LinkWorld::nextLimit(Feed feed) const {
  std::vector<double> limits;
  const auto add = [&](double t) {
    if (t > now_) limits.push_back(onTick(t));
  };
  if (feed == Feed::kStuckCount) {
    add(spec_.counted + spec_.params.obedience_timeout);
  } else {
    add(spec_.heard + spec_.params.craft_timeout);
    add(spec_.heard + LinkSpec::kReturn);
    if (spec_.silent_until) add(*spec_.silent_until);
    if (spec_.broken_since) add(*spec_.broken_since + LinkSpec::kSendTimeout);
  }
  if (feed == Feed::kNothing) {
    add(spec_.measured + spec_.params.state_timeout);
    add(spec_.issued + spec_.params.command_timeout);
    add(spec_.clash_until);
    if (spec_.lost_since) add(*spec_.lost_since + spec_.params.recovery_time);
  }
  return limits.empty() ? now_ : *std::min_element(limits.begin(), limits.end());
}

void LinkWorld::waitForLimit(int ticks, Feed feed) {
  const double limit = nextLimit(feed);
  if (limit > now_) pass(limit + ticks * kTick, feed);
}

void LinkWorld::pass(double until, Feed feed) {
  double next_feed = feed == Feed::kNothing ? until + 1 : now_;
  while (violation_.empty()) {
    if (now_ >= next_feed) {
      state();
      command(kDrive);
      if (feed == Feed::kStuckCount) telemetry(kCraft, spec_.count.value_or(kCount));
      next_feed += kFeed;
    }
    if (now_ >= until) break;
    const double due = onTick(std::max(link_.nextPacket(), now_ + kTick));
    now_ = std::min({until, due, std::max(next_feed, now_ + kTick)});
    tick();
  }
  if (feed == Feed::kStuckCount && violation_.empty()) telemetry(kCraft, spec_.count.value_or(kCount));
}

// --- Checks

LinkWorld::Before LinkWorld::before() const {
  wire_->packets.clear();
  wire_->broken = broken_;
  return {link_.current(),
          link_.reason(),
          link_.peer(),
          link_.revision(),
          link_.counters(),
          spec_.silent_until.has_value(),
          spec_.lost_since.has_value(),
          spec_.refused,
          spec_.blind()};
}

void LinkWorld::check(const Before& seen, const std::string& call, bool accepted) {
  if (!wire_->packets.empty()) {
    noteSending();
    if (call != "zero") scheduled_at_ = now_;
  }
  const double next = scheduled_at_ + 1 / spec_.params.keepalive_rate;
  expect(scheduled_at_ < known_since_ || scheduled_at_ <= 0 || spec_.silent_until ||
             std::abs(link_.nextPacket() - next) <= 1e-9,
         "keepalive: the next packet is not a period after the last");
  if (!violation_.empty()) return;
  for (const auto& problem : {packetProblem(seen), stateProblem(seen), reportProblem(seen)})
    if (violation_.empty()) violation_ = problem;
  expect(!accepted || !spec_.mayDrive(now_) || (attempted_ == spec_.accepted && attempted_at_ == now_),
         "commands: one that was accepted was not sent at once");
  if (told_ && !violation_.empty()) tell("  (" + call + ") " + violation_);
}

void LinkWorld::noteSending() {
  attempted_ = wire_->packets.back().command;
  attempted_at_ = now_;
  if (!broken_)
    spec_.broken_since.reset();
  else if (!spec_.broken_since)
    spec_.broken_since = now_;
}

/// Which packets may leave.
std::string LinkWorld::packetProblem(const Before& seen) const {
  const bool silent = seen.silent && spec_.silent_until;
  if (silent && !begins_silence_ && !wire_->packets.empty() && !wire_->packets.back().command.zero())
    return "silence: a command was sent";
  for (const Wire::Packet& packet : wire_->packets) {
    if (packet.to != spec_.craft) return "craft: a packet went to another address";
    const MotorCommand& c = packet.command;
    if (c.zero() || (c == seen.blind && seen.state == GroundLink::State::kArmed)) continue;
    if (!spec_.armed())
      return spec_.state == GroundLink::State::kFault ? "fault: a command was sent in FAULT"
                                                      : "armed: a command was sent while disarmed";
    if (!spec_.commanded(now_)) return "stale: a command was sent that is too old";
    if (c == spec_.blind()) continue;
    if (!spec_.supported(now_)) return "state: more than the lift was sent without a valid state";
    if (c != spec_.accepted)
      return "publisher: a command was sent that is not the last one of its controller";
    if (spec_.params.require_lift && c.thrust() > 0 && !(c.lift > 0))
      return "lift: thrust without lift was sent";
  }
  return "";
}

/// Which state it must be in.
std::string LinkWorld::stateProblem(const Before& seen) const {
  using State = GroundLink::State;
  const State is = link_.current();
  const std::string became =
      std::string(nameOf(seen.state)) + " became " + nameOf(is) + ": " + link_.reason();
  if (seen.state == State::kFault && is != State::kFault && spec_.state == State::kFault)
    return "fault: it did not end by hand: " + became;
  if (is != spec_.state)
    return is == State::kArmed ? std::string("ends: it is still ARMED and must be ") + nameOf(spec_.state)
                               : std::string("cause: it must be ") + nameOf(spec_.state) + ": " + became;
  const bool ended = seen.state == State::kArmed && is != State::kArmed;
  const bool stops = ended || (spec_.lost_since && !seen.lost && seen.state == State::kArmed);
  const MotorCommand stopped = ended ? MotorCommand::off(spec_.thrusters) : spec_.blind();
  if (stops && !(attempted_ == stopped && attempted_at_ == now_))
    return "zeros: none follows the end: " + became;
  if (link_.peer() != spec_.craft) return "craft: another address counts as the craft";
  return "";
}

/// Whether what it shows is true.
std::string LinkWorld::reportProblem(const Before& seen) const {
  const bool changed =
      link_.current() != seen.state || link_.reason() != seen.reason || link_.peer() != seen.peer;
  if (changed && link_.revision() == seen.revision) return "report: a change is not told";
  if (link_.reason().empty() || (link_.current() != seen.state && link_.reason() == seen.reason))
    return "report: the reason of a change is missing";
  if (spec_.armed() && seen.state == GroundLink::State::kArmed && spec_.lost_since.has_value() != seen.lost &&
      link_.reason() == seen.reason)
    return "report: the loss of the state, or its end, is not told";
  const bool stale = link_.reason() != seen.reason && link_.reason().rfind("commands are stale", 0) == 0;
  if (stale && (link_.reason().find("a command of") != std::string::npos) != seen.refused)
    return "report: it does not say whether the newest command was refused";
  const bool lifts = spec_.armed();
  const MotorCommand& lifting = spec_.silent_until ? attempted_ : spec_.accepted;
  if (link_.lift() != (lifts ? lifting.lift : 0)) return "report: the lift is wrong";
  if (link_.sent() != attempted_) return "report: the last packet is wrong";
  const std::uint64_t left = broken_ ? 0 : wire_->packets.size();
  if (link_.counters().sent - seen.counters.sent != left) return "report: packets are counted wrongly";
  if (link_.sendProblem().empty() == spec_.broken_since.has_value()) return "report: sending fails unseen";
  return "";
}

}  // namespace link_search
}  // namespace ground
