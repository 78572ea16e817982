#!/usr/bin/python3
"""How much the craft's own gyro and accelerometer improve tracking: ModelPredictive on a rhodonea, seen by a
slow and noisy mocap and pushed at random, with them and without; the ratio of the distances from the
reference (rms)."""

import argparse
import sys

import numpy as np

from ground import _core
from ground.simulation import gains, tracking
from ground.support import workers

MODEL = "cfg/hovercraft/tiny_whoover_4_1.yaml"
RATE, LATENCY = 30.0, 0.03  # of the mocap [Hz], [s]
NOISE = 1e-3, 1e-2  # of a pose [m], [rad]
IMU_RATE = 100.0  # [Hz]
SAMPLES = 2000  # random resamplings of the median


def push(model, level, time):
    """The _core.Disturbance of a level relative to full thrust, and a correlation time [s]."""
    force, moment = 2 * model.value("k"), model.value("k") * model.value("l")
    disturbance = _core.Disturbance()
    disturbance.sigma = level * np.array([force, force, moment])
    disturbance.time = np.full(3, time)
    return disturbance


def distance(model, disturbance, values, seed, imu_rate):
    """Rms distance from the reference [m] of one run."""
    params, mocap = _core.TrackingParams(), _core.MocapParams()
    task = tracking.task("rhodonea")
    params.reference, params.controller = task.reference, gains.choice("ModelPredictive", values)
    params.estimator.position_noise, params.estimator.heading_noise = NOISE
    params.start, params.life.lift_time, params.tail = 0.0, 0.5, 0.0
    params.duration, params.max_error = task.until, np.inf
    mocap.rate, mocap.latency = RATE, LATENCY
    mocap.position_noise, mocap.heading_noise = NOISE
    log = _core.track_reference(
        model, model, params, np.zeros(3), np.zeros(3), mocap, seed, disturbance, imu_rate=imu_rate
    )
    if log["stopped"]:
        raise SystemExit("seed %d: %s" % (seed, log["stopped"]))
    times = log["truth"][:, 0] - log["references"][0, 0]
    counted = times >= task.settled
    away = log["truth"][counted, 1:3] - task.reference.sample(times[counted])[:, :2]
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--push", type=float, default=0.02, help="level of the push relative to full thrust")
    parser.add_argument("--time", type=float, default=0.5, help="correlation time of the push [s]")
    parser.add_argument("--gains", nargs="*", default=[], metavar="NAME=VALUE", help="of ModelPredictive")
    options = parser.parse_args()
    pairs = (one.split("=") for one in options.gains)
    values = {name: float(value) for name, value in pairs}
    model = _core.load_model(MODEL)
    pushed = push(model, options.push, options.time)
    jobs = [(seed, imu) for seed in range(1, options.seeds + 1) for imu in (0.0, IMU_RATE)]
    found = workers.Workers().map(lambda job: distance(model, pushed, values, *job), jobs)
    without, fused = np.reshape(list(found), (-1, 2)).T
    ratios = fused / without
    drawn = np.random.default_rng(1).choice(ratios, (SAMPLES, len(ratios)))
    low, high = np.quantile(np.median(drawn, axis=1), (0.025, 0.975))
    print("rms without: median %.2f mm, with: %.2f mm" % tuple(1e3 * np.median((without, fused), axis=1)))
    print(
        "ratio: median %.3f (95%%: %.3f to %.3f), from %.3f to %.3f"
        % (np.median(ratios), low, high, ratios.min(), ratios.max())
    )


if __name__ == "__main__":
    sys.exit(main())
