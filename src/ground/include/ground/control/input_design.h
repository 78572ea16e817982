#pragma once

#include <string>
#include <vector>

#include "ground/control/controller_lifecycle.h"

namespace ground {

/// An input design by its name; each takes what it needs (designTable).
struct DesignParams {
  std::string kind = "prbs";
  double clock = 15.0;     ///< bits per second [Hz]
  /// Inputs that it is made of, 0..1; none: those of the design, 0 and 1 or 0, 0.25 .. 1.
  std::vector<double> levels;
  int order = 9;           ///< of the binary sequence: 2^order - 1 bits, 2..20
  unsigned long seed = 1;  ///< where in its period the sequence starts
  double hold = 1.0;       ///< duration of a level [s]
  std::string file;        ///< CSV, see readInputFile
  int rows_per_bit = 0;    ///< of a file of bits, 0: found in it

  std::string validate() const;  ///< what is wrong; empty when nothing is
};

/// What a design is, for people and for those that offer it.
struct DesignInfo {
  std::string name, text;
  std::vector<std::string> takes;  ///< names of members of DesignParams
};

/// All designs: prbs, multilevel-prbs, differential-prbs, steps, coast-down, spin, single-thruster,
/// multisine, file.
const std::vector<DesignInfo>& designTable();

/// Inputs over time, each held until the next; times ascend from 0.
struct InputSignal {
  std::vector<double> times;   ///< [s]
  std::vector<Inputs> inputs;  ///< 0..1
  double end = 0;              ///< [s]
  bool has_lift = false;       ///< whether lift is a part of it
  bool once = false;           ///< whether it is not to be repeated: rows of a file with times
  std::string description;     ///< of a file of bits, how it is played; else empty

  bool ended(double t) const;
  /// Inputs at time t [s]; zero before 0 and from the end on.
  Inputs at(double t) const;
  /// The first instant after t at which inputs change [s]; infinite after the end.
  double nextChange(double t) const;
};

/// A design played for `duration` [s], as often as needed; a file of timed rows ends earlier when
/// its rows do. Throws std::invalid_argument on bad parameters, std::runtime_error when the file
/// cannot be read.
InputSignal makeDesign(const DesignParams& params, double duration);

/// Reads inputs from a CSV file: rows under time,left,right or time,left,right,lift, each held until
/// the next and ending with the last time; or bits LEFT,RIGHT (readPrbs) that are played as `params`
/// say for `duration` [s]. Throws std::runtime_error that names file and line.
InputSignal readInputFile(const DesignParams& params, double duration);

}  // namespace ground
