"""The hidden-effect bench in white noise: an effect hidden in the project's own simulated craft."""

import hashlib

import numpy as np
import yaml
from catkin.find_in_workspaces import find_in_workspaces
from ground.analysis import candidates, window_error
from ground.recordings import quality
from ground.simulation import experiments

from ground import _core

# Found through the sourced workspace: on a cluster's workers this file is in another folder.
MODEL = find_in_workspaces(["share"], "ground", "cfg/hovercraft/tiny_whoover.yaml")[0]
RUNS, DURATION = 4, 8.0  # number of runs for a diagnosis, and length of each [s]
SPREAD = 0.2  # largest relative difference of true nominal parameters from the diagnosed model's
NOISE = (3e-4, 5e-3)  # standard deviation of mocap noise [m], [rad]

# Size of each effect's parameters [SI] at which the refitted nominal model's held-out error is
# 1.5 times that of the refitted truth, for excitation "varied".
STRENGTHS = {
    "input_delay": {"delay": 0.005},
    "motor_lag": {"tau": 0.006},
    "thrust_asymmetry": {"a": 0.0066},
    "thrust_curve": {"p": 0.13},
    "thrust_misalignment": {"angle": 0.065},
    "thrust_speed_loss": {"c": 0.052},
    "battery_sag": {"tau": 64.0},
    "quadratic_drag": {"cx": 0.0052, "cy": 0.0052, "cr": 8.3e-7},
    "coulomb_friction": {"f": 0.0028, "n": 1.9e-5},
    "momentum_drag": {"q": 0.017},
    "floor_tilt": {"sx": 0.0033, "sy": 0.0025},
    "wind": {"wx": 0.09, "wy": 0.09},
    "yaw_bias": {"n0": 1e-5},
    "body_force_bias": {"x0": 0.0015, "y0": 0.003},
    "sway_yaw_damping": {"yr": 3.4e-5, "nv": 1.7e-5},
    "added_mass": {"mx": 2.7e-5, "my": 8e-5},
    "com_offset": {"xg": 5.2e-4, "yg": 1.3e-4},
    "marker_offset": {"dx": 0.004, "dy": 0.003},
    "heading_offset": {"psi0": 0.044},
    "thrust_sway_moment": {"c": 3e-4},
    "differential_side_force": {"c": 0.22},
    "directional_yaw_damping": {"na": 6.5e-6},
    "skirt_friction": {"f0": 0.011, "n0": 5.6e-5},
}
ONE_SIDED = {"input_delay", "motor_lag", "battery_sag", "quadratic_drag", "coulomb_friction"}
ONE_SIDED |= {"momentum_drag", "added_mass", "thrust_speed_loss", "skirt_friction"}
# True effects outside the library: formulas, parameters, and the arguments that they depend on.
OUTSIDE = {
    "washboard floor": (
        {"X": "a*sin(2*pi*x/0.3)*cos(psi)", "Y": "-a*sin(2*pi*x/0.3)*sin(psi)"},
        {"a": 0.008},
        {"place"},
    ),
    "spin-surge side force": ({"Y": "a*r*u"}, {"a": 0.0024}, {"velocity"}),
    "cubic yaw damping": ({"N": "-a*r^3"}, {"a": 2e-7}, {"velocity"}),
    "thruster cross-talk": (
        {"X": "-2*a*u_L*u_R"},
        {"a": 0.012},
        {"command"},
    ),
}
# Cases of two runs that cannot distinguish effects: excitation, the effects and their sizes.
AMBIGUOUS = {
    "delay or lag, slow PRBS": (
        "slow",
        {"input_delay": {"delay": 0.008}, "motor_lag": {"tau": 0.008}},
    ),
    "linear or momentum drag, one lift": ("prbs", {"momentum_drag": {"q": 0.0045}, None: {}}),
    "tilt or force, one heading": (
        "straight",
        {
            "floor_tilt": {"sx": 0.002, "sy": 0.0015},
            "body_force_bias": {"x0": 0.0014, "y0": 0.0007},
        },
    ),
}
LEVELS = {"weak": 0.45, "moderate": 1.0, "strong": 2.5}  # factors on STRENGTHS
LOOK_ALIKES = [
    {"input_delay", "motor_lag"},
    {"thrust_misalignment", "heading_offset"},
    {"thrust_asymmetry", "yaw_bias"},
    {"momentum_drag", "quadratic_drag"},
    {"momentum_drag", "coulomb_friction"},
    {"quadratic_drag", "coulomb_friction"},
]
MAX_REPEATS = 10  # largest number of runs of a proposed experiment


def strengths():
    """STRENGTHS of the effects that are in the library."""
    known = _core.effects()
    return {name: sizes for name, sizes in STRENGTHS.items() if name in known}


def neutral(name):
    """Neutral value of a parameter of the library, given as effect.parameter."""
    effect, _, parameter = name.partition(".")
    listed = _core.effects()[effect]["parameters"]
    return next(p["neutral"] for p in listed if p["name"] == parameter)


# Default number of cases of each kind.
KINDS = {
    "white_single": 20 * len(strengths()),
    "white_null": 200,
    "white_pairs": 50,
    "white_outside": 20 * len(OUTSIDE),
    "white_ambiguous": 20 * len(AMBIGUOUS),
}


def in_turn(seed, *lists):
    """One item of each list, by a seed from 1 on; items of the first list change fastest. Appended is
    the number of the round through all combinations, from 1 on."""
    number, chosen = seed - 1, []
    for items in lists:
        number, at = divmod(number, len(items))
        chosen.append(list(items)[at])
    return chosen + [number + 1]


def make(kind, seed, strength="moderate", noise=1.0, excitation="varied"):
    """A case, a dictionary for a line of JSON; `draw` is the seed of its random numbers."""
    case = {"kind": kind, "seed": seed, "draw": seed, "hidden": [], "allowed": []}
    case.update(strength=strength, factor=LEVELS[strength], noise=noise, excitation=excitation)
    if kind == "white_pairs":
        case["hidden"] = _pair(seed)
    elif kind in ("white_single", "white_outside"):
        effect, case["draw"] = in_turn(seed, strengths() if kind == "white_single" else OUTSIDE)
        case["hidden"] = [effect]
    elif kind == "white_ambiguous":
        case["ambiguous"], case["draw"] = in_turn(seed, AMBIGUOUS)
        rivals = sorted(AMBIGUOUS[case["ambiguous"]][1], key=str)
        case["hidden"] = [name for name in [rivals[case["draw"] % 2]] if name]
    return case


def _pair(seed):
    random = np.random.default_rng(seed)
    while True:
        pair = sorted(random.choice(sorted(strengths()), 2, replace=False).tolist())
        if set(pair) not in LOOK_ALIKES:
            return pair


def recorded(case):
    """The true _core.Model of a case and its runs."""
    if case["kind"] == "white_ambiguous":
        excitation, sizes = AMBIGUOUS[case["ambiguous"]]
        model = truth(case["hidden"], 1.0, case["draw"], sizes)
        return model, runs(model, excitation, case["noise"], case["draw"], count=2)
    model = truth(case["hidden"], case["factor"], case["draw"])
    return model, runs(model, case["excitation"], case["noise"], case["draw"])


def more_runs(case, model, schedule, count):
    """Runs of an experiment that a diagnosis proposes."""
    return [
        run(model, schedule, 0.0, case["noise"], 1000 * case["draw"] + i, "new %d" % i)
        for i in range(min(MAX_REPEATS, count))
    ]


def scaled(effect, name, size, factor):
    """A parameter of an effect at `factor` times its strength."""
    if effect == "battery_sag":
        return size / factor
    return 1 + size * factor if (effect, name) == ("thrust_curve", "p") else size * factor


def truth(effects, factor, seed, strengths=STRENGTHS):
    """The craft's true model; the seed determines nominal parameters and signs of the effects."""
    random = np.random.default_rng(_number(seed, *effects))
    model = _core.load_model(MODEL)
    model.name = "truth"
    for name in window_error.NOMINAL:
        model.set_value(name, model.value(name) * random.uniform(1 - SPREAD, 1 + SPREAD))
    for effect in effects:
        if effect in OUTSIDE:
            model = _outside(effect, factor).add(model)
            continue
        model.add_effect(effect)
        for name, size in strengths[effect].items():
            sign = 1 if effect in ONE_SIDED else random.choice([-1, 1])
            way = sign * random.uniform(0.7, 1.3) * factor
            model.set_value("%s.%s" % (effect, name), scaled(effect, name, size, way))
    return model


def _outside(name, factor):
    formulas, sizes, _ = OUTSIDE[name]
    entry = {
        "name": "hidden",
        "expression": formulas,
        "parameters": {
            n: {"value": s * factor, "unit": "SI", "neutral": 0.0, "lower": -1e3, "upper": 1e3}
            for n, s in sizes.items()
        },
    }
    return candidates.from_entry(yaml.safe_load(yaml.safe_dump(entry)), name)


def _number(*parts):
    return int(hashlib.sha256(repr(parts).encode()).hexdigest()[:8], 16)


def runs(model, excitation, noise, seed, count=RUNS):
    """Simulated runs of a true model: a list of _core.RunData."""
    found = []
    for i in range(count):
        random = np.random.default_rng(_number("run", seed, i))
        heading = 0.7 if excitation == "straight" else random.uniform(-np.pi, np.pi)
        schedule = _schedule(excitation, i, seed)
        found.append(run(model, schedule, heading, noise, _number(seed, i), "run %d" % (i + 1)))
    return found


def run(model, schedule, heading, noise, seed, name):
    """One simulated run of a true model: _core.RunData."""
    mocap = _core.MocapParams()
    mocap.rate = 120.0
    mocap.position_noise, mocap.heading_noise = (noise * n for n in NOISE)
    recording = experiments.simulate(
        model, schedule, name, pose=(0, 0, heading), mocap=mocap, seed=seed % 2**31
    )
    return quality.repaired(recording).data(_core.load_model(MODEL))


def _schedule(excitation, i, seed):
    """Schedule of run i. varied: clocks, levels and lift differ from run to run; prbs: as in the
    recordings of 2019; slow: prbs at a twentieth of the clock; straight: nearly equal thrusters, so that
    the craft hardly turns."""
    length = DURATION - 1.0  # the first second has lift alone
    number = 10 * seed + i
    if excitation == "prbs":
        rows = experiments.rows("prbs", length, clock=10, levels=(0, 1), seed=number)
        return experiments.with_lift(rows, length)
    if excitation == "slow":
        rows = experiments.rows("prbs", length, clock=0.5, levels=(0, 1), seed=number)
        return experiments.with_lift(rows, length)
    if excitation == "straight":
        random = np.random.default_rng(_number("straight", number))
        edges = np.arange(0, length, 0.5)
        level = random.uniform(0.1, 0.6, len(edges))
        right = level + random.uniform(-0.001, 0.001, len(edges))
        return experiments.with_lift(np.column_stack([edges, level, right]), length)
    clock, levels, lift = [
        (5, (0, 1), 1.0),
        (10, (0.2, 0.8), 1.0),
        (15, (0, 1), 0.7),
        (20, (0, 0.6), 0.85),
    ][i]
    rows = experiments.rows("prbs", length, clock=clock, levels=levels, seed=number)
    return experiments.with_lift(rows, length, lift)
