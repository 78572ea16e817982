"""Effects that benches hide, and their sizes."""

from catkin.find_in_workspaces import find_in_workspaces

from ground import _core

# Found through the sourced workspace: on a cluster's workers this file is in another folder.
MODEL = find_in_workspaces(["share"], "ground", "cfg/hovercraft/tiny_whoover.yaml")[0]

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
# Effects of the library outside STRENGTHS, and their names in hidden_craft.
OF_CRAFT = {
    "motor_rise_fall": "spin_up",
    "motor_rate": "slew",
    "supply_sag": "supply_of_inputs",
    "thrust_droop": "droop_of_inputs",
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
    "thruster cross-talk": ({"X": "-2*a*u_L*u_R"}, {"a": 0.012}, {"command"}),
}
LOOK_ALIKES = [
    {"input_delay", "motor_lag"},
    {"thrust_misalignment", "heading_offset"},
    {"thrust_asymmetry", "yaw_bias"},
    {"momentum_drag", "quadratic_drag"},
    {"momentum_drag", "coulomb_friction"},
    {"quadratic_drag", "coulomb_friction"},
]


def strengths():
    """STRENGTHS of the effects that are in the library."""
    known = _core.effects()
    return {name: sizes for name, sizes in STRENGTHS.items() if name in known}


def neutral(name):
    """Neutral value of a parameter of the library, given as effect.parameter."""
    effect, _, parameter = name.partition(".")
    listed = _core.effects()[effect]["parameters"]
    return next(p["neutral"] for p in listed if p["name"] == parameter)


def in_turn(seed, *lists):
    """One item of each list, by a seed from 1 on; items of the first list change fastest. Appended is
    the number of the round through all combinations, from 1 on."""
    number, chosen = seed - 1, []
    for items in lists:
        number, at = divmod(number, len(items))
        chosen.append(list(items)[at])
    return chosen + [number + 1]


def scaled(effect, name, size, factor):
    """A parameter of an effect at `factor` times its strength."""
    if effect == "battery_sag":
        return size / factor
    return 1 + size * factor if (effect, name) == ("thrust_curve", "p") else size * factor
