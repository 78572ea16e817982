"""Effects without a name: a grammar draws them, so that nobody can tune a diagnosis to a list.

An effect is a wrench in the body frame, written as a formula of the motion. It is a function of one or two
arguments (heading, place, velocity, command, past, time) that acts in a direction (of the body, of the room,
towards a point, along or across the velocity, of a thruster). `local` effects act in one place, for a
while, or beyond a limit. An effect is plain values, so that it fits in a line of JSON:

  lines      [[name, expression], ...] evaluated in order; X, Y [N], N [N m] are the wrench
  states     [[name, expression of its rate], ...], 0 at the start
  constants  {name: value}; `a` scales the effect, k and l are the body's
  by_run     {name: value in each run}; `run` (added when a run is simulated) chooses one
  arguments  what the wrench depends on, the most important first
  repeats    whether the recorded motion and the time determine it
"""

import copy
import math

import numpy as np

VARIABLES = ("t", "x", "y", "psi", "u", "v", "r", "left", "right", "lift")
FUNCTIONS = ("sin", "cos", "tanh", "exp", "sqrt", "hypot")


def _namespace(functions):
    """Functions that expressions may call, of numbers (math) or of arrays (numpy)."""
    names = {name: getattr(functions, name) for name in FUNCTIONS}
    if functions is math:
        return dict(names, atan2=math.atan2, max=max, min=min, sign=lambda q: math.copysign(1.0, q))
    return dict(names, atan2=np.arctan2, max=np.maximum, min=np.minimum, sign=np.sign)


class Nameless:
    """A drawn effect, to be evaluated. functions: math for numbers, numpy for arrays."""

    def __init__(self, effect, functions):
        self.count = len(effect["states"])
        names = _namespace(functions)
        names.update(effect["constants"])
        names.update({name: runs[effect["run"]] for name, runs in effect["by_run"].items()})
        states = [name for name, _ in effect["states"]]
        head = ["def {}(%s, z):" % ", ".join(VARIABLES)]
        head += [" %s, = z" % ", ".join(states)] if states else []
        body = [" X = Y = N = 0.0"] + [" %s = %s" % tuple(line) for line in effect["lines"]]
        body.append(" return X, Y, N")
        rates = [" return [%s]" % ", ".join(rate for _, rate in effect["states"])]
        for name, lines in (("wrench", body), ("rates", rates)):
            exec("\n".join(head + lines).format(name), names)
        self._wrench, self._rates = names["wrench"], names["rates"]

    def wrench(self, at, z):
        """X, Y [N], N [N m] at a hidden_craft.Point, whose states are z."""
        return self._wrench(*[getattr(at, name) for name in VARIABLES], z)

    def rates(self, at, z):
        return self._rates(*[getattr(at, name) for name in VARIABLES], z)


def along(effect, run, motion, began):
    """The wrench (n, 3) of an effect along a hidden_craft.Motion of a run, given its number and when its
    drive began [s]."""
    effect, motion = {**effect, "run": run}, columns(motion, began)
    states = _states(Nameless(effect, math), np.column_stack(motion).tolist())
    wrench = Nameless(effect, np)._wrench(*motion, states.T)
    return np.column_stack(np.broadcast_arrays(*wrench, motion[0])[:3])


def _states(nameless, rows):
    """States (n, k) along rows of the VARIABLES by Heun's method."""
    states = np.zeros((len(rows), nameless.count))
    for i in range(1, len(rows) if nameless.count else 0):
        step, before = rows[i][0] - rows[i - 1][0], states[i - 1]
        first = np.array(nameless._rates(*rows[i - 1], before))
        second = np.array(nameless._rates(*rows[i], before + step * first))
        states[i] = before + step / 2 * (first + second)
    return states


def columns(motion, began):
    """The VARIABLES along a hidden_craft.Motion, arrays (n,)."""
    return [motion.times - began, *motion.eta.T, *motion.nu.T, *motion.inputs.T]


def text(effect):
    """The formula in one line."""
    lines = ["%s' = %s" % tuple(state) for state in effect["states"]]
    lines += ["%s = %s" % tuple(line) for line in effect["lines"]]
    return "; ".join(lines) + " (%s)" % ", ".join("%s %.3g" % c for c in effect["constants"].items())


def scaled(effect, size):
    """The effect at another size, rounded because fits differ by their last digits."""
    changed = copy.deepcopy(effect)
    changed["constants"]["a"] = float("%.4g" % size)
    return changed


def draw(random, sample, body, local=False):
    """A random effect. sample: {variable: values} along motions of the craft, which set places and scales;
    body: m, l, k of the craft."""
    drawn = _Drawn(random, sample, body)
    (_draw_local if local else _draw_everywhere)(drawn)
    return drawn.effect


def _draw_everywhere(d):
    if d.random.uniform() < 0.3:
        return d.one_of(MECHANISMS)(d)
    d.act(d.function())
    if d.random.uniform() < 0.15:  # a second part, which may act in another frame
        d.act(d.function(products=0.0))


class _Drawn:
    """An effect while it is drawn."""

    def __init__(self, random, sample, body):
        self.random, self.body = random, body
        self.sample = {**sample, **_namespace(np)}
        constants = {"a": 1.0, "k": body["k"], "l": body["l"]}
        self.effect = {"lines": [], "states": [], "constants": constants, "by_run": {}}
        self.effect.update(arguments=[], repeats=True)

    # --- Random parts

    def one_of(self, items):
        return items[self.random.integers(len(items))]

    def between(self, low, high):
        """A number in [low, high], log-uniformly distributed."""
        return float(np.exp(self.random.uniform(np.log(low), np.log(high))))

    def angle(self):
        return float(self.random.uniform(-np.pi, np.pi))

    def point(self, off=0.2):
        """A place on the craft's way, or up to about `off` [m] beside it."""
        i = self.random.integers(len(self.sample["x"]))
        x, y = (self.sample[axis][i] + off * self.random.normal() for axis in "xy")
        return "(x %+.3f)" % -x, "(y %+.3f)" % -y

    def depends_on(self, *arguments):
        known = self.effect["arguments"]
        known += [name for name in arguments if name not in known]

    def let(self, name, expression):
        """Gives an expression a name; returns the name, made unique."""
        used = [line[0] for line in self.effect["lines"]]
        name = name if name not in used else name + "%d" % (1 + len(used))
        self.effect["lines"].append([name, expression])
        return name

    def state(self, rate):
        """Adds a state, {z} in its rate; returns its name."""
        name = "z%d" % len(self.effect["states"])
        self.effect["states"].append([name, rate.format(z=name)])
        return name

    # --- Functions of one argument

    def function(self, products=0.35):
        """An expression of about unit size: a function of an argument, or a product of two."""
        first = self.one_of(KINDS)
        expression = getattr(self, "_of_" + first)()
        if self.random.uniform() < products:
            second = self.one_of([kind for kind in KINDS if kind != first])
            return "%s*%s" % (expression, getattr(self, "_of_" + second)())
        return expression

    def real(self, expression, like=None):
        """A random function of a real argument, which varies as the expression `like` does in the sample."""
        values = np.broadcast_to(eval(like or expression, {}, self.sample), self.sample["t"].shape)
        width = max(float(values.std()), 1e-3) * self.between(0.6, 1.6)
        offset = 0.0
        if self.random.uniform() < 0.5:
            offset = float(np.quantile(values, self.random.uniform(0.2, 0.8)))
        shifted = "(%s %+.4g)" % (expression, -offset) if offset else expression
        q = "%s/%.4g" % (shifted, width)
        numbers = {"p": self.random.uniform(0.4, 2.8), "k": self.random.uniform(1, 3)}
        numbers = {name: "%.3g" % value for name, value in numbers.items()}
        return self.one_of(SHAPES).format(q="(%s)" % q, phase="%+.3g" % self.angle(), **numbers)

    def periodic(self, angle):
        """A random function of an angle."""
        turn = "%d*(%s) %+.3g" % (self.random.integers(1, 5), angle, self.angle())
        return self.one_of(PERIODIC).format(turn=turn, k="%.3g" % self.random.uniform(0.7, 3))

    def _of_heading(self):
        self.depends_on("heading")
        return self.periodic("psi")

    def _of_place(self):
        self.depends_on("place")
        dx, dy = self.point(0.5)
        sort = self.random.integers(4)
        if sort == 0:
            return self.real("hypot(%s, %s)" % (dx, dy))
        if sort == 1:  # the bearing, smooth at the point itself
            near = "(1 - exp(-20*(%s**2 + %s**2)))" % (dx, dy)
            return near + "*" + self.periodic("atan2(%s, %s)" % (dy, dx))
        way = self.angle()
        line = "(x*%.4g + y*%.4g)" % (math.cos(way), math.sin(way))
        if sort == 2:
            return self.real(line)
        wave = 2 * math.pi / self.between(0.25, 2.0)
        return "sin(%.4g*%s %+.3g)" % (wave, line, self.angle())

    def _of_velocity(self):
        self.depends_on("velocity")
        if self.random.uniform() < 0.25:
            angle = self.one_of(["atan2(v, u)", "psi + atan2(v, u)"])
            if angle.startswith("psi"):
                self.depends_on("heading")
            return "tanh(8*(u*u + v*v))*" + self.periodic(angle)
        return self.real(self._velocity())

    def _velocity(self):
        expression = self.one_of(["u", "v", "r", "hypot(u, v)", "world"])
        if expression == "world":
            self.depends_on("heading")
            way = self.angle()
            return "(u*cos(psi %+.4g) - v*sin(psi %+.4g))" % (-way, -way)
        return expression

    def _of_command(self):
        self.depends_on("command")
        if self.random.uniform() < 0.1 and self.sample["lift"].std() > 0.05:
            return self.real("lift")
        return self.real(self.one_of(COMMANDS))

    def _of_past(self):
        self.depends_on("past")
        signal = self.one_of(COMMANDS + ["u", "v", "r", "hypot(u, v)", "abs(r)"])
        return self.real(self.state("(%s - {z})/%.3g" % (signal, self.between(0.15, 1.5))), signal)

    def _of_time(self):
        self.depends_on("time")
        return self.real("t")

    # --- Directions

    def act(self, function):
        """The function acts in a random direction, in shares of the full thrust or its moment."""
        f = self.let("f", "a*%s" % function)
        direction = self.one_of(DIRECTIONS)
        if direction == "yaw":
            self.add(N="l*%s" % f)
        elif direction == "body":
            way = self.one_of([0.0, math.pi / 2, self.angle()])
            self.add(X="%.4g*%s" % (math.cos(way), f), Y="%.4g*%s" % (math.sin(way), f))
        elif direction == "room":
            if not set(self.effect["arguments"]) & {"place", "time"}:
                self.depends_on("heading")
            self.add_in_room(f, self.angle())
        elif direction == "point":
            self.depends_on("place")
            self.add_towards(f, *self.point(0.5))
        elif direction in ("along", "across"):
            self.depends_on("velocity")
            speed = self.let("speed", "sqrt(u*u + v*v + 0.01)")
            pair = ("-u", "-v") if direction == "along" else ("v", "-u")
            self.add(*("%s*%s/%s" % (f, part, speed) for part in pair))
        else:
            self.depends_on("command")
            force, moment = self.one_of(THRUSTERS)
            self.add("%s*%s" % (f, force), N="l*%s*%s" % (f, moment))

    def add(self, X=None, Y=None, N=None):
        for name, part in (("X", X), ("Y", Y), ("N", N)):
            if part:
                self.effect["lines"].append([name, "%s + %s" % (name, part)])

    def add_in_room(self, force, way):
        """A force in a direction of the room [rad]."""
        turned = "(psi %+.4g)" % -way
        self.add("%s*cos%s" % (force, turned), "-%s*sin%s" % (force, turned))

    def add_in_axes(self, along_x, along_y):
        """A force by its components in the room."""
        self.add(
            "cos(psi)*(%s) + sin(psi)*(%s)" % (along_x, along_y),
            "cos(psi)*(%s) - sin(psi)*(%s)" % (along_y, along_x),
        )

    def add_towards(self, force, dx, dy):
        """A force towards a point, given the way dx, dy from it."""
        distance = self.let("d", "sqrt(%s**2 + %s**2 + 0.01)" % (dx, dy))
        self.add_in_axes(*("-%s*%s/%s" % (force, part, distance) for part in (dx, dy)))


KINDS = ("heading", "place", "velocity", "command", "past", "time")
COMMANDS = ["left", "right", "(left + right)", "(left - right)", "left*right"]
DIRECTIONS = ("yaw", "yaw", "body", "body", "room", "room", "point", "along", "across", "thruster")
THRUSTERS = [("left", "left"), ("right", "-right")]  # their force and its moment
THRUSTERS += [("(left + right)", "(left - right)"), ("(left - right)", "(left + right)")]
SHAPES = ["{q}", "{q}**2", "{q}*abs({q})", "{q}**3", "abs({q})**{p}", "sign({q})*abs({q})**{p}",
          "tanh({k}*{q})", "exp(-{q}**2)", "sin({k}*{q} {phase})", "exp(min({q}, 2.5))",
          "max({q}, 0)", "1/(1 + {q}**2)", "{q}/(1 + abs({q}))"]  # fmt: skip
PERIODIC = ["sin({turn})", "sin({turn})", "tanh({k}*sin({turn}))", "exp({k}*(cos({turn}) - 1))",
            "abs(sin({turn}))", "max(sin({turn}), 0)"]  # fmt: skip


# --- Mechanisms: effects of which one part alone makes no sense


def _magnus(d):
    """A force across the velocity that spin causes."""
    d.depends_on("velocity")
    power = d.random.uniform(0, 1)
    f = d.let("f", "a*r*(u*u + v*v + 0.01)**%.3g" % (-power / 2))
    d.add("%s*v" % f, "-%s*u" % f)


def _dry_by_axis(d):
    """Dry friction with a different level along each axis of the body, or of the room (a carpet)."""
    d.depends_on("velocity")
    way, ratio = d.angle(), d.between(0.2, 5)
    if d.random.uniform() < 0.5:
        d.let("speed", "sqrt(u*u + v*v + 0.0025)")
        return d.add("-a*u/speed", "-a*%.3g*v/speed" % ratio)
    d.depends_on("heading")
    d.let("w", "u*cos(psi %+.4g) - v*sin(psi %+.4g)" % (-way, -way))
    d.add_in_room("(-a*%s)" % d.one_of(["w", "w*abs(w)", "w/sqrt(w*w + 0.0025)"]), way)


def _ellipsoid(d):
    """Drag of a body whose resistance along its axes differs."""
    d.depends_on("velocity")
    e = d.between(1.5, 4) ** d.one_of([-1, 1])
    d.let("q", "a*sqrt(u*u + %.3g*v*v)" % e**2)
    d.add("-q*u", "-q*%.3g*v" % e**2, "l*q*v*%.3g" % d.random.uniform(-1, 1))


def _spring(d):
    """A spring to a point; a thread that is slack near it."""
    d.depends_on("place")
    dx, dy = d.point(0.5)
    distance = "hypot(%s, %s)" % (dx, dy)
    typical = float(np.median(eval(distance, {}, d.sample)))
    slack = d.one_of([0.0, d.random.uniform(0.3, 1.0) * typical])
    f = "max(%s - %.3g, 0)%s" % (distance, slack, d.one_of(["", "", "**2", "**0.5"]))
    d.add_towards(d.let("f", "a*" + f), dx, dy)


def _pendulum(d):
    """A load that swings below the craft: its force follows the room's axes."""
    d.depends_on("past", "velocity")
    stiff, damp = (2 * np.pi / d.between(0.5, 2.0)) ** 2, d.between(0.1, 1.5)
    for axis in ("x", "y"):
        at = d.state("z%d" % (len(d.effect["states"]) + 1))
        d.state("%.4g*(%s - %s) - %.3g*{z}" % (stiff, axis, at, damp))
    d.add_in_axes("a*(z0 - x)", "a*(z2 - y)")


def _dragged(d):
    """A cable that the craft drags behind it."""
    d.depends_on("past", "velocity")
    time, power = d.between(0.2, 2.0), d.random.uniform(0.3, 1.7)
    for axis in ("x", "y"):
        d.state("(%s - {z})/%.3g" % (axis, time))
    d.let("d", "hypot(z0 - x, z1 - y) + 0.01")
    d.add_in_axes(*("a*(%s)*d**%.3g" % (way, power - 1) for way in ("z0 - x", "z1 - y")))


def _thrust_by(d):
    """Thrust that depends on heading, sway or turning."""
    kind = d.one_of(["heading", "velocity"])
    d.depends_on("command", kind)
    factor = d.periodic("psi") if kind == "heading" else d.real(d.one_of(["v", "r", "abs(v)", "abs(r)"]))
    f = d.let("f", "a*%s" % factor)
    d.add(X="%s*(left + right)" % f, N="l*%s*(left - right)" % f)


MECHANISMS = (_magnus, _dry_by_axis, _ellipsoid, _spring, _pendulum, _dragged, _thrust_by)


# --- Effects that act in one place, for a while, or beyond a limit


def _draw_local(d):
    d.one_of(LOCAL)(d)


def _patch(d):
    """A disc of floor that brakes, pushes, turns, or takes thrust."""
    d.depends_on("place")
    dx, dy = d.point()
    size = (d.between(0.2, 0.8), d.between(0.02, 0.15))
    f = d.let("f", "a*(1 - tanh((hypot(%s, %s) - %.3g)/%.3g))/2" % (dx, dy, *size))
    action = d.one_of(["brakes", "brakes", "pushes", "turns", "thrust"])
    if action == "brakes":
        d.depends_on("velocity")
        d.let("speed", "sqrt(u*u + v*v + 0.0025)**%d" % d.one_of([0, 1]))
        d.add("-%s*u/speed" % f, "-%s*v/speed" % f)
    elif action == "pushes":
        d.add_in_room(f, d.angle())
    elif action == "turns":
        d.add(N="%+d*l*%s" % (d.one_of([-1, 1]), f))
    else:
        d.depends_on("command")
        d.add(X="-%s*(left + right)" % f, N="-l*%s*(left - right)" % f)


def _bumps(d):
    """Bumps and hollows: the force is down their slope."""
    d.depends_on("place")
    for _ in range(d.random.integers(1, 4)):
        (dx, dy), width = d.point(), d.between(0.1, 0.5)
        inner = "%+d*a*exp(-(%s**2 + %s**2)/%.4g)/%.3g" % (d.one_of([-1, 1]), dx, dy, 2 * width**2, width)
        f = d.let("f", inner)
        d.add_in_axes("%s*%s" % (f, dx), "%s*%s" % (f, dy))


def _gust(d):
    """A push for a while, at one time in all runs, or at another time in each run."""
    length = d.between(0.3, 1.5)
    if d.random.uniform() < 0.5:
        begin = "%.3f" % d.random.uniform(1.5, 6.5)
        d.depends_on("time")
    else:
        begin = "begin"
        d.effect["by_run"]["begin"] = d.random.uniform(1.5, 6.5, 6).tolist()
        d.depends_on("time", "run")
        d.effect["repeats"] = False
    f = d.let("f", "a*exp(-((t - %s)/%.3g)**4)" % (begin, length))
    if d.random.uniform() < 0.3:
        return d.add(N="%+d*l*%s" % (d.one_of([-1, 1]), f))
    if d.random.uniform() < 0.5:
        return d.add_in_room(f, d.angle())
    way = d.angle()
    d.add("%.4g*%s" % (math.cos(way), f), "%.4g*%s" % (math.sin(way), f))


def _stall(d):
    """Thrust or resistance that changes beyond an angle or a speed."""
    d.depends_on("velocity")
    quantity = d.one_of(["abs(atan2(v, abs(u) + 0.1))", "hypot(u, v)", "abs(r)", "abs(v)", "u"])
    values = eval(quantity, {}, d.sample)
    limit = float(np.quantile(values, d.random.uniform(0.6, 0.85)))
    width = 0.15 * float(values.std())
    f = d.let("f", "a*(1 + tanh((%s - %.3g)/%.3g))/2" % (quantity, limit, width))
    if d.random.uniform() < 0.6:
        d.depends_on("command")
        return d.add(X="-%s*(left + right)" % f, N="-l*%s*(left - right)" % f)
    way = d.one_of(["X", "Y", "N"])
    d.add(**{way: {"X": "-%s*u", "Y": "-%s*v", "N": "-l*%s*r"}[way] % f})


def _drift(d):
    """A slow change within each run, or from run to run."""
    if d.random.uniform() < 0.5:
        d.depends_on("time")
        f = d.let("f", "a*" + d.one_of(["(t/7)**%.3g" % d.between(0.7, 3), "sin(%.3g*t + %.3g)"
                                        % (d.random.uniform(0.3, 1.2), d.angle())]))  # fmt: skip
    else:
        d.depends_on("run")
        d.effect["repeats"] = False
        d.effect["by_run"]["level"] = np.cumsum(d.random.normal(size=6)).tolist()
        f = d.let("f", "a*level")
    direction = d.random.integers(4)
    if direction == 0:
        return d.add(N="l*" + f)
    if direction == 1:
        return d.add_in_room(f, d.angle())
    d.depends_on("command" if direction == 2 else "velocity")
    if direction == 2:
        return d.add(X="-%s*(left + right)" % f, N="-l*%s*(left - right)" % f)
    d.add("-%s*u" % f, "-%s*v" % f)


def _wake(d):
    """The air that the craft has stirred pushes it away from where it was."""
    d.depends_on("past", "velocity")
    time, width = d.between(0.3, 1.5), d.between(0.15, 0.6)
    for axis in ("x", "y"):
        first = d.state("2*(%s - {z})/%.3g" % (axis, time))
        d.state("2*(%s - {z})/%.3g" % (first, time))
    dx, dy = "(x - z1)", "(y - z3)"
    f = d.let("f", "a*exp(-(%s**2 + %s**2)/%.4g)/%.3g" % (dx, dy, 2 * width**2, width))
    d.add_in_axes("%s*%s" % (f, dx), "%s*%s" % (f, dy))


def _floor(d):
    """An irregular floor: its slope is a random field."""
    d.depends_on("place")
    length, parts = d.between(0.4, 2.0), ([], [])
    for _ in range(8):
        kx, ky = d.random.normal(size=2) * 2 * math.pi / length / math.sqrt(2)
        wave = "*cos(%.4g*x + %.4g*y + %.3g)" % (kx, ky, d.angle())
        for k, part in zip((kx, ky), parts):
            part.append("%.3g%s" % (k * length / 8, wave))
    names = [d.let("f", "a*(%s)" % " + ".join(part)) for part in parts]
    d.add_in_axes(*names)


LOCAL = (_patch, _patch, _bumps, _gust, _stall, _drift, _wake, _floor)
