#pragma once

#include <string>

#include "ground/safety/controller_lifecycle.h"
#include "ground/safety/room.h"

namespace ground {

/// What may go wrong at once in a drive inside a room, from the last valid state on.
struct Upset {
  double push = 0;          ///< steady force on the craft, as a share of full thrust
  double blind = 0;         ///< time without a pose [s]
  double thrust_error = 0;  ///< acceleration by the thrusters that the model does not know, as a share of it
};

/// Largest acceleration of a craft by its thrusters at `time` (clock of stamps) [m/s^2]; 0 if the pilot does
/// not know the craft.
double fullAcceleration(const Pilot& pilot, double time);

/// Speed [m/s] up to which a Fence that keeps the room's margin keeps a craft inside, whatever the controller
/// commands; 0 if none is certain. `full`: fullAcceleration().
///
/// The fence predicts the way with the thrust that is on. What it does not know, c = push + thrust_error
/// times full, acts from the state until the motors are off, for t = blind + kLate + latency; then the
/// push works against the floor. At a predicted speed v the craft comes to rest farther by
///
///     c t^2 / 2 + (v + c t)^2 / (2 (braking - push)) - v^2 / (2 braking)
///
/// which must not exceed the margin. The speed is v + c t.
double largestSafeSpeed(const Room& room, double full, const Upset& upset);

/// Sentences about the speeds up to which a craft stays in a room.
std::string fenceBound(const Room& room, double full);

}  // namespace ground
