#include "ground/identification/disturbance_levels.h"

#include "ground/model/typical.h"

namespace ground {

std::array<double, DisturbanceLevels::kCount> DisturbanceLevels::values() const {
  return {sigma(0), sigma(1), sigma(2), time(0),  time(1), time(2), white(0), white(1),
          white(2), position, heading,  trim(0), trim(1), trim(2), thrust};
}

DisturbanceLevels DisturbanceLevels::of(const std::array<double, kCount>& v) {
  DisturbanceLevels levels;
  levels.sigma << v[0], v[1], v[2];
  levels.time << v[3], v[4], v[5];
  levels.white << v[6], v[7], v[8];
  levels.position = v[9];
  levels.heading = v[10];
  levels.trim << v[11], v[12], v[13];
  levels.thrust = v[14];
  return levels;
}

const std::array<std::string, DisturbanceLevels::kCount>& DisturbanceLevels::names() {
  static const std::array<std::string, kCount> names = {
      "sigma_X", "sigma_Y", "sigma_N",  "time_X",  "time_Y", "time_N", "white_X", "white_Y",
      "white_N", "position", "heading", "trim_X", "trim_Y", "trim_N", "thrust"};
  return names;
}

LevelPrior::LevelPrior(const Body<double>& body) {
  const double force = typical::force(body), moment = typical::moment(body);
  const Vector3<double> full(force, force, moment);
  median.sigma = 0.02 * full;
  median.time.setConstant(0.3);
  median.white = 0.001 * full;
  median.trim = 0.003 * full;
  median.thrust = 0.01;
  deviation = {1.5, 1.5, 1.5, 1.0, 1.0, 1.0, 1.5, 1.5, 1.5, 0.4, 0.4, 1.5, 1.5, 1.5, 0.7};
}

}  // namespace ground
