"""A hovercraft that MuJoCo's engine moves, for the MuJoCo bench; runs in the peers' Python.

The engine's frame is world_ned (z down, gravity along +z), so that nothing has to be converted: x, y, psi
are joints, and actuators at sites push along body axes. Drag of the body is MuJoCo's velocity servo.
Sizes of effects of the library are its parameters; those in NAMELESS have no name there.
"""

import math

import mujoco
import numpy as np

GRAVITY = 9.81  # [m/s^2]
WEIGHT = 0.1  # share of the craft's weight on the floor where the friction does not depend on the lift
PAYLOAD = 0.1  # share of the mass in a payload
TIP = 0.004  # radius of a foot [m]
DROP, THIN = 1e-4, 1e-3  # radius of a drop [m], density of the air around it [kg/m^3]
FAR = 1e3  # distance of a pole [m]
FLAT = 0.505  # moment of inertia about x and y, relative to that about z
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class Craft:
    """body: m, l, I_z, X_u, Y_v, N_r, k; effects: {name: {parameter: value}}, SI units."""

    def __init__(self, body, effects, step):
        self.model = mujoco.MjModel.from_xml_string(xml(body, effects, step))
        self.marker = marker(effects)
        names = [self.model.actuator(i).name for i in range(self.model.nu)]
        self.lifted = [i for i, name in enumerate(names) if name.startswith("lift")]

    def controls(self, rows):
        """The actuators' controls, given rows (n, 3) of left, right, lift. The first two actuators are
        the thrusters."""
        controls = np.zeros((len(rows), self.model.nu))
        controls[:, :2] = rows[:, :2]
        controls[:, self.lifted] = rows[:, 2:]
        return controls

    def begin(self, pose):
        """The engine's data of the craft at rest at a pose."""
        data = mujoco.MjData(self.model)
        data.qpos[:3] = pose
        return data

    def restore(self, state):
        """The engine's data in a full state."""
        data = mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, data, state, STATE)
        return data

    def run(self, data, rows, body=None, room=None):
        """Joint positions and velocities (n + 1, 3), and full states (n + 1, m), from data on. Each step has
        a row of inputs, and of wrenches fixed in the body and in the room [N, N, N m]."""
        model, count = self.model, len(rows)
        controls = self.controls(rows)
        at, rates = np.empty((count + 1, 3)), np.empty((count + 1, 3))
        states = np.empty((count + 1, mujoco.mj_stateSize(model, STATE)))
        push = np.zeros((count, 3)) if room is None else room
        for i in range(count + 1):
            at[i], rates[i] = data.qpos[:3], data.qvel[:3]
            mujoco.mj_getState(model, data, states[i], STATE)
            if i == count:
                break
            data.ctrl[:] = controls[i]
            X, Y, N = push[i]
            if body is not None:
                c, s = math.cos(at[i, 2]), math.sin(at[i, 2])
                along, across, turn = body[i]
                X, Y, N = X + c * along - s * across, Y + s * along + c * across, N + turn
            data.xfrc_applied[1] = X, Y, 0.0, 0.0, 0.0, N
            mujoco.mj_step(model, data)
        return at, rates, states

    def shift(self, data, change):
        """Changes the velocities by u, v, r in the marker's frame."""
        turn = data.qpos[2] + self.marker[2]
        c, s = math.cos(turn), math.sin(turn)
        u, v, r = change
        data.qvel[:3] += c * u - s * v, s * u + c * v, r


def seen(mount, at, rates):
    """Poses and velocities (u, v, r) of a marker, given its mount and joint positions and velocities."""
    dx, dy, turn = mount
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    ox, oy, r = c * dx - s * dy, s * dx + c * dy, rates[:, 2]
    eta = at[:, :3] + np.column_stack([ox, oy, np.full(len(at), turn)])
    vx, vy = rates[:, 0] - r * oy, rates[:, 1] + r * ox
    c, s = np.cos(eta[:, 2]), np.sin(eta[:, 2])
    return eta, np.column_stack([c * vx + s * vy, c * vy - s * vx, r])


def marker(effects):
    """Mount of the marker in the craft: dx, dy [m], psi0 [rad]."""
    offset = effects.get("marker_offset", {"dx": 0.0, "dy": 0.0})
    return offset["dx"], offset["dy"], effects.get("heading_offset", {"psi0": 0.0})["psi0"]


def held(rows, edges):
    """Means (n, 3) of commands between n + 1 edges [s]; rows: time, left, right, lift."""
    integral = np.vstack([np.zeros(3), np.cumsum(rows[:-1, 1:] * np.diff(rows[:, 0])[:, None], axis=0)])
    at = np.clip(np.searchsorted(rows[:, 0], edges, side="right") - 1, 0, len(rows) - 1)
    total = integral[at] + rows[at, 1:] * np.maximum(0.0, edges - rows[at, 0])[:, None]
    return np.diff(total, axis=0) / np.diff(edges)[:, None]


# --- The engine's model


def xml(body, effects, step):
    """The engine's model of a craft."""
    parts = _Parts(body, step)
    for name, parameters in effects.items():
        if name in ADD:
            ADD[name](parts, parameters)
    return parts.xml()


class _Parts:
    """Parts of a model. Effects change them and add to them."""

    def __init__(self, body, step):
        self.body, self.step, self.m, self.I_z = body, step, body["m"], body["I_z"]  # without payloads
        self.gravity, self.options, self.compensated = [0.0, 0.0, GRAVITY], {}, 0.0
        self.gain, self.angle = [body["k"]] * 2, [0.0, 0.0]  # of the left and the right thruster
        self.thruster, self.loss = "", 0.0
        self.drag = [body["X_u"], body["Y_v"], body["N_r"]]
        self.fin, self.turning = 0.0, ""
        self.craft, self.world, self.actuators, self.tendons, self.pairs = [], [], [], [], []

    def push(self, name, site, axis, gain=(0, 0, 0), bias=(0, 0, 0), more=""):
        """An actuator that acts along one of the six axes of a site."""
        gear = ["1" if i == axis else "0" for i in range(6)]
        self.actuators.append(
            '<general name="%s" site="%s" gear="%s" gaintype="affine" gainprm="%s" biastype="affine" '
            'biasprm="%s" %s/>' % (name, site, " ".join(gear), _text(gain), _text(bias), more)
        )

    def foot(self, along, across):
        """A foot on the floor in the craft's middle, with coefficients of friction along x and y."""
        floor = '<geom name="floor" type="plane" size="9 9 1" zaxis="0 0 -1"/>'
        heave = '<joint type="slide" axis="0 0 1" damping="0.5"/>'
        foot = '<geom name="foot" size="%g" pos="0 0 %g" mass="0"/>' % (TIP, -TIP)
        self.world.append(floor)
        self.craft += [heave, foot]
        self.pairs.append(
            '<pair geom1="floor" geom2="foot" condim="3" solref="%g 1" solimp="0.99 0.999 0.0001" '
            'friction="%.9g %.9g 0 0 0"/>' % (max(4e-3, 2 * self.step), along, across)
        )

    def payload(self, share, at, joints):
        """A part of the mass in a body of its own, held by joints at the craft's middle."""
        mass = share * self.body["m"]
        self.m -= mass
        inertia = '<inertial pos="%s" mass="%.9g" diaginertia="1e-9 1e-9 1e-9"/>' % (_text(at), mass)
        self.craft.append("<body>%s%s</body>" % (inertia, joints))

    def tendon(self, name, near, far, attributes):
        """A tendon from a place in the craft to one in the room."""
        self.craft.append('<site name="%s near" pos="%s"/>' % (name, _text(near)))
        self.world.append('<site name="%s far" pos="%s"/>' % (name, _text(far)))
        sites = '<site site="%s near"/><site site="%s far"/>' % (name, name)
        self.tendons.append('<spatial name="%s" %s>%s</spatial>' % (name, attributes, sites))

    def drop(self, coefficients):
        """A drop of a radius DROP in the middle, so small that the air it displaces has no mass.
        coefficients: of blunt drag times its area [N s^2/m^2], of Magnus lift times its volume [N s^2/m]."""
        area, volume = math.pi * DROP**2, 4 / 3 * math.pi * DROP**3
        drag, lift = coefficients[0] / area / THIN, coefficients[1] / volume / THIN
        self.options["density"] = "%g" % THIN
        mass = '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-12 1e-12 1e-12"/>'
        self.craft.append("<body>%s%s</body>" % (mass, _ellipsoid_geom([DROP] * 3, (drag, 0, 0, 0, lift))))

    def xml(self):
        others, self.actuators = self.actuators, []
        for i, side in enumerate(("left", "right")):
            place = 0.0, (2 * i - 1) * self.body["l"], 0.0
            self.craft.append(_site(side, place, self.angle[i]))
            self.push(side, side, 0, (self.gain[i], 0, -self.gain[i] * self.loss), more=self.thruster)
        self.craft += [_site("middle"), _site("fin", (self.fin, 0, 0))]
        self.push("drag u", "middle", 0, bias=(0, 0, -self.drag[0]))
        self.push("drag v", "fin", 1, bias=(0, 0, -self.drag[1]))
        return """<mujoco><compiler angle="radian"/>
<option timestep="%g" integrator="RK4" gravity="%s" cone="elliptic" impratio="10" %s>
<flag autoreset="disable"/></option>
<worldbody>%s<body name="craft" gravcomp="%g"><joint type="slide" axis="1 0 0"/>
<joint type="slide" axis="0 1 0"/><joint axis="0 0 1" damping="%.9g" %s/>
<inertial pos="0 0 0" mass="%.9g" diaginertia="%.9g %.9g %.9g"/>%s</body></worldbody>
<contact>%s</contact><tendon>%s</tendon><actuator>%s</actuator></mujoco>""" % (
            self.step, _text(self.gravity), "".join('%s="%s" ' % item for item in self.options.items()),
            "".join(self.world), self.compensated, self.drag[2],
            self.turning, self.m, FLAT * self.I_z, FLAT * self.I_z, self.I_z, "".join(self.craft),
            "".join(self.pairs), "".join(self.tendons), "".join(self.actuators + others),
        )  # fmt: skip


def _site(name, place=(0, 0, 0), turn=0.0):
    return '<site name="%s" pos="%s" euler="0 0 %.9g"/>' % (name, _text(place), turn)


def _ellipsoid_geom(radii, coefficients):
    """coefficients: of blunt and slender drag, turning, Kutta's and Magnus's lift."""
    return (
        '<geom type="ellipsoid" size="%s" mass="0" contype="0" conaffinity="0" fluidshape="ellipsoid" '
        'fluidcoef="%s"/>' % (_text(radii), _text(coefficients))
    )


def _text(numbers):
    return " ".join("%.12g" % number for number in numbers)


# --- Effects of the library


def _delay(parts, p):
    """The engine interpolates between controls, as if the mean over each step were the value at its begin."""
    parts.thruster += 'delay="%.9g" nsample="64" interp="linear" ' % (p["delay"] + parts.step / 2)


def _lag(parts, p):
    parts.thruster += 'dyntype="filter" dynprm="%.9g" ' % p["tau"]


def _asymmetry(parts, p):
    parts.gain = [parts.gain[0] * (1 + p["a"]), parts.gain[1] * (1 - p["a"])]


def _misalignment(parts, p):
    parts.angle = [angle + p["angle"] for angle in parts.angle]


def _toe(parts, p):
    """Both thrusters point outwards."""
    toe = math.atan(p["c"])
    parts.angle = [parts.angle[0] + toe, parts.angle[1] - toe]
    parts.gain = [gain / math.cos(toe) for gain in parts.gain]


def _quadratic(parts, p):
    """The engine's blunt drag, alike in all directions."""
    parts.drop((p["cx"], 0.0))


def _dry(parts, p):
    """Friction under a tenth of the weight, which does not depend on the lift."""
    parts.compensated = 1 - WEIGHT
    load = WEIGHT * parts.body["m"] * GRAVITY
    parts.foot(p["f"] / load, p.get("across", p["f"]) / load)


def _skirt(parts, p):
    """Friction under the weight that the lift leaves."""
    weight = parts.body["m"] * GRAVITY
    parts.push("lift", "middle", 2, gain=(-0.999 * weight, 0, 0))
    parts.foot(p["f0"] / weight, p["f0"] / weight)


def _momentum(parts, p):
    for axis in (0, 1):
        parts.push("lift %d" % axis, "middle", axis, gain=(0, 0, -p["q"]))


def _tilt(parts, p):
    parts.gravity[:2] = [GRAVITY * p["sx"], GRAVITY * p["sy"]]


def _wind(parts, p):
    """Air of a viscosity that gives the drag of the body that is alike in surge and sway."""
    drag = min(parts.drag[:2])
    box = 2 + math.sqrt(2 * FLAT - 1)  # sides of the engine's equivalent box, relative to the longest
    diameter = box / 3 * math.sqrt(6 * parts.I_z / parts.m)
    parts.options["viscosity"] = "%.9g" % (drag / (3 * math.pi * diameter))
    parts.options["wind"] = _text((p["wx"], p["wy"], 0.0))
    parts.drag = [parts.drag[0] - drag, parts.drag[1] - drag, parts.drag[2] - drag * diameter**2 / 3]


def _bias(parts, p):
    parts.push("bias x", "middle", 0, bias=(p["x0"], 0, 0))
    parts.push("bias y", "middle", 1, bias=(p["y0"], 0, 0))


def _turning_bias(parts, p):
    parts.push("bias n", "middle", 5, bias=(p["n0"], 0, 0))


def _fin(parts, p):
    """The drag in sway acts before or behind the middle; the damping in yaw stays."""
    parts.fin = p["yr"] / max(1e-4, parts.drag[1])
    parts.drag[2] = max(0.0, parts.drag[2] - parts.drag[1] * parts.fin**2)


def _offset(parts, p):
    """A payload that does not change mass and moment of inertia as a whole."""
    at = p["xg"] / PAYLOAD, p["yg"] / PAYLOAD, 0.0
    parts.payload(PAYLOAD, at, "")
    parts.I_z -= PAYLOAD * (1 - PAYLOAD) * parts.body["m"] * (at[0] ** 2 + at[1] ** 2)


# --- Effects without a name


def _elastic(parts, p):
    """An elastic thread from the bow to a place in the room; slack up to a length."""
    length = 'springlength="0 %g" stiffness="%.9g"' % (p["slack"], p["stiffness"])
    parts.tendon("thread", (p["bow"], 0, 0), (p["x"], p["y"], -0.001), length)


def _compass(parts, p):
    """Bow and stern are pulled towards far poles with a constant force each."""
    for name, sign in (("north", 1), ("south", -1)):
        pole = sign * FAR * math.cos(p["psi"]), sign * FAR * math.sin(p["psi"]), 0
        parts.tendon(name, (sign * TIP, 0, 0), pole, "")
        force = p["moment"] / (2 * TIP)
        pull = '<general name="%s" tendon="%s" gainprm="0" biastype="affine" biasprm="%.9g"/>'
        parts.actuators.append(pull % (name, name, -force))


def _twisted(parts, p):
    parts.turning = 'stiffness="%.9g" springref="%g"' % (p["stiffness"], p["psi"])


def _hanging(parts, p):
    """A weight on a thread below the craft."""
    joints = "".join('<joint axis="%s" damping="%g"/>' % (axis, p["damping"]) for axis in ("1 0 0", "0 1 0"))
    parts.payload(p["share"], (0, 0, p["length"]), joints)


def _swinging(parts, p):
    """An arm with a weight that swings in the plane."""
    joint = '<joint axis="0 0 1" stiffness="%g" damping="%g"/>' % (p["stiffness"], p["damping"])
    parts.payload(p["share"], (p["length"], 0, 0), joint)
    parts.I_z -= p["share"] * parts.body["m"] * p["length"] ** 2


def _ellipsoid(parts, p):
    """Drag and lift of an ellipsoid in a dense gas, with the engine's own coefficients."""
    parts.options["density"] = "%.9g" % p["density"]
    radii = p["long"], p["long"] / 2, p["long"] / 4
    parts.craft.append(_ellipsoid_geom(radii, (0.5, 0.25, 1.5, 1.0, 1.0)))


def _magnus(parts, p):
    """A side force of a * r * u."""
    parts.drop((0.0, p["a"]))


def _loss(parts, p):
    """Thrust falls with the speed of each thruster, which the turning changes."""
    parts.loss = p["c"]


ADD = {
    "input_delay": _delay,
    "motor_lag": _lag,
    "thrust_asymmetry": _asymmetry,
    "thrust_misalignment": _misalignment,
    "differential_side_force": _toe,
    "quadratic_drag": _quadratic,
    "coulomb_friction": _dry,
    "skirt_friction": _skirt,
    "momentum_drag": _momentum,
    "floor_tilt": _tilt,
    "wind": _wind,
    "body_force_bias": _bias,
    "yaw_bias": _turning_bias,
    "sway_yaw_damping": _fin,
    "com_offset": _offset,
    "elastic thread": _elastic,
    "slack thread": _elastic,
    "compass": _compass,
    "twisted cable": _twisted,
    "hanging weight": _hanging,
    "swinging arm": _swinging,
    "ellipsoid drag": _ellipsoid,
    "grained floor": _dry,
    "magnus force": _magnus,
    "inflow at each thruster": _loss,
}
