// Starts of the descents of a fit.
#pragma once

#include <vector>

#include "free_parameters.h"
#include "initial_states.h"
#include "linearisation.h"

namespace ground::detail {

/// `count` starts, in coordinates over scale: the model's values, then random ones. Non-negative
/// parameters are scaled by a factor of 0.1 to 10; others are shifted by up to their scale.
std::vector<std::vector<double>> startsOf(const Free& free, int count);

/// At most 64 short windows, cut from those of a problem and spread evenly over them.
std::vector<Window> shortPieces(const SimulationError& problem);

/// A better start: values fitted to short pieces of the windows, or `from` if these do not lower
/// the cost. Over a short time a simulation depends little on its past, so the cost rarely has more
/// than one minimum. Throws std::runtime_error if the model cannot be simulated at `from`.
std::vector<double> approach(Linearisation& windows, Linearisation& pieces, const Free& free,
                             const FitOptions& options, const std::vector<double>& from);

/// Initial states at the start of a descent: those of the options if given. Otherwise fitted ones
/// with FitOptions::near, because effects may rotate and shift the measurement by any amount, and
/// measured ones without.
Initials initialsAt(const std::vector<double>& scaled, const SimulationError& problem, const Model& model,
                    const Free& free, const FitOptions& options);

}  // namespace ground::detail
