/// Identification of a model from recordings: include this header.
///
///   RunData, Window   A recording and a stretch of it (run_data.h). `cutWindows` cuts a run.
///   SimulationError   Fit of parameters by the error of simulations over windows, with 95%
///                     intervals (simulation_error.h): fast, and all that a fit needs.
///   GreyBox           Stochastic likelihood of recorded poses: parameters beside a random wrench,
///                     and score tests of effects that a model has not (grey_box.h).
///   WrenchFilter      The missing wrench of a model over time, by Kalman smoother
///                     (inferred_wrench.h).
///   predict           Simulation of windows from measured states, uncorrected (prediction.h).
///
/// Example: fit thrust and yaw inertia, then look at what is missing.
///
///     RunData run{"first"};
///     run.times = ...; run.eta = ...; run.nu = ...;        // one row a sample
///     run.inputs.add(0.0, 1.0, 0.5, 1.0);                  // from 0 s: left, right, lift
///     SimulationError problem({run}, cutWindows(run, 0, 0, run.times.back(), 1.5));
///     FitOptions options;
///     options.free = {"k", "I_z"};
///     const FitResult fit = problem.fit(loadModel("craft.yaml"), options);
///     for (const FittedParameter& p : fit.parameters)
///       std::cout << p.name << " " << p.value << " " << p.unit << "\n";
///     WrenchFilter filter(fit.model, run);
///     InferredWrench missing = filter.smooth(filter.likeliestNoise(WrenchNature::kRandomWalk));
///
/// Everything in namespace ground::detail is internal.
#pragma once

#include "ground/identification/grey_box.h"
#include "ground/identification/inferred_wrench.h"
#include "ground/identification/prediction.h"
#include "ground/identification/run_data.h"
#include "ground/identification/simulation_error.h"
