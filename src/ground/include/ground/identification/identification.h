/// Identification of a model from recordings: include this header.
///
///   RunData, Window   A recording and a stretch of it (run_data.h). `cutWindows` cuts a run.
///   SimulationError   Fast fit of parameters by simulation error over windows, with 95% intervals
///                     (simulation_error.h).
///   GreyBox           Stochastic likelihood of recorded poses: fit of parameters together with a
///                     random wrench, score tests of missing effects, and the missing wrench over
///                     time (grey_box.h).
///   predict           Simulation of windows from measured states, without correction
///                     (simulation_error.h).
///
/// Example: fit thrust and yaw inertia, then infer the missing wrench.
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
///     const GreyBox box({run}, fit.model.body);
///     const GreyBoxPoint point = box.fit(box.start(fit.model), {}).point;  // with the likeliest levels
///     const SmoothedWrench missing = box.smooth(point, 0, 25);
///
/// Everything in namespace ground::detail is internal.
#pragma once

#include "ground/identification/grey_box.h"
#include "ground/identification/run_data.h"
#include "ground/identification/simulation_error.h"
