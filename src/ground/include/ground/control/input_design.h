#pragma once

#include <string>
#include <vector>

#include "ground/control/prbs.h"
#include "ground/model/inputs.h"
#include "ground/model/thruster.h"

namespace ground {

/// An input design by its name, and the parameters of all designs (see designTable).
struct DesignParams {
  std::string kind = "prbs";
  double clock = 15.0;  ///< bits per second [Hz]
  /// Input levels, 0..1, or -1..1 with reversible thrusters; each is limited to the range of its
  /// thruster. Empty means the design's levels: 0 and 1, or 0, 0.25 .. 1; with reversible thrusters
  /// -1 and 1, or -1, -0.5 .. 1.
  std::vector<double> levels;
  int order = 9;           ///< order of the binary sequence: 2^order - 1 bits, 2..20
  unsigned long seed = 1;  ///< sets the start of the sequence in its period
  double hold = 1.0;       ///< duration of a level [s]
  std::string file;        ///< CSV, see readInputFile
  int rows_per_bit = 0;    ///< rows per bit of a file of bits; 0: determined from the file
  ThrusterLayoutPtr thrusters = thrusterPair();  ///< of the craft; never null

  std::string validate() const;  ///< error message; empty if all values are valid
};

/// Description of a design, for documentation and the command line.
struct DesignInfo {
  std::string name, text;
  std::vector<std::string> takes;  ///< members of DesignParams that it uses
};

/// All designs: prbs, multilevel-prbs, differential-prbs, steps, coast-down, spin, single-thruster,
/// multisine, file.
const std::vector<DesignInfo>& designTable();

/// Inputs over time, each held until the next; times ascend from 0.
struct InputSignal {
  std::vector<double> times;                     ///< [s]
  std::vector<Inputs> inputs;                    ///< fractions of the largest input
  double end = 0;                                ///< [s]
  bool has_lift = false;                         ///< whether it includes lift
  bool once = false;                             ///< not repeated, as for a file with times
  std::string description;                       ///< how a file of bits is played; otherwise empty
  ThrusterLayoutPtr thrusters = thrusterPair();  ///< of the craft; never null

  bool ended(double t) const;
  /// Inputs at time t [s]; zero before 0 and from the end on.
  Inputs at(double t) const;
  /// The first instant after t at which inputs change [s]; infinite after the end.
  double nextChange(double t) const;
};

/// A design played for all thrusters of a craft for `duration` [s], repeated as needed; a file with
/// times is not repeated. Throws std::invalid_argument on bad parameters, std::runtime_error if the
/// file cannot be read.
InputSignal makeDesign(const DesignParams& params, double duration);

/// Reads inputs from a CSV file. Rows with the header time and the channels of all thrusters, with
/// or without the lift (for the pair time,left,right or time,left,right,lift), are each
/// held until the next and end with the last time. Bits LEFT,RIGHT (readPrbs), for two thrusters
/// only, are played with `params` for `duration` [s]. Throws std::runtime_error that names file and
/// line.
InputSignal readInputFile(const DesignParams& params, double duration);

/// A binary sequence for a left and a right thruster. Throws std::invalid_argument if parameters are
/// bad.
InputSignal playBits(const PrbsFile& bits, const PrbsParams& params);

}  // namespace ground
