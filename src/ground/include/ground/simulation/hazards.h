#pragma once

#include <optional>
#include <string>

#include "ground/estimation/axis_mapping.h"
#include "ground/model/types.h"

namespace ground {

/// What goes wrong in a simulated experiment, beside the noise and losses of MocapParams. Times are on
/// the experiment's clock. By default nothing does.
struct Hazards {
  /// A stretch of time.
  struct Spell {
    double from = 0, duration = 0;  ///< [s]

    bool covers(double time) const { return time >= from && time < from + duration; }
  };

  Vector2<double> push{0, 0};  ///< force on the craft, world_ned [N]
  Spell pushed;                ///< when `push` acts
  Spell unseen;                ///< poses captured then are lost
  Spell unheard;               ///< commands sent then do not reach the craft
  /// Setting of mocap_state, while the axes of the mocap are AxisMapping::kOptiTrack.
  std::string axes = AxisMapping::kOptiTrack;
  double heading_offset = 0;  ///< error of that setting [rad]
  double upright_time = 1;    ///< time for which a craft that seemed to lean is not believed [s]
  double braking = 2;         ///< deceleration by the floor while the lift is off [m/s^2]

  std::string validate() const;  ///< error message; empty if all values are valid
  bool confused() const { return axes != AxisMapping::kOptiTrack || heading_offset != 0; }
};

/// The poses that mocap_state makes of true ones with the settings of Hazards.
class ConfusedAxes {
 public:
  /// Throws std::invalid_argument on bad axes.
  explicit ConfusedAxes(const Hazards& hazards) : believed_(hazards.axes, hazards.heading_offset) {}

  /// Nothing, with the reason in `why`, if the craft seems to lean.
  std::optional<Vector3<double>> seen(const Vector3<double>& eta, const char** why) const;

 private:
  AxisMapping true_, believed_;
};

}  // namespace ground
