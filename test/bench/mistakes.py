#!/usr/bin/python3
"""Recordings read with a mistake (units, axes, signs, clocks, swaps), and honest ones: how many mistakes
identify info names with the remedy, and how many it sees where there are none.

mistakes.py [--count 30] [--honest 10] [--only NAME ...]
"""

import argparse
import math
import pathlib
import re
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "python"))
from conftest import identify
from containers import OPTITRACK, Z_UP, in_mocap, write_csv

from ground import _core

MODELS = pathlib.Path(__file__).resolve().parents[2] / "cfg" / "hovercraft"
MAPPING = """
schema: ground/mapping/1
poses:
  file: poses.csv
  position: {fields: [px, py, pz]}
  orientation: [qx, qy, qz, qw]
  axes: "%s"
  time: {field: t}
commands:
  file: commands.csv
  time: {field: t}
  channels: {left: {field: left}, right: {field: right}, lift: {field: lift}}
"""
PLANAR = MAPPING.replace("px, py, pz", "x, y").replace(
    "  orientation: [qx, qy, qz, qw]\n  axes: \"%s\"\n", "  heading: {field: psi}\n"
)


class Recorded:
    """A simulated run as its files have it; what is done to it is a mistake."""

    def __init__(self, seed, duration=20.0):
        random = np.random.default_rng(seed)
        model = _core.load_model(str(MODELS / "tiny_whoover.yaml"))
        for name in ("X_u", "Y_v", "N_r", "I_z", "k"):
            model.set_value(name, model.value(name) * random.uniform(0.7, 1.4))
        clock = random.choice([5.0, 10.0, 15.0])
        edges = np.arange(int(duration * clock)) / clock
        bits = np.array(_core.make_prbs(9, int(random.integers(1, 500))), float)
        low, high = random.uniform(0, 0.3), random.uniform(0.6, 1.0)
        levels = low + (high - low) * np.resize(np.roll(bits, seed), (len(edges), 2))
        inputs = np.column_stack([edges, levels, np.ones(len(edges))])
        times = np.arange(0, duration, 1 / random.choice([50.0, 100.0, 120.0]))
        lag = random.uniform(0.0, 0.06)
        late = inputs + [lag, 0, 0, 0]
        late[0, 0] = 0
        start = [0, 0, random.uniform(-3, 3)]
        run = _core.simulate(model, late, times, np.array(start), np.zeros(3))
        noise = random.uniform(0.5, 2) * np.array([3e-4, 3e-4, 4e-3])
        self.times, self.eta = 1000 + times, run["eta"] + random.normal(0, noise, (len(times), 3))
        self.commands = np.column_stack([1000 + inputs[:, 0], inputs[:, 1:]])
        self.random, self.mapping, self.axes = random, MAPPING, OPTITRACK
        self.scale, self.offset, self.planar_scale = 1.0, 0.0, np.ones(3)
        self.read_as = OPTITRACK

    def planar(self):
        """Its tables have x, y, psi in place of a quaternion."""
        self.mapping = PLANAR

    def write(self, folder):
        folder.mkdir()
        rows = []
        for time, eta in zip(self.times, self.eta):
            p, q = in_mocap(eta + [0, 0, self.offset], self.axes)
            psi = math.remainder(eta[2] + self.offset, 2 * math.pi)
            planar = self.planar_scale * [eta[0], eta[1], psi]
            rows.append((time, *(self.scale * np.asarray(p)), *q, *planar))
        columns = ["t", "px", "py", "pz", "qx", "qy", "qz", "qw", "x", "y", "psi"]
        write_csv(folder / "poses.csv", columns, rows)
        write_csv(folder / "commands.csv", ["t", "left", "right", "lift"], self.commands.tolist())
        mapping = folder / "mapping.yaml"
        text = self.mapping % self.read_as if "%s" in self.mapping else self.mapping
        mapping.write_text(text)
        return folder, mapping


def length(scale):
    def change(run):
        run.scale = scale

    return change


def degrees(run):
    run.planar()
    run.planar_scale = np.array([1, 1, 180 / math.pi])


def mirrored(run):
    run.planar()
    run.planar_scale = np.array([1, -1, 1])


def wrong_yaw(run):
    run.planar()
    run.planar_scale = np.array([1, 1, -1])


def commands(factor, shift=0.0):
    def change(run):
        run.commands[:, 1:] = shift + factor * run.commands[:, 1:]

    return change


def z_up(run):
    run.axes = Z_UP


def swapped(run):
    run.commands[:, [1, 2]] = run.commands[:, [2, 1]]


def inverted(*columns):
    def change(run):
        for column in columns:
            run.commands[:, column] = 1 - run.commands[:, column]

    return change


def turned(angle):
    def change(run):
        run.offset = angle

    return change


def clock(shift):
    def change(run):
        run.times = run.times + shift

    return change


# name, what is done, and what info has to say
MISTAKES = [
    ("millimetres", length(1e3), r"unit: mm"),
    ("centimetres", length(1e2), r"unit: cm"),
    ("degrees", degrees, r"unit: deg"),
    ("percent", commands(100), r"in percent: give their channels a unit"),
    ("microseconds", commands(1000, 1000), r"in microseconds: give their channels a unit"),
    ("axes", z_up, r'--axes "x, -y, -z" fits 100%'),
    ("swapped", swapped, r"left and right seem to be swapped"),
    ("inverted", inverted(1, 2), r"both thrusters seem to be inverted"),
    ("left inverted", inverted(1), r"left seems to be inverted"),
    ("right inverted", inverted(2), r"right seems to be inverted"),
    ("half a turn", turned(math.pi), r"--heading-offset -?3\.14"),
    ("quarter turn", turned(math.pi / 2), r"--heading-offset 1\.57"),
    ("yaw", wrong_yaw, r"heading: \{sign: -1\}"),
    ("mirror", mirrored, r"positions seem to be mirrored"),
    ("late clock", clock(1.7), r"clock_offset: -1\.[67]"),
    ("early clock", clock(-0.25), r"clock_offset: 0\.[12]"),
]
SUSPECTS = re.compile(r"seem|if so:|do not fit|in percent|in microseconds")


def info(run, folder):
    """All that info says of a Recorded."""
    path, mapping = run.write(folder)
    result = identify("info", path, "--mapping", mapping)
    return result.stdout + result.stderr


def mistaken(number, folder, table=MISTAKES):
    """Name of the mistake of a case, whether it is named with its remedy, and what is said."""
    name, change, wanted = table[number % len(table)]
    run = Recorded(number)
    change(run)
    said = info(run, folder)
    return name, bool(re.search(wanted, said)), said


def honest(number, folder):
    """Suspicions about a run without a mistake."""
    run = Recorded(1000 + number)
    if number % 3 == 0:
        run.planar()
    elif number % 3 == 1:
        run.axes = run.read_as = Z_UP
    said = info(run, folder)
    return [line for line in said.splitlines() if SUSPECTS.search(line)], said


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=30, help="mistakes")
    parser.add_argument("--honest", type=int, default=10, help="runs without one")
    parser.add_argument("--only", nargs="+", help="names of mistakes")
    arguments = parser.parse_args()
    table = [m for m in MISTAKES if not arguments.only or m[0] in arguments.only]
    named = false = 0
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        for number in range(arguments.count):
            name, found, said = mistaken(number, folder / ("mistake%d" % number), table)
            named += found
            print("%-15s %s" % (name, "named" if found else "MISSED"))
            if not found:
                print("    " + said.replace("\n", "\n    "))
        for number in range(arguments.honest):
            lines, said = honest(number, folder / ("honest%d" % number))
            false += bool(lines)
            print("%-15s %s" % ("honest", "FALSE ALARM" if lines else "quiet"))
            if lines:
                print("    " + "\n    ".join(lines))
    print(
        "%d of %d mistakes named with the remedy, %d of %d honest runs suspected"
        % (named, arguments.count, false, arguments.honest)
    )
    return 0 if named >= 0.9 * arguments.count and not false else 1


if __name__ == "__main__":
    sys.exit(main())
