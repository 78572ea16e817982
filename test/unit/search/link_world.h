// A link, the craft, controllers and a clock: the world in which every sequence of events is tried.
#pragma once

#include <string>
#include <vector>

#include "explore.h"
#include "ground/safety/ground_link.h"
#include "link_spec.h"

namespace ground {
namespace link_search {
using search::Key;
using search::kTick;
using search::onTick;

/// Where the packets of a call arrive; all copies of a world share it.
struct Wire {
  struct Packet {
    MotorCommand command;
    UdpAddress to;
  };
  std::vector<Packet> packets;  ///< that left, or would have
  bool broken = false;
};

class LinkWorld : public search::World<LinkWorld> {
 public:
  /// `craft`: its address if fixed, port 0 for any port; unknown if it is learned.
  LinkWorld(const GroundLinkParams& params, Wire& wire, const UdpAddress& craft = {},
            const ThrusterLayoutPtr& layout = thrusterPair());

  static const std::vector<search::Event<LinkWorld>>& table();
  bool possible(int event) const;
  void show(Key& key) const;

  const GroundLink& link() const { return link_; }

 private:
  static std::vector<search::Event<LinkWorld>> inputs();
  static std::vector<search::Event<LinkWorld>> faults();
  static std::vector<search::Event<LinkWorld>> times();
  enum class Feed { kNothing, kDrive, kStuckCount };
  struct Before;

  /// `of_two`: inputs of the first two thrusters, the others are off; `more`: thrusters that it has in
  /// excess.
  void command(const MotorCommand& of_two, const std::string& source = "/a", double age = 0, int more = 0);
  void state(bool valid = true, double age = 0);
  void datagram(const UdpAddress& from, const std::optional<CraftTelemetry>& content);
  void telemetry(const UdpAddress& from, std::optional<std::uint32_t> count = {},
                 std::optional<std::uint32_t> boot = {});
  void arm();
  void silence(double duration);
  void disarm();
  void stop();
  void tick();
  void zero();
  void clockSet();
  void disobeyed();
  void confine(bool inside);
  void setParams(bool shorter);
  void setBadParams();
  /// Lets time pass with ticks on time, up to `ticks` after the next limit.
  void waitForLimit(int ticks, Feed feed);
  void pass(double until, Feed feed);
  double nextLimit(Feed feed) const;

  Before before() const;
  /// Checks all invariants after a call; `accepted`: it was a command that has to go out.
  void check(const Before& before, const std::string& call, bool accepted = false);
  std::string packetProblem(const Before& before) const;
  std::string stateProblem(const Before& before) const;
  std::string reportProblem(const Before& before) const;
  void noteSending();

  GroundLinkParams params_;
  Wire* wire_;
  GroundLink link_;
  LinkSpec spec_;
  double attempted_at_ = -1e9;  ///< time of the last packet [s]
  MotorCommand attempted_;
  double scheduled_at_ = -1e9;  ///< time of the last packet after which the next one is a period later [s]
  double known_since_ = -1e9;   ///< time since which the craft has its address [s]
  bool broken_ = false;
  bool begins_silence_ = false;
};

}  // namespace link_search
}  // namespace ground
