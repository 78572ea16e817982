#include "flight_world.h"

#include <algorithm>
#include <limits>

#include "requirements.h"
#include "wire.h"

namespace ground {
namespace flight_search {
namespace {

constexpr double kFrame = 1.0 / 32;  // time between states and telemetry that are fed [s]
constexpr double kSilence = 0.5, kHandover = 0.2, kPeriod = 0.02;  // [s]
constexpr double kQuick = 1.5;  // at this speed a craft stops inside, unless thrust goes on [m/s]
const UdpAddress kCraft{0x0a000002, 4000};
const MotorCommand kRivals{0.125, 0.375, 0.5};

}  // namespace

const std::vector<search::Event<FlightWorld>>& FlightWorld::table() {
  using W = FlightWorld;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  static const std::vector<search::Event<W>> all = {
      {"pose", [](W& w) { w.measure(); }},
      {"invalid pose", [](W& w) { w.measure(0, 0, false); }},
      {"state of NaN", [](W& w) { w.measure(kNan, 0); }},
      {"pose 1.7 m off", [](W& w) { w.measure(1.7, 0); }},
      {"pose 0.19 s old", [](W& w) { w.measure(0, 0, true, 0.19); }},
      {"pose of a craft that leaves the room", [](W& w) { w.measure(0, 3); }},
      {"pose of a quick craft", [](W& w) { w.measure(0, kQuick); }},
      {"telemetry", [](W& w) { w.telemetry(); }},
      {"arm", [](W& w) { w.arm(true); }},
      {"disarm", [](W& w) { w.arm(false); }},
      {"start", [](W& w) { w.start(true); }},
      {"stop", [](W& w) { w.start(false); }},
      {"second controller that says who it is", [](W& w) { w.rival("/rival"); }},
      {"second controller that does not", [](W& w) { w.rival(""); }},
      {"clock set", [](W& w) { w.clockSet(); }},
      {"the controller is killed", [](W& w) { w.kill(); }},
      {"the sender ends", [](W& w) { w.sendersEnd(); }},
      {"silence of 0.5 s", [](W& w) { w.silence(); }},
      {"0.1 s without poses", [](W& w) { w.pass(0.1, false); }},
      {"0.2 s without poses", [](W& w) { w.pass(0.2, false); }},
      {"0.5 s without poses", [](W& w) { w.pass(0.5, false); }},
      {"2.5 s without poses", [](W& w) { w.pass(2.5, false); }},
      {"0.1 s with poses", [](W& w) { w.pass(0.1, true); }},
      {"1.1 s with poses", [](W& w) { w.pass(1.1, true); }},
  };
  return all;
}

FlightWorld::FlightWorld(Shared& shared)
    : shared_(&shared),
      link_(
          [] {
            GroundLinkParams params;
            params.recovery_time = 0.5;
            return params;
          }(),
          {},
          [at = &shared](const MotorCommand& command, const UdpAddress&) {
            at->packets.push_back(search::overTheWire(command, *thrusterPair()));
            return std::string();
          }),
      life_(
          shared.pilot, [at = &shared](const Inputs& inputs) { at->pilot.sent.push_back(inputs); }, [] {}) {
  life_.setFence(Fence(Room(), 0.2));
  guard_.setFence(room_.fence);
}

void FlightWorld::apply(int event) {
  shared_->pilot.begin(false, false, false, false, false);
  shared_->packets.clear();
  given_ = 0;
  World::apply(event);
}

void FlightWorld::show(Key& key) const {
  link_.visit(key);
  life_.visit(key);
  guard_.visit(key);
  room_.visit(key);
  for (const bool flag : {alive_, told_armed_, by_hand_, started_, lifted_, sent_, lifts_since_ > now_})
    key.value(flag);
  for (const double t : {last_valid_, heard_, cut_at_, std::min(lifts_since_, now_)}) key.since(t);
  key.value(rivals_);
  key.deadline(silent_until_);
}

void FlightWorld::measure(double x, double u, bool valid, double age) {
  MeasuredState state;
  state.stamp = now_ - age;
  state.state.eta = Vector3<double>(x, 0, 0);
  state.state.nu = Vector3<double>(u, 0, 0);
  state.valid = valid;
  const bool finite = std::isfinite(x), usable = valid && finite;
  if (usable) last_valid_ = std::max(last_valid_, state.stamp);
  if (life_.driving() && (!finite || (usable && (x != 0 || u > kQuick)))) cut();
  link_.state(now_, age, usable, "lost");
  room_.measure(now_, {state.stamp, x, u, 0, valid, finite});
  guard_.state(now_, state);
  confine();
  if (alive_) life_.state(instant(), state);
  exchange();
}

void FlightWorld::rival(const std::string& name) {
  confine();
  link_.command(now_, 0, "/rival", kRivals);
  rivals_ = true;
  // A command within the handover may be a late one of a controller that was replaced.
  if (!name.empty() && now_ - started_at_ > kHandover) cut();
  if (!name.empty() && alive_) life_.otherDrives(instant(), name, kRivals.lift);
  exchange();
}

void FlightWorld::telemetry() {
  heard_ = now_;
  link_.datagram(now_, CraftTelemetry(), kCraft);
  exchange();
}

void FlightWorld::arm(bool armed) {
  if (!armed) {
    cut(true);
    link_.disarm(now_, "by hand");
  } else if (link_.arm(now_).empty()) {
    by_hand_ = true;
  }
  exchange();
}

void FlightWorld::start(bool started) {
  if (!started) cut();
  if (alive_ && started && life_.start(instant()).empty()) {
    started_ = true;
    lifted_ = false;
    started_at_ = now_;
  }
  if (alive_ && !started) life_.stop(instant(), "by hand");
  exchange();
}

void FlightWorld::clockSet() {
  cut(true);
  room_.clockSet();
  guard_.reset();
  link_.timeJumped(now_, "time jumped");
  if (alive_) life_.timeJumped(instant(), "time jumped");
  exchange();
}

void FlightWorld::kill() {
  cut();
  alive_ = false;
}

void FlightWorld::sendersEnd() {
  cut();
  link_.stop(now_, "the end");
  exchange();
}

void FlightWorld::silence() {
  exchange();
  confine();
  if (link_.silence(now_, kSilence).empty()) silent_until_ = now_ + kSilence;
  exchange();
}

void FlightWorld::pass(double duration, bool fed) {
  const double until = now_ + search::onTick(duration);
  double next_frame = fed ? now_ : until + 1;
  while (violation_.empty()) {
    if (now_ >= next_frame) {
      telemetry();
      measure();
      next_frame += kFrame;
    }
    if (now_ >= until) break;
    const Instant due = life_.due();
    const double at = alive_ ? std::min(due.steady, due.time) : until;
    now_ = search::onTick(
        std::min({until, next_frame, std::max({std::min(at, link_.nextPacket()), now_ + kTick})}));
    if (alive_) life_.tick(instant());
    exchange();
    confine();
    link_.tick(now_);
    exchange();
  }
}

void FlightWorld::exchange() {
  while (true) {
    std::vector<Inputs>& sent = shared_->pilot.sent;
    for (; given_ < sent.size(); ++given_) {
      lifted_ = lifted_ || sent[given_].lift > 0;
      confine();
      link_.command(now_, 0, "/controller", sent[given_]);
      check();
    }
    const bool armed = link_.current() == GroundLink::State::kArmed;
    if (armed == told_armed_) break;
    told_armed_ = armed;
    if (!armed) cut(true);
    if (alive_) life_.sender(instant(), armed, link_.reason());
  }
  check();
}

void FlightWorld::cut(bool waiting_goes_on) {
  if (by_hand_ || started_) cut_at_ = now_;
  if (link_.current() != GroundLink::State::kArmed) by_hand_ = false;
  started_ = started_ && waiting_goes_on && !lifted_;
}

void FlightWorld::check() {
  using namespace requirements;  // NOLINT
  for (const MotorCommand& packet : shared_->packets) {
    last_ = packet;
    const double acceleration = shared_->pilot.pushed(packet).x();
    const bool leaves = room_.leaves(now_);
    room_.sends(now_, acceleration);
    guard_.sent(now_, {acceleration, 0});
    sent_ = true;
    if (!(packet.lift > 0))
      lifts_since_ = std::numeric_limits<double>::infinity();
    else
      lifts_since_ = std::min(lifts_since_, now_);
    if (!violation_.empty() || packet.thrust() == 0) continue;
    const double after = now_ - cut_at_;
    if (now_ - last_valid_ > kThrustAfterState)
      violation_ = "thrust-after-state: there was no valid pose for longer than the limit";
    else if (!by_hand_ && after > kThrustAfterEnd)
      violation_ = "thrust-before-arming: thrust without arming by hand";
    else if (!started_ && after > kThrustAfterEnd)
      violation_ = "thrust-after-end: thrust after the drive had ended";
    else if (leaves)
      violation_ = "fence: thrust for a craft that is about to leave the room";
    else if (packet.thrusters == kRivals.thrusters)
      violation_ = "one-publisher: a command of the rival was sent";
    else if (now_ - heard_ > kCraftSilence)
      violation_ = "craft-silence: thrust for a craft that is silent";
    else if (now_ < silent_until_ && now_ > silent_until_ - kSilence)
      violation_ = "silence: thrust during a silence";
    else if (!(packet.lift > 0))
      violation_ = "thrust-without-lift: thrust without lift";
    else if (!rivals_ && now_ - lifts_since_ < life_.params().lift_time - kPeriod)
      violation_ = "lift-before-thrust: thrust before the lift was on for lift_time";
  }
  shared_->packets.clear();
  const bool over = !by_hand_ || !started_;
  expect(!sent_ || !over || now_ - cut_at_ <= kThrustAfterEnd || now_ <= silent_until_ + kPeriod ||
             last_.thrust() <= 0,
         "zeros-after-end: no zeros after the end");
  if (told_ && !violation_.empty()) tell("  " + violation_);
}

}  // namespace flight_search
}  // namespace ground
