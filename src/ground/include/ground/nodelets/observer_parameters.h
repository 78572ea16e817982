#pragma once

#include "ground/estimation/disturbance_observer.h"

namespace ground {

/// The observer's part of a dynamic_reconfigure class with the fields of
/// cfg/observer_parameters.py.
template <class Config>
ObserverParams observerParams(const Config& c) {
  ObserverParams p;
  p.position_noise = c.position_noise;
  p.heading_noise = c.heading_noise;
  p.push = c.push;
  p.twist = c.twist;
  p.push_drift = c.push_drift;
  p.twist_drift = c.twist_drift;
  return p;
}

}  // namespace ground
