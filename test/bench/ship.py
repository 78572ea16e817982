#!/usr/bin/env python3
"""A tanker from its zigzags: test/bench/ship.py FOLDER [--held 30_05 35_05] [--known 20%] [--out SHIP.yaml].

FOLDER has the free-running tests of the KVLCC2 model of 7 m (SIMMAN 2008), HSVA_CPMC_KVLCC2_Z_*.dat, which do
not belong to this project. Their columns, after four lines: time [s], x, y [m], heading [deg], velocity along
x and y of the tank [m/s], yaw rate [deg/s], roll [deg], rudder [deg], revolutions [1/s], thrust [N], torque
[N m]. A positive rudder turns the ship to negative headings.

The model is cfg/craft/propeller_ship.yaml. Its inertia, added mass, hull, rudder and propeller are of the
literature, and known to a share: so they are fitted to the zigzags that are not held out, which hardly show
some of them. Prints the first overshoots of those that are, as predicted with the recorded rudder from the
first seconds on, and a turning circle with 35 degrees of rudder, in lengths of the ship, beside what is
published of such models (SIMMAN 2008).
"""

import argparse
import glob
import os
import time

import numpy as np
from catkin.find_in_workspaces import find_in_workspaces
from scipy.signal import argrelextrema

import ground
from ground import _core

LENGTH, SPEED = 7.0, 1.179  # [m], [m/s] at which tests begin
RUDDER, REVOLUTIONS = 35.0, 13.0  # of inputs of 1 [deg], [1/s]
WINDOW = 30.0  # [s], which holds a turn
RATE = 15.8  # of the rudder [deg/s]: 2.34 at full scale
CHANNELS = ("propeller", "rudder", "lift")
FREE = ["body_force_bias.y0", "yaw_bias.n0"]  # nothing is known of these
KNOWN = ["I_z", "added_mass", "surge_resistance", "drift_resistance", "hull_lift", "hull_nonlinear"]
KNOWN += ["foil_side_rudder", "propeller_loss"]  # to a share
PUBLISHED = {"advance": (3.0, 3.25), "tactical diameter": (3.1, 3.4)}


def recorded(path):
    """The Recording of a zigzag."""
    rows = np.loadtxt(path, skiprows=4, encoding="latin1")
    times, poses = rows[:, 0], np.column_stack([rows[:, 1:3], np.deg2rad(rows[:, 3])])
    inputs = [rows[:, 9] / REVOLUTIONS, -rows[:, 8] / RUDDER, 0 * times]
    name = os.path.basename(path).split("KVLCC2_Z_")[1][:-4]
    return ground.Recording.from_arrays(times, poses, np.column_stack(inputs), channels=CHANNELS, name=name)


def craft():
    """The ship with all effects of a hull."""
    path = find_in_workspaces(["share"], "ground", "cfg/craft/propeller_ship.yaml")[0]
    model = ground.Model.load(path)
    for effect in ("foil_gain_rudder", "body_force_bias", "yaw_bias"):
        if effect not in model.effects:
            model = model.with_effect(effect)
    return model - "angle_rate_rudder"  # recorded is the angle of the rudder itself


def overshoots(times, heading, count=4):
    """The first extrema of a heading [deg]."""
    at = np.sort(np.concatenate([argrelextrema(heading, f, order=60)[0] for f in (np.greater, np.less)]))
    return np.rad2deg(heading[at[np.abs(heading[at]) > np.deg2rad(2)]])[:count]


def circle(model, side):
    """Advance and tactical diameter of a turning circle, in lengths."""
    ramp = np.arange(0, RUDDER / RATE + 0.1, 0.1)
    rudder = np.minimum(ramp * RATE / RUDDER, 1) * side
    turns = 10.2295 / REVOLUTIONS
    rows = np.column_stack([ramp, np.full(len(ramp), turns), rudder, 0 * ramp])
    times = np.arange(0, 200, 0.1)
    made = _core.simulate(model.core, rows, times, np.zeros(3), np.array([SPEED, 0, 0]))
    x, y, heading = made["eta"].T
    speed = np.hypot(*made["nu"][-1, :2]) / SPEED
    if side * heading[-1] < np.pi:
        return np.nan, np.nan, speed
    at = np.arange(len(times))
    quarter, half = (np.interp(angle, side * heading, at) for angle in (np.pi / 2, np.pi))
    return np.interp(quarter, at, x) / LENGTH, side * np.interp(half, at, y) / LENGTH, speed


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--held", nargs="+", default=["30_05", "35_05"])
    parser.add_argument(
        "--leave", nargs="*", default=["05_01", "10_01", "15_01"], help="runs not used at all"
    )
    parser.add_argument("--known", default="20%", help="to how much the values of the literature are known")
    parser.add_argument("--out")
    options = parser.parse_args()
    runs = {run.name: run for run in map(recorded, sorted(glob.glob(options.folder + "/*_Z_*.dat")))}
    fitted = [run for name, run in runs.items() if name not in options.held + options.leave]
    began = time.time()
    known = {
        "foil_gain_rudder.a": float(options.known.rstrip("%")) / 100
    }  # its value, 0, is a relative change
    known.update({name: options.known for name in KNOWN})
    found = ground.fit(craft(), fitted, window=WINDOW, target="poses", free=FREE, prior=known)
    print("fitted to %s in %.0f s" % (", ".join(run.name for run in fitted), time.time() - began))
    print(*found.table(), sep="\n")
    for name in options.held:
        path = found.predict(runs[name], horizon=np.inf).to_frame()
        a, b = (overshoots(np.array(path.t), np.unwrap(path[column])) for column in ("psi_predicted", "psi"))
        count = min(len(a), len(b))
        print("%s: overshoots predicted %s, measured %s deg" % (name, a[:count].round(1), b[:count].round(1)))
    for side, word in ((1, "starboard"), (-1, "port")):
        advance, diameter, speed = circle(found.model, side)
        text = "35 deg to %s: advance %.2f L (published %g to %g), "
        text += "tactical diameter %.2f L (%g to %g), speed %.2f"
        print(text % (word, advance, *PUBLISHED["advance"], diameter, *PUBLISHED["tactical diameter"], speed))
    if options.out:
        found.save(options.out, force=True)


if __name__ == "__main__":
    main()
