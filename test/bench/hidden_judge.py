"""Judges what the tool says about a case of hidden_conditions by how its models predict fresh runs.

Predictions are hidden_craft's: each block of a fresh run begins at the pose and velocities that the mocap
shows there, and ends a horizon later. The error of a block is that of position and heading, each relative to
the rms error of the true craft, which does not know the random push (the floor).
"""

import re

import numpy as np

import hidden_cases
import hidden_conditions
import hidden_craft
import hidden_effects
import hidden_engine
import hidden_noise
import hidden_score
from ground import _core
from ground.simulation import experiments
from ground.support.errors import GroundError

STEP, SHORT = 8e-3, 1e-3  # longest and shortest step of a prediction [s]
STIFF = ("tau", "rise", "fall", "near")  # time constants of hidden_craft's effects that limit a step
LEAST = 1.0  # horizon where the tool gives none [s]
HALF = 0.15  # half of the time over which noise of poses is averaged at a start [s]
SMALL = 1e-5  # step of the differences that give velocities [s]
DOUBT = 2.0  # standard errors by which a model is worse than another
FAR = 2.0  # error relative to the floor at which something matters is missing
ALONE = ("simulation", "likelihood", "tool")  # refits without effects
SURE = re.compile(r"\b(Very certain|Certain)\.")
FILTERED = 0.5  # time after an end that a forward-backward low-pass uses, in periods of its cut-off
LATER = 0.2  # time from the first command of the thrusters to the first start [s]


def judged(case):
    """Result of a case, a dictionary for a line of JSON."""
    flown = [hidden_cases.fly(case, i) for i in range(len(case.runs))]
    fresh = range(hidden_conditions.FITTED, len(flown))
    given = hidden_cases.given_model(case)
    recordings = [run.recording for run in flown[: hidden_conditions.FITTED]]
    result = dict(case.describe(), judged=True)
    try:
        found, models = hidden_engine.answer(recordings, given)
    except GroundError as error:
        return dict(result, found={"failed": str(error)})
    seconds = found["horizon"] or LEAST
    blocks = [Blocks(case, i, flown[i], seconds, found["unsmoothed"]) for i in fresh]
    result["found"] = found
    result["errors"] = errors(blocks, models)
    if found["promised"]:
        of = {"improved": models["improved"], "refitted": models["tool"]}
        fresh_runs = [flown[i].recording for i in fresh]
        result["kept"] = hidden_engine.kept(fresh_runs, {k: m for k, m in of.items() if m}, seconds)
    for name in ("k", "I_z"):
        value = found["parameters"].get(name)
        result[name] = None if value is None else value / case.body[name]
    result["flags"] = flags(result)
    return result


def craft_of(model):
    """The hidden_craft.Craft of a _core.Model; GroundError if it has an effect that hidden_craft lacks."""
    effects = {}
    for effect in model.effects:
        if effect not in {**hidden_effects.STRENGTHS, **hidden_effects.OF_CRAFT}:
            raise GroundError("the bench's craft has no effect %s: add it to hidden_craft" % effect)
        names = [p["name"] for p in _core.effects()[effect]["parameters"]]
        own = hidden_effects.OF_CRAFT.get(effect, effect)
        effects[own] = {name: model.value("%s.%s" % (effect, name)) for name in names}
    for name, value in effects.get("spin_up", {}).items():
        effects["spin_up"][name] = max(value, SHORT)
    if "slew" in effects:
        effects["slew"]["near"] = SHORT
    if effects.get("motor_lag", {}).get("tau", 1.0) < SHORT:  # too short to matter, or to integrate
        del effects["motor_lag"]
    return hidden_craft.Craft({name: model.value(name) for name in hidden_cases.NOMINAL}, effects)


class Blocks:
    """Blocks of a fresh run: where they start and end, and what the mocap measured there. unsmoothed: it is
    taken as before the mocap's low-pass."""

    def __init__(self, case, i, flown, seconds, unsmoothed):
        self.case, self.i, self.flown = case, i, flown
        smooths = case.mocap.get("cutoff") and not unsmoothed
        self.mocap = mocap = case.mocap if smooths else {**case.mocap, "cutoff": 0.0}
        rate, self.frames = hidden_noise.RATE, flown.frames
        self.after = FILTERED / mocap["cutoff"] if smooths and mocap["both"] else 0.0
        length = int(round(seconds * rate))
        gap = length + int(np.ceil(self.after * rate))
        thrust = np.flatnonzero(flown.sent[:, 1:3].any(axis=1))[0]
        first = np.searchsorted(self.frames, flown.sent[thrust, 0] + LATER)
        last = np.searchsorted(self.frames, flown.end - experiments.TAIL) - 1
        self.starts = np.arange(first, last - gap, gap)
        self.ends = self.starts + length
        off = flown.recording.eta - hidden_noise.smoothed(flown.exact, case.mocap)
        self.measured = hidden_noise.smoothed(flown.exact, mocap) + off
        times = self.frames
        rates = [hidden_cases.exact(case, flown.motion, times + d) for d in (-SMALL, SMALL)]
        self.exact = hidden_noise.smoothed(flown.exact, mocap)
        self.rates = hidden_noise.smoothed((rates[1] - rates[0]) / (2 * SMALL), mocap)
        self.noise = self._noise()

    def _noise(self):
        """Errors (n, 6) of poses and of their rates in the room that noise leaves at each start."""
        half = int(HALF * hidden_noise.RATE)
        span = np.arange(-half, half + 1)
        fit = np.linalg.pinv(np.vander(span / hidden_noise.RATE, 3, increasing=True))[:2]
        off = self.measured - self.exact
        off[:, 2] = _wrapped(off[:, 2])
        return np.array([(fit @ off[start + span]).ravel() for start in self.starts])

    def errors_of(self, craft):
        """Distances (n, 2) [m], [rad] between what a craft predicts and the poses measured at the ends."""
        try:
            return self._apart(self._predicted(craft, self._begun(craft)))
        except (ArithmeticError, ValueError):
            return np.full((len(self.starts), 2), np.inf)

    def errors_of_truth(self):
        """The same of the true craft, from its true states, without its random push."""
        motion, case = self.flown.motion, self.case
        craft = hidden_craft.Craft(case.body, hidden_cases.acting_effects(case, self.i))
        times = self.frames[self.starts]
        true = motion.poses(times)
        nu = np.column_stack([np.interp(times, motion.times, column) for column in motion.nu.T])
        in_room = _turned(nu, true[:, 2]) + self.noise[:, 3:]
        poses = true + self.noise[:, :3]
        states = np.column_stack([poses, _turned(in_room, -poses[:, 2])])
        paths = self._paths(craft, states, self._commands_of_truth(craft.effects))
        if not (self.mocap.get("cutoff") or "sway" in case.effects):
            ends = np.array([path[_row(path, at)][1:4] for path, at in zip(paths, self.frames[self.ends])])
            return self._apart(hidden_craft.seen(craft.effects, ends))
        return self._apart(np.array([self._seen(*each) for each in zip(paths, self.starts, self.ends)]))

    def _commands_of_truth(self, effects):
        """The commands as they reached the craft, whatever their stamps say; a pilot's acted at once."""
        motion, sent = self.flown.motion, self.flown.sent
        if any(self.case.stamps) or self.case.jitter:
            return [(motion.times, column) for column in motion.inputs.T]
        return hidden_craft.acting(effects, sent)

    def _seen(self, path, start, end):
        """What the mocap sees at an end if the craft moves along a path from a start on."""
        motion = self.flown.motion
        before = motion.times < self.frames[start] - 1e-9
        whole = hidden_craft.Motion(
            np.append(motion.times[before], path[:, 0]),
            np.vstack([motion.eta[before], path[:, 1:4]]),
            np.vstack([motion.nu[before], path[:, 4:7]]),
            np.vstack([motion.nu_dot[before], path[:, 7:10]]),
        )
        frames = self.frames[self.frames <= path[-1, 0] + 1e-9]
        return hidden_noise.smoothed(hidden_cases.exact(self.case, whole, frames), self.mocap)[end]

    def _begun(self, craft):
        """States (n, 6) of a craft at the starts, as the mocap shows them."""
        poses = self.exact[self.starts] + self.noise[:, :3]
        rates = self.rates[self.starts] + self.noise[:, 3:]
        dx, dy, psi0 = hidden_craft.mount(craft.effects)
        psi = poses[:, 2] - psi0
        c, s = np.cos(psi), np.sin(psi)
        center = poses[:, :2] - np.column_stack([c * dx - s * dy, s * dx + c * dy])
        nu = _turned(rates, -psi) - rates[:, 2:] * np.array([-dy, dx, 0.0])
        return np.column_stack([center, psi, nu])

    def _predicted(self, craft, states):
        commands = hidden_craft.acting(craft.effects, self.flown.sent)
        paths, ends = self._paths(craft, states, commands), self.frames[self.ends]
        poses = np.array([path[_row(path, at)][1:4] for path, at in zip(paths, ends)])
        return hidden_craft.seen(craft.effects, poses)

    def _paths(self, craft, states, commands):
        """Rows time, pose, velocities, accelerations of each block and the time after it. The craft moves
        through the whole run, so that its inner states are right, and is put where each block starts."""
        began = self.flown.motion.times[0]
        firsts, lasts = self.frames[self.starts], self.frames[self.ends] + self.after
        edges = np.concatenate([times for times, _ in commands] + [firsts, self.frames[self.ends], lasts])
        if len(edges) > 4 * len(self.frames):  # commands at every step of a motion
            edges = np.concatenate([_changes(c) for c in commands] + [firsts, self.frames[self.ends], lasts])
        step = min([STEP, *(p[key] for p in craft.effects.values() for key in STIFF if key in p)])
        grid = np.append(np.arange(began, lasts[-1], step), lasts[-1])
        times = np.unique(np.concatenate([grid, edges[(edges > began) & (edges <= lasts[-1])]]))
        times = times[np.append(np.diff(times) > 1e-9, True)]
        held = np.column_stack([hidden_craft.held_at(command, times) for command in commands]).tolist()
        mover = hidden_craft.Mover(craft, self.flown.motion.eta[0], began)
        paths, block, rows = [], 0, None
        steps = np.append(np.diff(times), 0.0).tolist()
        for t, h, inputs in zip(times.tolist(), steps, held):
            if rows is not None and t >= lasts[block] - 1e-8:
                paths.append(np.array(rows + [[t, *mover.step(t, 0.0, inputs, (0.0, 0.0, 0.0))]]))
                block, rows = block + 1, None
            if rows is None and block < len(firsts) and t >= firsts[block] - 1e-8:
                mover.state[:6], rows = states[block].tolist(), []
            row = mover.step(t, h, inputs, (0.0, 0.0, 0.0))
            if rows is not None:
                rows.append([t, *row])
        return paths

    def _apart(self, ends):
        off = ends - self.measured[self.ends]
        return np.column_stack([np.hypot(off[:, 0], off[:, 1]), np.abs(_wrapped(off[:, 2]))])


def _row(path, time):
    """Number of the row of a path at a time."""
    return int(np.argmin(np.abs(path[:, 0] - time)))


def _changes(command):
    """Times at which a command changes."""
    times, values = command
    return times[np.append(True, np.diff(values) != 0)]


def _wrapped(angles):
    return np.angle(np.exp(1j * angles))


def _turned(rates, angles):
    """Rates (n, 3) with their first two components turned by angles."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, r = rates.T
    return np.column_stack([c * x - s * y, s * x + c * y, r])


def errors(blocks, models):
    """Errors of models on fresh runs, relative to the floor, by name, and `truth`: that of the true craft.
    `best`: the refit without effects that predicts best; `gap`: mean and standard error of the error of
    improved minus that of `best`; `floor`: rms of the true craft [mm], [deg]; `count` of the blocks."""
    runs = np.concatenate([np.full(len(one.starts), one.i) for one in blocks])
    truth = np.concatenate([one.errors_of_truth() for one in blocks])
    floor = np.sqrt((truth**2).mean(axis=0))
    each = {"truth": _relative(truth, floor)}
    for name, model in models.items():
        if model is not None:
            craft = craft_of(model)
            each[name] = _relative(np.concatenate([one.errors_of(craft) for one in blocks]), floor)
    found = {name: float(error.mean()) for name, error in each.items()}
    found["best"] = min((name for name in ALONE if name in each), key=found.get)
    found["gap"] = None
    if "improved" in each:
        found["gap"] = gap(each["improved"] - each[found["best"]], runs)
    return dict(found, floor=[float(1e3 * floor[0]), float(np.degrees(floor[1]))], count=len(runs))


def _relative(apart, floor):
    return np.sqrt(((apart / floor) ** 2).mean(axis=1))


def gap(differences, runs):
    """Mean of differences (n,) between blocks, and its standard error: the larger one of blocks as if they
    were independent and of the means of runs; runs: their numbers (n,)."""
    with np.errstate(invalid="ignore"):
        blocks = differences.std(ddof=1) / np.sqrt(len(differences))
        means = np.array([differences[runs == run].mean() for run in np.unique(runs)])
        between = means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else 0.0
    return [float(differences.mean()), float(max(blocks, between))]


def flags(result):
    """WORSE: the improved model predicts worse than the best refit without effects. FALSE: an effect is named
    that is not hidden. CONFIDENT: either is said for certain, or nothing is needed beside a large error."""
    found, there = result["found"], []
    gaps = result["errors"]["gap"]
    if gaps and (gaps[0] > DOUBT * gaps[1] or not np.isfinite(gaps[0])):
        there.append("WORSE")
    if hidden_score.false_effects(result):
        there.append("FALSE")
    improved = result["errors"].get("improved", 0.0)
    is_far = improved > FAR * result["errors"]["truth"]
    if (certain(found) and there) or (is_far and (is_done(found) or found["verdict"] == "complete")):
        there.append("CONFIDENT")
    return there


def certain(found):
    """Effects' certainties that are said without a reserve."""
    return SURE.findall(" ".join(text for _, text in found["lines"]))


def is_done(found):
    """Whether the tool says that nothing needs to be done."""
    return any(label == "Next" and text.startswith("nothing needed") for label, text in found["lines"])


HEAD = "kind seed condition hidden verdict found certainty given refit improved truth floor flags seconds"
HEAD += " processor k I_z"


def condition(result):
    """The size of what a case hides beside effects of the library, and the level of its random push."""
    sizes = {name: result["mocap"][name] for name in ("cutoff", "step") if name in result["mocap"]}
    if any(result["stamps"]):
        sizes["stamps"] = result["stamps"][1]
    for name, parameters in result["effects"].items():
        sizes.update({} if name in result["hidden"] else parameters)
    differ = {name for run in result["runs"] for own in run.get("own", {}).values() for name in own}
    told = ["%s %.2g" % (name, size) for name, size in sizes.items() if size and name not in differ]
    return " ".join([*told, "push %.1f%%" % (100 * result["level"])])


def table(results):
    """Lines of a table of all results, each a list of strings. Errors are relative to the floor."""
    rows = [HEAD.split()]
    for r in results:
        found, made = r["found"], r.get("errors", {})
        kind = [r["kind"], "%d" % r["seed"], condition(r), ",".join(r["hidden"]) or "-"]
        if "failed" in found:
            row = [*kind, "failed", found["failed"]]
            rows.append(row + [""] * (len(rows[0]) - len(row)))
            continue
        sure = certain(found)
        sure = "".join(word[0] for word in sure) + ("." if is_done(found) else "")
        numbers = [
            "%.2f" % made[n] if n in made else "-" for n in ("given", made["best"], "improved", "truth")
        ]
        floor = "%.1f mm %.1f deg" % tuple(made["floor"])
        ratios = ["-" if r[name] is None else "%.2f" % r[name] for name in ("k", "I_z")]
        told = [found["verdict"], ",".join(found["chosen"]) or "-", sure or "-"]
        end = [floor, ",".join(r["flags"]) or "-", "%.0f" % found["seconds"], "%.0f" % found["processor"]]
        rows.append(kind + told + numbers + end + ratios)
    return rows


def rates(results):
    """Lines of a table of how often each flag is raised, by kind and in all."""
    rows = [["flags", "of", "WORSE", "FALSE", "CONFIDENT", "error of improved over that of refit, median"]]
    rows[0] += ["fresh runs over what was told: improved", "refitted"]
    kinds = list(dict.fromkeys(r["kind"] for r in results))
    for name in [*kinds, "all"]:
        some = [r for r in results if name in (r["kind"], "all") and "flags" in r]
        if not some:
            continue
        counts = ["%d" % sum(flag in r["flags"] for r in some) for flag in rows[0][2:5]]
        ratio = [
            r["errors"]["improved"] / r["errors"][r["errors"]["best"]] for r in some if r["errors"]["gap"]
        ]
        kept = [_middle(_over_told(some, model)) for model in ("improved", "refitted")]
        rows.append([name, "%d" % len(some), *counts, "%.2f" % np.median(ratio) if ratio else "-", *kept])
    return rows


def _over_told(results, model):
    """Errors of a model on fresh runs over those that the tool told of it, geometric means of position and
    heading; of answers with an effect, whose runs chose it."""
    ratios = []
    for r in results:
        if r["found"].get("chosen") and model in r.get("kept", {}):
            told, kept = r["found"]["promised"][model], r["kept"][model]
            ratios.append(np.sqrt(np.prod([kept[key] / told[key] for key in kept])))
    return ratios


def _middle(ratios):
    """Median of ratios with its 95% interval, by order statistics."""
    if len(ratios) < 6:
        return "-"
    ordered = sorted(ratios)
    off = int(np.floor((len(ordered) - 1.96 * np.sqrt(len(ordered))) / 2))
    low, high = ordered[max(off, 0)], ordered[-1 - max(off, 0)]
    return "%.2f (%.2f to %.2f)" % (np.median(ordered), low, high)
