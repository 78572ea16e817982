"""Cases of the MuJoCo bench: crafts that MuJoCo's engine moves, in the peers' Python (mujoco_craft).

A quarter has nothing hidden, a half has one effect of the library, a quarter one that has no name there.
Drives, random wrench and measurement are those of the hidden-effect bench; the wrench turns with the
craft or keeps its direction in the room.
"""

import json
import os
import subprocess

import numpy as np

import hidden_cases as cases
import hidden_craft
import hidden_noise
from ground.checks import quality
from ground.reading.recording import Recording
from ground.simulation import experiments
from ground.support.errors import GroundError
from hidden_effects import in_turn

HERE = os.path.dirname(os.path.abspath(__file__))
STEP = hidden_craft.GRID  # of the engine [s]
# Effects of the library that the engine has, in the order of the cases.
LIBRARY = (
    "input_delay", "floor_tilt", "quadratic_drag", "thrust_misalignment", "com_offset", "yaw_bias",
    "motor_lag", "coulomb_friction", "marker_offset", "wind", "differential_side_force", "momentum_drag",
    "thrust_asymmetry", "skirt_friction", "heading_offset", "body_force_bias", "sway_yaw_damping",
)  # fmt: skip
SINGLE_SIZED = {"coulomb_friction": "n", "skirt_friction": "n0", "quadratic_drag": "cr"}  # 0 in the engine
# Effects without a name in the library: medians of their parameters [SI], and effects of the library that
# describe a part of each.
NAMELESS = {
    "compass": ({"moment": 6e-5, "psi": 0.6}, ()),
    "elastic thread": ({"bow": 0.02, "x": 0.5, "y": -0.4, "stiffness": 0.006, "slack": 0.0}, ()),
    "hanging weight": ({"share": 0.15, "length": 0.12, "damping": 2e-6}, ("added_mass", "com_offset")),
    "ellipsoid drag": ({"density": 5.0, "long": 0.06}, ("quadratic_drag", "added_mass")),
    "grained floor": ({"f": 0.008, "across": 0.002, "n": 0.0}, ("coulomb_friction",)),
    "magnus force": ({"a": 0.005}, ()),
    "slack thread": ({"bow": 0.02, "x": 0.5, "y": -0.4, "stiffness": 0.03, "slack": 0.4}, ()),
    "swinging arm": ({"share": 0.1, "length": 0.04, "stiffness": 4e-4, "damping": 2e-6}, ("com_offset",)),
    "twisted cable": ({"stiffness": 1e-5, "psi": 0.0}, ()),
    "inflow at each thruster": ({"c": 0.15}, ("thrust_speed_loss",)),
}
WITH_STATES = ("hanging weight", "swinging arm")  # their past matters
KINDS = ("mujoco_null", "mujoco_library", "mujoco_nameless", "mujoco_library")
LEVELS = (0.0, 0.003, 0.01)  # of the wrench beside an effect, relative to full thrust
MAX_LEVEL = 0.03  # of the wrench where nothing is hidden


def make(seed):
    """The hidden_cases.Case of a seed, from 1 on, and the frame of its random wrench: body or room."""
    kind, number = in_turn(seed, KINDS)
    if kind == "mujoco_library":  # two of four
        number = 2 * number - (seed % 4 == 2)
    case, random = cases.plain(kind, seed), cases.random_of(kind, seed, "mujoco")
    level = random.choice(LEVELS)
    if kind == "mujoco_null":
        level = 0.0 if number % 4 == 0 else np.exp(random.uniform(np.log(0.001), np.log(MAX_LEVEL)))
    if level:
        cases.push(case, level, level)
    if kind == "mujoco_library":
        name, _ = in_turn(number, LIBRARY)
        cases.hide(case, [name], 1.5, 2.5)
        case.effects[name].update({SINGLE_SIZED[name]: 0.0} if name in SINGLE_SIZED else {})
        if name == "wind":  # the engine's air drags alike in surge and sway
            case.body["X_u"] = case.body["Y_v"] = (case.body["X_u"] + case.body["Y_v"]) / 2
        if name == "sway_yaw_damping":  # a fin
            case.effects[name]["nv"] = case.effects[name]["yr"]
    elif kind == "mujoco_nameless":
        name, _ = in_turn(number, NAMELESS)
        sizes, case.allowed = NAMELESS[name][0], list(NAMELESS[name][1])
        case.effects[name] = {n: float(size * random.uniform(0.8, 1.3)) for n, size in sizes.items()}
    return case, str(random.choice(["body", "room"]))


def record(case, frame, python, folder):
    """Runs to fit to and held out, lists of _core.RunData. The folder gets craft.json and moved.npz with
    the engine's motion; python: the interpreter that has MuJoCo."""
    plans = [cases.schedule(run["drive"]) for run in case.runs]
    randoms = [cases.random_of(case.kind, case.seed, "noise", i) for i in range(len(plans))]
    arrays = {}
    for i, (run, plan, random) in enumerate(zip(case.runs, plans, randoms)):
        began = float(plan.rows[np.argmax(plan.rows[:, 3] > 0), 0])
        count = int(np.ceil((plan.end - began) / STEP)) + 1
        arrays["rows %d" % i], arrays["began %d" % i] = plan.rows, began
        arrays["pose %d" % i] = [0.0, 0.0, run["heading"]]
        arrays["push %d" % i] = hidden_noise.wrench(random, count, STEP, run["push"])
    craft = {"body": case.body, "effects": case.effects, "frame": frame, "runs": len(plans), "step": STEP}
    with open(os.path.join(folder, "craft.json"), "w") as file:
        json.dump(craft, file)
    np.savez(os.path.join(folder, "plans.npz"), **arrays)
    peer(python, "move", folder)
    moved = np.load(os.path.join(folder, "moved.npz"))
    runs = []
    for i, (plan, random) in enumerate(zip(plans, randoms)):
        motion = hidden_craft.Motion(*(moved["%s %d" % (n, i)] for n in ("times", "eta", "nu", "nu_dot")))
        taken, stamps = hidden_noise.frames(random, plan.end, case.mocap)
        eta = hidden_noise.measured(random, motion.poses(np.maximum(taken, motion.times[0])), case.mocap)
        times = experiments.START + stamps, experiments.START + plan.rows[:, 0]
        recording = Recording("run %d" % (i + 1), times[0], eta, times[1], plan.rows[:, 1:], "mujoco")
        run = quality.repaired(recording)
        runs.append((run.data(cases.given_model(case)), run.zero - experiments.START))
    cut = cases.FITTED
    return [run for run, _ in runs[:cut]], [run for run, _ in runs[cut:]], [zero for _, zero in runs]


def peer(python, what, folder):
    """What mujoco_peers.py prints as JSON. Its packages must not be mixed with those of ROS; MuJoCo's log
    goes to the folder."""
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    variables["OPENBLAS_NUM_THREADS"] = "1"
    command = [python, os.path.join(HERE, "mujoco_peers.py"), what, folder]
    ended = subprocess.run(command, env=variables, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if ended.returncode:
        raise GroundError("%s: %s" % (" ".join(command[1:3]), ended.stderr.decode().strip().split("\n")[-1]))
    return json.loads(ended.stdout.decode().strip().split("\n")[-1])
