"""Recordings read with a mistake (units, axes, signs, clocks, swaps), and honest ones, for tests."""

import collections
import math
import pathlib
import re
import sys

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
    '  orientation: [qx, qy, qz, qw]\n  axes: "%s"\n', "  heading: {field: psi}\n"
)
INCH = 0.0254


class Recorded:
    """A simulated run as its files have it; what is done to it is a mistake.

    duration: [s]; rate: of the mocap [Hz], None: any; levels: least and most command, None: any; effects:
    values of parameters of effects; push: standard deviation of a random force, relative to full thrust;
    dead: number of a thruster that does nothing.
    """

    def __init__(self, seed, duration=20.0, rate=None, levels=None, effects=None, push=0.0, dead=None):
        random = np.random.default_rng(seed)
        model = _core.load_model(str(MODELS / "tiny_whoover.yaml"))
        for name in ("X_u", "Y_v", "N_r", "I_z", "k"):
            model.set_value(name, model.value(name) * random.uniform(0.7, 1.4))
        clock = random.choice([5.0, 10.0, 15.0])
        edges = np.arange(int(duration * clock)) / clock
        bits = np.array(_core.make_prbs(9, int(random.integers(1, 500))), float)
        low, high = random.uniform(0, 0.3), random.uniform(0.6, 1.0)
        low, high = levels or (low, high)
        thrust = low + (high - low) * np.resize(np.roll(bits, seed), (len(edges), 2))
        inputs = np.column_stack([edges, thrust, np.ones(len(edges))])
        times = np.arange(0, duration, 1 / (rate or random.choice([50.0, 100.0, 120.0])))
        late = inputs + [random.uniform(0.0, 0.06), 0, 0, 0]
        late[0, 0] = 0
        if dead is not None:
            late[:, 1 + dead] = 0
        for name, value in (effects or {}).items():
            if name.split(".")[0] not in model.effects:
                model.add_effect(name.split(".")[0])
            model.set_value(name, value)
        wrench = _pushes(random, times, push * 2 * model.value("k") * np.array([1, 1, model.value("l")]))
        start = [0, 0, random.uniform(-3, 3)]
        run = _core.simulate(model, late, times, np.array(start), np.zeros(3), [0.0], wrench)
        noise = random.uniform(0.5, 2) * np.array([3e-4, 3e-4, 4e-3])
        self.times, self.eta = 1000 + times, run["eta"] + random.normal(0, noise, (len(times), 3))
        self.commands = np.column_stack([1000 + inputs[:, 0], inputs[:, 1:]])
        self.random, self.noise, self.mapping, self.axes = random, noise, MAPPING, OPTITRACK
        self.scale, self.offset, self.planar_scale = 1.0, 0.0, np.ones(3)
        self.read_as, self.left_handed, self.turns = OPTITRACK, False, False

    def planar(self):
        """Its tables have x, y, psi in place of a quaternion."""
        self.mapping = PLANAR

    def write(self, folder):
        folder.mkdir()
        rows = []
        for time, eta in zip(self.times, self.eta):
            p, q = in_mocap(eta + [0, 0, self.offset], self.axes)
            if self.left_handed:  # the third axis points the other way
                p, q = p * [1, 1, -1], q * [-1, -1, 1, 1]
            psi = math.remainder(eta[2] + self.offset, 2 * math.pi)
            psi = psi % (2 * math.pi) if self.turns else psi
            planar = self.planar_scale * [eta[0], eta[1], psi]
            rows.append((time, *(self.scale * np.asarray(p)), *q, *planar))
        columns = ["t", "px", "py", "pz", "qx", "qy", "qz", "qw", "x", "y", "psi"]
        write_csv(folder / "poses.csv", columns, rows)
        write_csv(folder / "commands.csv", ["t", "left", "right", "lift"], self.commands.tolist())
        mapping = folder / "mapping.yaml"
        text = self.mapping % self.read_as if "%s" in self.mapping else self.mapping
        mapping.write_text(text)
        return folder, mapping


def _pushes(random, times, sigma, correlation=0.1):
    """A random wrench (n, 3) of some standard deviations, an Ornstein-Uhlenbeck process."""
    wrench = np.zeros((len(times), 3))
    decay = np.exp(-np.diff(times) / correlation)
    for i, a in enumerate(decay, 1):
        wrench[i] = a * wrench[i - 1] + math.sqrt(1 - a * a) * random.normal(0, sigma)
    return wrench


def length(scale):
    def change(run):
        run.scale = scale

    return change


def degrees(run):
    run.planar()
    run.planar_scale = np.array([1, 1, 180 / math.pi])


def degrees_of_a_turn(run):
    degrees(run)
    run.turns = True


def mirrored(run):
    run.planar()
    run.planar_scale = np.array([1, -1, 1])


def wrong_yaw(run):
    run.planar()
    run.planar_scale = np.array([1, 1, -1])


def left_handed(run):
    run.left_handed = True


def commands(factor, shift=0.0):
    def change(run):
        run.commands[:, 1:] = shift + factor * run.commands[:, 1:]

    return change


def z_up(run):
    run.axes = Z_UP


def y_up(run):
    run.read_as = Z_UP


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


def clock(shift, drift=0.0):
    def change(run):
        run.times = run.times + shift + drift * (run.times - run.times[0])

    return change


def late_commands(run):
    run.commands[:, 0] += 0.6


def idle(at_start):
    """As long a rest before or after the run, without thrust."""

    def change(run):
        length, rate = np.ptp(run.times), len(run.times) / np.ptp(run.times)
        rest = np.arange(0, length, 1 / rate)
        poses = run.eta[0 if at_start else -1] + run.random.normal(0, run.noise, (len(rest), 3))
        zeros = np.zeros(4)
        if at_start:
            run.times = np.concatenate([run.times[0] + rest, run.times + rest[-1] + 1 / rate])
            run.eta = np.concatenate([poses, run.eta])
            zeros[0], zeros[3] = run.commands[0, 0], 1
            run.commands[:, 0] += rest[-1] + 1 / rate
            run.commands = np.concatenate([[zeros], run.commands])
        else:
            run.times = np.concatenate([run.times, run.times[-1] + rest + 1 / rate])
            run.eta = np.concatenate([run.eta, poses])
            zeros[0], zeros[3] = run.times[len(run.times) // 2], 1
            run.commands = np.concatenate([run.commands, [zeros], [zeros + [length, 0, 0, 0]]])

    return change


def without_lift(run):
    run.mapping = MAPPING.replace(", lift: {field: lift}", "")


def nothing(run):
    """No mistake."""


Case = collections.namedtuple("Case", "name change wanted options")


def case(name, change, wanted=None, **options):
    return Case(name, change, wanted, options)


SWAPPED = r"left and right seem to be swapped"
# name, what is done, what info has to say, and what the run is like
MISTAKES = [
    case("millimetres", length(1e3), r"unit: mm"),
    case("centimetres", length(1e2), r"unit: cm"),
    case("degrees", degrees, r"unit: deg"),
    case("percent", commands(100), r"looks like percent; name their unit"),
    case("microseconds", commands(1000, 1000), r"looks like microseconds; name their unit"),
    case("axes", z_up, r'--axes "x, -y, -z" fits 100%'),
    case("swapped", swapped, SWAPPED + ".*swap the names left and right"),
    case("inverted", inverted(1, 2), r"both thrusters seem to be inverted.*off and full of both"),
    case("left inverted", inverted(1), r"left seems to be inverted.*off and full of left"),
    case("right inverted", inverted(2), r"right seems to be inverted.*off and full of right"),
    case("half a turn", turned(math.pi), r"--heading-offset -?3\.[01]\d"),
    case("quarter turn", turned(math.pi / 2), r"--heading-offset 1\.[56]\d"),
    case("yaw", wrong_yaw, r"heading: \{sign: -1\}"),
    case("mirror", mirrored, r"positions seem to be mirrored.*a minus before one"),
    case("late clock", clock(1.7), r"clock_offset: -1\.[67]"),
    case("early clock", clock(-0.25), r"clock_offset: 0\.[12]"),
]
# Kinds that the thresholds were not chosen with.
OTHERS = [
    case("inches", length(1 / INCH), r"unit: in"),
    case("cm, slow craft", length(1e2), r"unit: cm", levels=(0.1, 0.3)),
    case("degrees 0..360", degrees_of_a_turn, r"unit: deg"),
    case("y up", y_up, r'--axes "x, z, -y" fits 100%'),
    case("left-handed", left_handed, r'vertical axis is upside down.*--axes "x, -z, y"'),
    case("drift 1%", clock(0, 0.01), r"clock_drift: -0\.0(1[012]|0[89])"),
    case("drift 0.5%, 40 s", clock(0, -0.005), r"clock_drift: 0\.00[456]", duration=40.0),
    case("0.3 s late", clock(0.3), r"clock_offset: -0\.3"),
    case("late commands", late_commands, r"clock_offset: 0\.[56]"),
    case("-1..1", commands(2, -1), r"off: -1, full: 1"),
    case("newtons", commands(0.062), r"in newtons"),
    case("left dead", nothing, r"left seems to do nothing.*motor of left", dead=0),
    case("right dead", nothing, r"right seems to do nothing.*motor of right", dead=1),
    case("100 degrees", turned(1.75), r"--heading-offset 1\.[678]"),
    case("40 degrees", turned(-0.7), r"--heading-offset -0\.[67]"),
    case("idle start", idle(True), r"the first (19|20)\.\d+ s are left out"),
    case("idle end", idle(False), r"the last (19|20)\.\d+ s are left out"),
    case("swapped, pushes", swapped, SWAPPED, push=0.1),
    case("swapped, 8 s", swapped, SWAPPED, duration=8.0),
    case("left inverted, asymmetry", inverted(1), r"left seems to be inverted",
         effects={"thrust_asymmetry.a": 0.15}),
    case("drift 3%", clock(0, 0.03), r"clock_drift: -0\.0(2[789]|3[01])"),
    case("drift -4%, 40 s", clock(0, -0.04), r"clock_drift: 0\.0(39|4[0123])", duration=40.0),
]  # fmt: skip
HONEST = [
    case("honest", nothing),
    case("drafts", nothing, effects={"wind.wx": 0.3, "wind.wy": -0.2}),
    case("pushes 10%", nothing, push=0.1),
    case("cross-flow", nothing, effects={"sway_yaw_damping.nv": 2e-4, "thrust_sway_moment.c": 0.02}),
    case("tilted floor", nothing, effects={"floor_tilt.sx": 0.02, "floor_tilt.sy": -0.015}),
    case("slow craft", nothing, levels=(0.1, 0.25)),
    case("8 s", nothing, duration=8.0),
    case("8 s, pushes", nothing, duration=8.0, push=0.1),
    case("50 Hz", nothing, rate=50.0),
    case("asymmetry 10%", nothing, effects={"thrust_asymmetry.a": 0.1}),
    case("asymmetry 30%", nothing, effects={"thrust_asymmetry.a": -0.3}),
    case("misalignment", nothing, effects={"thrust_misalignment.angle": 0.27}),
    case("yaw moment", nothing, effects={"yaw_bias.n0": 4e-4}),
    case("motor lag", nothing, effects={"motor_lag.tau": 0.15}),
    case("delay", nothing, effects={"input_delay.delay": 0.06}),
    case("lift left out", without_lift),
    case("drift 100 ppm", clock(0, 1e-4)),
    case("quadratic drag", nothing, effects={"quadratic_drag.cx": 0.03, "quadratic_drag.cy": 0.06}),
    case("marker offset", nothing, effects={"marker_offset.dx": 0.02, "marker_offset.dy": -0.01}),
    case("side force", nothing, effects={"differential_side_force.c": 0.4}),
]
SUSPECTS = re.compile(r"seem|if so:|do not fit|looks like")


def info(run, folder):
    """All that info says of a Recorded, without the line breaks in its first lines."""
    path, mapping = run.write(folder)
    result = identify("info", path, "--mapping", mapping)
    return re.sub(r"\n {8,}", " ", result.stdout + result.stderr)


def mistaken(number, folder, table=MISTAKES, base=0):
    """Name of the mistake of a case, whether it is named with its remedy, and what is said."""
    chosen = table[number % len(table)]
    run = Recorded(base + number, **chosen.options)
    chosen.change(run)
    said = info(run, folder)
    return chosen.name, bool(re.search(chosen.wanted, said)), said


def honest(number, folder, table=HONEST, base=0):
    """Name of an honest case, suspicions about it, and what is said."""
    chosen = table[number % len(table)]
    run = Recorded(base + 1000 + number, **chosen.options)
    chosen.change(run)
    if number % 3 == 0 and run.mapping == MAPPING:
        run.planar()
    elif number % 3 == 1:
        run.axes = run.read_as = Z_UP
    said = info(run, folder)
    return chosen.name, [line for line in said.splitlines() if SUSPECTS.search(line)], said
