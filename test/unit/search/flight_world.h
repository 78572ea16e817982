// A sender's link, a controller's life cycle, a rival, the mocap and the craft together: what leaves for the
// craft is checked against the promises of the documentation alone.
#pragma once

#include <string>
#include <vector>

#include "explore.h"
#include "fence_spec.h"
#include "ground/safety/controller_lifecycle.h"
#include "ground/safety/ground_link.h"
#include "lifecycle_world.h"

namespace ground {
namespace flight_search {

using search::Key;
using search::kTick;

/// Where packets and commands of a call arrive; copies of a world share it.
struct Shared {
  explicit Shared(lifecycle_search::SearchPilot::Loop loop) : pilot(loop) {}
  lifecycle_search::SearchPilot pilot;
  std::vector<MotorCommand> packets;
};

class FlightWorld : public search::World<FlightWorld> {
 public:
  explicit FlightWorld(Shared& shared);

  static const std::vector<search::Event<FlightWorld>>& table();
  void apply(int event);
  void show(Key& key) const;

 private:
  Instant instant() const { return {now_, now_}; }
  /// A pose at x, with the velocity u.
  void measure(double x = 0, double u = 0, bool valid = true, double age = 0);
  void rival(const std::string& name);
  void telemetry();
  void arm(bool armed);
  void start(bool started);
  void clockSet();
  void kill();
  void sendersEnd();
  void silence();
  /// Lets time pass; with `fed`, states and telemetry come.
  void pass(double duration, bool fed);
  /// As the sender does before it sends anything.
  void confine() { link_.confine(now_, guard_.objection(now_)); }
  /// Passes what the controller sent to the link, the link's state to the controller, and checks the packets.
  void exchange();
  void check();
  /// Something happened after which thrust has to end for good. A controller that still waits for an armed
  /// sender may go on to wait.
  void cut(bool waiting_goes_on = false);

  Shared* shared_;
  GroundLink link_;
  FenceGuard guard_;
  search::FenceSpec room_{Fence(Room(), 0), {}, {}, {}};  ///< what guard_ has to know
  ControllerLifecycle life_;
  std::size_t given_ = 0;  ///< commands of the controller that the link has got
  bool alive_ = true;      ///< the controller has not been killed
  bool told_armed_ = false;
  double last_valid_ = -1e9, heard_ = -1e9;  ///< last valid pose, last telemetry [s]
  double cut_at_ = -1e9;                     ///< the last event that ends a drive [s]
  double started_at_ = -1e9;                 ///< [s]
  bool lifted_ = false;                      ///< the controller has switched the lift on since its start
  bool by_hand_ = false, started_ = false;   ///< armed, started since the last such event
  double silent_until_ = -1e9;
  double lifts_since_ = -1e9;  ///< the lift is on since then; infinite while it is off [s]
  bool rivals_ = false;        ///< a controller took over from another one, which had lifted
  MotorCommand last_;
  bool sent_ = false;
};

}  // namespace flight_search
}  // namespace ground
