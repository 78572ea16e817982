#pragma once

#include <string>

#include "ground/model/inputs.h"

namespace ground {

/// A simulated lithium battery, relative to the voltage at which the model's k holds.
struct BatteryParams {
  double endurance = 0;  ///< a full battery drives all motors at their largest input so long [s]; 0: none
  double charge = 1;     ///< at the start, 0..1

  bool empty() const { return endurance == 0; }
  std::string validate() const;  ///< error message; empty if all values are valid
};

/// Its open-circuit voltage falls linearly with the charge; a resistance lowers the voltage in proportion
/// to the power that the motors draw.
class Battery {
 public:
  /// `nominal`: voltage at which k holds [V]. Throws std::invalid_argument on bad parameters, or without it.
  Battery(const BatteryParams& params, double nominal, double start);

  /// Moves to a time [s] under the present inputs, which are relative to the largest ones.
  void advance(double time);
  void draw(const Inputs& inputs);
  double voltage() const;  ///< at the terminals [V]

 private:
  // Volts of a cell of 3.7 V: full, empty; and the loss by the resistance at full power.
  static constexpr double kFull = 4.2 / 3.7, kEmpty = 3.3 / 3.7, kLoss = 0.3 / 3.7;

  double nominal_, endurance_, charge_, time_;
  double power_ = 0;  ///< share of full power
};

}  // namespace ground
