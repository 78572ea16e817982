// Where the descents of a fit start.
#pragma once

#include <vector>

#include "free_parameters.h"
#include "initial_states.h"
#include "linearisation.h"

namespace ground::detail {

/// The model's own values, then as many others as make `count`: positive ones up to ten times
/// smaller or larger, the others as far off as they are typically large. Coordinates over scale.
std::vector<std::vector<double>> startsOf(const Free& free, int count);

/// Short windows cut from those of a problem, at most 64, spread over them.
std::vector<Window> shortPieces(const SimulationError& problem);

/// Values nearer to the data than the given ones, where there are any: those that fit short pieces
/// of the windows. Over a short time a simulation depends little on what came before, and the cost
/// has hardly any minimum but one. Throws std::runtime_error when the given ones cannot be
/// simulated.
std::vector<double> approach(Linearisation& windows, Linearisation& pieces, const Free& free,
                             const FitOptions& options, const std::vector<double>& from);

/// Initial states to start from at the given values: those of the options; else measured ones, or,
/// where these values are near, those that suit them best, for a model may turn and shift what is
/// measured by any amount.
Initials initialsAt(const std::vector<double>& scaled, const SimulationError& problem,
                    const Model& model, const Free& free, const FitOptions& options);

}  // namespace ground::detail
