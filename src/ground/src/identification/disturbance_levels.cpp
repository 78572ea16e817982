#include "ground/identification/disturbance_levels.h"

#include "ground/model/typical.h"

namespace ground {

std::array<double, DisturbanceLevels::kCount> DisturbanceLevels::values() const {
  return {sigma(0), sigma(1), sigma(2), sigma_room, time(0), time(1), time(2), time_room, white(0),
          white(1), white(2), position, heading,    trim(0), trim(1), trim(2), thrust};
}

DisturbanceLevels DisturbanceLevels::of(const std::array<double, kCount>& v) {
  DisturbanceLevels levels;
  levels.sigma << v[0], v[1], v[2];
  levels.sigma_room = v[3];
  levels.time << v[4], v[5], v[6];
  levels.time_room = v[7];
  levels.white << v[8], v[9], v[10];
  levels.position = v[11];
  levels.heading = v[12];
  levels.trim << v[13], v[14], v[15];
  levels.thrust = v[16];
  return levels;
}

const std::array<std::string, DisturbanceLevels::kCount>& DisturbanceLevels::names() {
  static const std::array<std::string, kCount> names = {
      "sigma_X", "sigma_Y", "sigma_N",  "sigma_room", "time_X", "time_Y", "time_N", "time_room", "white_X",
      "white_Y", "white_N", "position", "heading",    "trim_X", "trim_Y", "trim_N", "thrust"};
  return names;
}

LevelPrior::LevelPrior(const Body<double>& body) {
  const double force = typical::force(body), moment = typical::moment(body);
  const Vector3<double> full(force, force, moment);
  median.sigma = 0.02 * full;
  median.time.setConstant(0.3);
  median.sigma_room = 0.003 * force;
  median.time_room = 1;
  median.white = 0.001 * full;
  median.trim = 0.003 * full;
  median.thrust = 0.01;
  deviation = {1.5, 1.5, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0, 1.5, 1.5, 1.5, 0.4, 0.4, 1.5, 1.5, 1.5, 0.7};
}

}  // namespace ground
