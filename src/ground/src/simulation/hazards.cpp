#include "ground/simulation/hazards.h"

#include <cmath>

namespace ground {

std::string Hazards::validate() const {
  if (!push.allFinite()) return "the push is not finite";
  for (const Spell& spell : {pushed, unseen, unheard})
    if (!std::isfinite(spell.from) || !(spell.duration >= 0))
      return "a spell must begin at a finite time and must not have a negative duration";
  if (!std::isfinite(heading_offset)) return "heading_offset must be finite";
  if (!(upright_time >= 0)) return "upright_time must not be negative";
  return braking >= 0 && std::isfinite(braking) ? "" : "braking must be finite and not negative";
}

std::optional<Vector3<double>> ConfusedAxes::seen(const Vector3<double>& eta, const char** why) const {
  Eigen::Vector3d position;
  Eigen::Quaterniond orientation;
  true_.toMocap(eta, 0, position, orientation);
  return believed_.toPlanar(position, orientation, why);
}

}  // namespace ground
