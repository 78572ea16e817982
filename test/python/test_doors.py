"""Bad arguments raise at every entry of the core: no crash, no endless loop, no silent number."""
import os
import signal

import numpy as np
import pytest
from conftest import MODEL, ROOT

from ground import _core

NAN, INF = float("nan"), float("inf")
BAD = [NAN, INF, -1.0]
LONGEST = 20  # time after which a call counts as endless [s]
REFUSALS = ("ValueError", "IndexError", "RuntimeError", "KeyError", "TypeError", "OverflowError")

FOUR = ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"
BLAST = '{name: blast, expression: {X: "c*u*u*u"}, parameters: {c: {value: 1e9, unit: N s^3/m^3}}}'


def craft():
    return _core.load_model(str(MODEL))


def four():
    """A craft with four thrusters."""
    return _core.load_model(str(FOUR))


def explosive():
    """A craft whose motion ceases to be finite as soon as it moves."""
    return _core.with_effect(craft(), BLAST, "blast")


def run(count=200, dt=0.01, **other):
    """A run of the craft; `other` replaces what RunData takes."""
    times = np.arange(count) * dt
    bits = np.random.default_rng(3).integers(0, 2, (max(1, count // 10), 2))
    inputs = np.column_stack([np.arange(len(bits)) * 10 * dt, bits, np.ones(len(bits))])
    found = _core.simulate(craft(), inputs, times, np.zeros(3), np.array([0.1, 0.02, 0.1]), [0.0])
    given = {"name": "run", "times": times, "eta": found["eta"], "nu": found["nu"],
             "inputs": inputs, "poses": found["eta"], "noise": np.array([1e-3, 1e-3, 1e-2])}
    given.update(other)
    return _core.RunData(**given)


def changed_fields(params, **changes):
    for name, value in changes.items():
        setattr(params, name, value)
    return params


def changed(rows, value):
    rows = np.array(rows, float)
    rows[len(rows) // 2] = value
    return rows


GOOD = run()
HALF = len(GOOD.times) // 2
WINDOWS = [_core.Window(0, 0, 99), _core.Window(0, 99, 199)]


def bad_runs():
    """Lists of runs that no estimator may accept."""
    swapped = np.array(GOOD.times)
    swapped[[HALF, HALF + 1]] = swapped[[HALF + 1, HALF]]
    short = GOOD.eta[:-1]
    empty = np.zeros((0, 3))
    for name, one in {
        "descending times": run(times=swapped),
        "reversed times": run(times=GOOD.times[::-1]),
        "a NaN time": run(times=changed(GOOD.times, NAN)),
        "an infinite time": run(times=np.append(GOOD.times[:-1], INF)),
        "only a NaN time": run(times=[NAN], eta=GOOD.eta[:1], nu=GOOD.nu[:1], poses=GOOD.eta[:1]),
        "NaN poses": run(poses=changed(GOOD.eta, NAN)),
        "NaN eta": run(eta=changed(GOOD.eta, NAN)),
        "NaN nu": run(nu=changed(GOOD.nu, NAN)),
        "infinite poses": run(poses=changed(GOOD.eta, INF)),
        "short poses": run(poses=short),
        "short eta": run(eta=short),
        "short nu": run(nu=short),
        "no samples": run(times=[], eta=empty, nu=empty, poses=empty),
        "zero noise": run(noise=np.zeros(3)),
        "NaN noise": run(noise=np.array([1e-3, NAN, 1e-3])),
        "infinite noise": run(noise=np.array([1e-3, INF, 1e-3])),
    }.items():
        yield name, [one]
        yield name + " beside a good run", [GOOD, one]
    yield "no runs", []


def box(runs=(GOOD,), **options):
    return _core.GreyBox(list(runs), craft(), **options)


def simulation_error(runs=(GOOD,), windows=WINDOWS, target=_core.Target.velocities):
    return _core.SimulationError(list(runs), windows, target)


def point(model=None, **changes):
    """The start of the likelihood's search with changed levels or loudness."""
    first = box().start(model or craft())
    loudness = changes.pop("loudness", [])
    return _core.GreyBoxPoint(first.model, {**first.levels, **changes}, loudness)


def tracking(model=None, believed=None, eta=(0, 0, 0), mocap=None, **changes):
    params = changed_fields(_core.TrackingParams(), **{"duration": 1.0, **changes})
    return _core.track_reference(model or craft(), believed or craft(), params, np.array(eta, float),
                                 np.zeros(3), mocap or _core.MocapParams(), 1)


def excite(model=None, believed=None, duration=1.0, room=None, design=None, **returns):
    params = changed_fields(_core.ExcitationParams(), duration=duration, room=room)
    changed_fields(params.design, **(design or {}))
    changed_fields(params.returns, **returns)
    return _core.excite(model or craft(), believed or craft(), params, np.zeros(3), np.zeros(3),
                        _core.MocapParams(), 1)


def mocap(**changes):
    return changed_fields(_core.MocapParams(), **changes)


def room(**changes):
    return changed_fields(_core.RoomPlan(), **changes)


def reference(**changes):
    return changed_fields(_core.ReferenceParams(), **changes)


def forecast(model=None, **changes):
    given = {"run": 0, "starts": [50], "horizons": [0.3], "draws": 19, **changes}
    return box().forecast(point(model), **given)


def play(
    rows=((0, 1, 1, 1),), duration=1.0, eta=(0, 0, 0), nu=(0, 0, 0), params=None, model=None,
    disturbance=None,
):
    return _core.play_schedule(model or craft(), np.array(rows, float), duration,
                               np.array(eta, float), np.array(nu, float),
                               params or _core.MocapParams(), 1, disturbance or _core.Disturbance())


def simulate(model=None, inputs=GOOD.inputs, times=GOOD.times, eta=(0, 0, 0), nu=(0, 0, 0), **other):
    return _core.simulate(model or craft(), inputs, times, np.array(eta, float),
                          np.array(nu, float), **other)


def estimators(runs, threads):
    """Every entry that takes runs, by name."""
    free = ["k", "X_u"]

    def grey(use):
        return lambda: use(box(runs))

    def first(use):
        return lambda: [use(one) for one in runs] or _core.GreyBox([], craft())

    return {
        "GreyBox.fit": grey(lambda b: b.fit(point(), free, threads=threads)),
        "GreyBox.likelihood": grey(lambda b: b.likelihood(point(), threads=threads)),
        "GreyBox.scores": grey(lambda b: b.scores(point(), free, threads=threads)),
        "GreyBox.residuals": grey(lambda b: [b.residuals(point(), i) for i in range(len(runs))]),
        "SimulationError.simulate": lambda: error(runs).simulate(craft()),
        "SimulationError.simulate poses":
            lambda: error(runs, _core.Target.poses).simulate(craft()),
        "SimulationError.fit": lambda: error(runs).fit(craft(), free, threads=threads),
        "SimulationError.fit poses":
            lambda: error(runs, _core.Target.poses).fit(craft(), free, threads=threads),
        "WrenchFilter": first(lambda one: _core.WrenchFilter(craft(), one)),
        "cut_windows": first(lambda one: _core.cut_windows(one, 0, 0.0, 2.0, 1.0)),
        "predict": first(lambda one: _core.predict(craft(), one, WINDOWS[:1], np.zeros((1, 3)))),
    }


def error(runs, target=_core.Target.velocities):
    firsts = (0, 49, 98, 149)
    spans = [_core.Window(i, first, first + 49) for i in range(len(runs)) for first in firsts]
    return simulation_error(runs, spans, target)


def cases_of_runs():
    for what, runs in bad_runs():
        for threads in (1, 2):
            for entry, call in estimators(runs, threads).items():
                yield "%s of %s, %d threads" % (entry, what, threads), call


def entries_of_models(model, threads):
    """Every entry that takes a model and runs of a craft with two thrusters, by name."""
    at, free, two = point(model), ["k", "X_u"], [GOOD, GOOD]
    known = box(two).fit(point(), free)["level_information"]
    return {
        "GreyBox.fit": lambda: box(two).fit(at, free, threads=threads),
        "GreyBox.likelihood": lambda: box(two).likelihood(at, threads=threads),
        "GreyBox.scores": lambda: box(two).scores(at, free, threads=threads),
        "GreyBox.intervals": lambda: box(two).intervals(at, known, free, threads=threads),
        "GreyBox.residuals": lambda: box(two).residuals(at, 1),
        "GreyBox.forecast": lambda: box(two).forecast(at, 1, [50], [0.3]),
        "SimulationError.simulate": lambda: error(two).simulate(model),
        "SimulationError.fit": lambda: error(two).fit(model, free, threads=threads),
        "SimulationError.fit poses":
            lambda: error(two, _core.Target.poses).fit(model, free, threads=threads),
        "WrenchFilter": lambda: _core.WrenchFilter(model, GOOD),
        "predict": lambda: _core.predict(model, GOOD, WINDOWS[:1], np.ones((1, 3))),
        "simulate": lambda: simulate(model=model, nu=(1, 0, 0)),
        "play_schedule": lambda: play(model=model, nu=(1, 0, 0)),
    }


def cases_of_models():
    """Models that do not belong to the runs, or whose motion is not finite."""
    for what, model in (("four thrusters", four()), ("motion not finite", explosive())):
        for threads in (1, 2):
            for entry, call in entries_of_models(model, threads).items():
                yield "%s, %s, %d threads" % (entry, what, threads), call
    yield "track_reference by a model of other thrusters", lambda: tracking(four(), craft())
    yield "excite by a model of other thrusters", lambda: excite(four(), craft())
    yield "forces of other thrusters", lambda: four().forces(np.ones((3, 2)))
    for value in BAD:
        yield "set_value %s" % value, lambda value=value: craft().set_value("m", value)
    yield "set_value of an unknown parameter", lambda: craft().set_value("mass", 1)
    yield "value of an unknown parameter", lambda: craft().value("mass")
    yield "penalty of an unknown parameter", lambda: craft().penalty(["mass"])
    yield "an unknown effect", lambda: craft().add_effect("magic")
    yield "remove an absent effect", lambda: craft().remove_effect("wind")
    yield "forces NaN", lambda: craft().forces(np.array([[NAN, 0]]))


def cases_of_indices():
    for index in (-1, 1, 50, 2**31 - 1, -2**31, 2**40):
        yield "sigma %d" % index, lambda i=index: simulation_error().sigma(i)
        yield "residuals of run %d" % index, lambda i=index: box().residuals(point(), i)
        yield "forecast of run %d" % index, lambda i=index: forecast(run=i)
        yield "a window of run %d" % index, \
            lambda i=index: simulation_error(windows=[_core.Window(i, 0, 50)])
    for span in ((-1, 50), (0, 200), (50, 50), (50, 10), (0, 2**31 - 1), (-2**31, 50)):
        yield "a window of %d to %d" % span, \
            lambda s=span: simulation_error(windows=[_core.Window(0, *s)])
        if span[0] != span[1]:
            yield "predict %d to %d" % span, lambda s=span: _core.predict(
                craft(), GOOD, [_core.Window(0, *s)], np.zeros((1, 3)))
    yield "a forecast from sample -1", lambda: forecast(starts=[-1])
    yield "a forecast from behind the end", lambda: forecast(starts=[200])
    yield "descending starts of forecasts", lambda: forecast(starts=[60, 50], horizons=[1, 1])


def cases_of_likelihood():
    level = "sigma_X"
    entries = {
        "likelihood": lambda at: box().likelihood(at),
        "fit": lambda at: box().fit(at, ["k"]),
        "scores": lambda at: box().scores(at, ["k"]),
        "residuals": lambda at: box().residuals(at, 0),
        "forecast": lambda at: box().forecast(at, 0, [50], [0.3]),
    }
    for name, call in entries.items():
        for value in BAD:
            yield "%s with a level of %s" % (name, value), \
                lambda c=call, v=value: c(point(**{level: v}))
        for level_at_0 in ("time_X", "position", "heading"):
            yield "%s with %s 0" % (name, level_at_0), \
                lambda c=call, n=level_at_0: c(point(**{n: 0.0}))
        for loudness in ([NAN], [INF], [0.0, 0.0], [1e4]):
            yield "%s with loudness %s" % (name, loudness), \
                lambda c=call, v=loudness: c(point(loudness=v))
    yield "loudness of one of two runs", lambda: box([GOOD, GOOD]).likelihood(point(loudness=[0.0]))
    yield "an absent level", lambda: _core.GreyBoxPoint(craft(), {})
    for value in (NAN, -1.0, 0.0):
        yield "likelihood in blocks of %s s" % value, \
            lambda v=value: box().likelihood(point(), block=v)
        yield "scores in blocks of %s s" % value, lambda v=value: box().scores(point(), ["k"], block=v)
        yield "gaps of %s s" % value, lambda v=value: box(max_gap=v)
        yield "gaps of %s s in WrenchFilter" % value, \
            lambda v=value: _core.WrenchFilter(craft(), GOOD, v)
    for value in (NAN, -1.0, 0.0):
        yield "cap %s of likelihood" % value, lambda v=value: box().likelihood(point(), cap=v)
        yield "cap %s of fit" % value, lambda v=value: box().fit(point(), ["k"], cap=v)
        yield "cap %s of scores" % value, lambda v=value: box().scores(point(), ["k"], cap=v)
        yield "cap %s of residuals" % value, lambda v=value: box().residuals(point(), 0, cap=v)
        yield "cap %s of forecast" % value, lambda v=value: forecast(cap=v)
    yield "a fit from a level of 0", lambda: box().fit(point(sigma_X=0.0), ["k"])
    yield "an unknown free parameter", lambda: box().fit(point(), ["mass"])
    yield "a parameter named twice", lambda: box().fit(point(), ["k", "k"])
    yield "an unknown level held", lambda: box().fit(point(), ["k"], held=["loud"])
    yield "-1 iterations", lambda: box().fit(point(), ["k"], max_iterations=-1)
    size = 13
    good = box().fit(point(), ["k"])["level_information"]
    for name, bad in {"small": good[:size, :size - 1], "not square": good[:, :-1],
                      "empty": np.zeros((0, 0)), "NaN": good * NAN}.items():
        yield "intervals with %s level information" % name, \
            lambda b=bad: box().intervals(point(), b, ["k"])
    yield "intervals with an unknown level held", \
        lambda: box().intervals(point(), good, ["k"], held=["loud"])


def cases_of_simulation_error():
    free = ["k", "X_u"]
    for name, options in {
        "no free parameter": {"free": []}, "an unknown parameter": {"free": ["mass"]},
        "a parameter twice": {"free": ["k", "k"]}, "no starts": {"starts": 0},
        "-1 starts": {"starts": -1}, "NaN width": {"width": NAN}, "negative width": {"width": -1.0},
        "too few initial states": {"initial": [np.zeros(3)]},
        "long initial states": {"initial": [np.zeros(6)] * 2},
        "NaN initial states": {"initial": [np.full(3, NAN)] * 2},
    }.items():
        for threads in (1, 2):
            yield "fit with %s, %d threads" % (name, threads), lambda o=options, t=threads: \
                simulation_error().fit(craft(), **{"free": free, "threads": t, **o})
    yield "no windows", lambda: simulation_error(windows=[])
    yield "no runs, but windows", lambda: simulation_error(runs=[])
    yield "a craft at rest", lambda: simulation_error(runs=[run(nu=np.zeros((200, 3)))])
    for name, nu in {"too few": np.zeros((1, 3)), "NaN": np.full((2, 3), NAN),
                     "infinite": np.full((2, 3), INF)}.items():
        yield "predict from %s velocities" % name, \
            lambda n=nu: _core.predict(craft(), GOOD, WINDOWS, n)
    for value in (NAN, -1.0, 0.0):
        yield "windows of %s s" % value, lambda v=value: _core.cut_windows(GOOD, 0, 0.0, 2.0, v)
        yield "windows with gaps of %s s" % value, \
            lambda v=value: _core.cut_windows(GOOD, 0, 0.0, 2.0, 1.0, v)
    yield "windows until NaN", lambda: _core.cut_windows(GOOD, 0, 0.0, NAN, 1.0)
    yield "windows from NaN", lambda: _core.cut_windows(GOOD, 0, NAN, 2.0, 1.0)


def cases_of_inputs():
    good = np.array(GOOD.inputs)
    for name, rows in {
        "descending": good[::-1], "NaN": changed(good, NAN), "without thrusters": good[:, :2],
        "of a column": good[:, :1], "of many thrusters": np.zeros((3, 60)),
    }.items():
        yield "a run with inputs " + name, lambda r=rows: run(inputs=r)
        yield "simulate inputs " + name, lambda r=rows: simulate(inputs=r)
        yield "play inputs " + name, lambda r=rows: play(rows=r)
    for name, drives in {"descending": [1.0, 0.0], "NaN": [NAN], "infinite": [INF]}.items():
        yield "a run with drives " + name, lambda d=drives: run(drives=d)
        yield "simulate drives " + name, lambda d=drives: simulate(drives=d)
    for name, times in {
        "no": [], "descending": [0.0, 0.2, 0.1], "NaN": [0.0, NAN], "first NaN": [NAN, 0.1],
        "infinite": [0.0, INF],
    }.items():
        yield "simulate at %s times" % name, lambda t=times: simulate(times=t)
    for value in (NAN, INF):
        yield "simulate from eta %s" % value, lambda v=value: simulate(eta=(v, 0, 0))
        yield "simulate from nu %s" % value, lambda v=value: simulate(nu=(0, v, 0))
        yield "simulate with wrench %s" % value, \
            lambda v=value: simulate(wrench=changed(np.zeros((200, 3)), v))
        yield "drive starts at %s" % value, lambda v=value: _core.drive_starts([0, v, 2], [1, 1, 1])
        yield "drive starts with lift %s" % value, \
            lambda v=value: _core.drive_starts([0, 1, 2], [1, v, 1])
        yield "smooth at stamp %s" % value, lambda v=value: _core.smooth(
            [0, 0.1, v, 0.3], np.zeros((4, 3)), _core.EstimatorParams())
        yield "smooth a pose of %s" % value, lambda v=value: _core.smooth(
            [0, 0.1, 0.2, 0.3], changed(np.zeros((4, 3)), v), _core.EstimatorParams())
    yield "simulate with a short wrench", lambda: simulate(wrench=np.zeros((3, 3)))
    yield "drive starts of other lengths", lambda: _core.drive_starts([0, 1], [1])
    yield "smooth no poses", lambda: _core.smooth([], np.zeros((0, 3)), _core.EstimatorParams())
    yield "smooth descending stamps", lambda: _core.smooth(
        [0, 0.2, 0.1], np.zeros((3, 3)), _core.EstimatorParams())
    yield "smooth other lengths", lambda: _core.smooth(
        [0, 0.1, 0.2], np.zeros((4, 3)), _core.EstimatorParams())


def cases_of_places():
    bad_rooms = {"no corners": room(corners=[]), "two corners": room(corners=[(0, 0), (1, 1)]),
                 "a NaN corner": room(corners=[(0, 0), (1, 0), (NAN, 1)]),
                 "NaN margin": room(margin=NAN), "no braking": room(braking=0.0)}
    for name, plan in bad_rooms.items():
        yield "leaves_room of %s" % name, lambda p=plan: _core.leaves_room(reference(), p)
        yield "track in a room of %s" % name, lambda p=plan: tracking(room=p)
        yield "excite in a room of %s" % name, lambda p=plan: excite(room=p)
        if "corner" in name:
            yield "clearance in a room of %s" % name, lambda p=plan: p.clearance((0.0, 0.0))
    for name in ("size", "rate_of_turn", "x", "y"):
        for value in (NAN, INF):
            bad = reference(**{name: value})
            yield "extent of %s %s" % (name, value), lambda b=bad: b.extent()
            yield "track %s %s" % (name, value), lambda b=bad: tracking(reference=b)
            yield "leaves_room of %s %s" % (name, value), lambda b=bad: _core.leaves_room(b, room())
    for kind in ("file", "spiral", ""):
        yield "a reference of kind '%s'" % kind, lambda k=kind: reference(kind=k).extent()
        yield "infeasibility of kind '%s'" % kind, \
            lambda k=kind: reference(kind=k).infeasibility(craft())
    for value in (NAN, INF, -INF):
        yield "clearance of %s" % value, lambda v=value: room().clearance((v, 0.0))
        yield "a reference at %s s" % value, lambda v=value: reference().sample([0.0, v])
    yield "a NaN home", lambda: _core.leaves_room(reference(), room(home=(NAN, 0)))
    yield "an axis mapping of nothing", lambda: _core.AxisMapping("")
    yield "an axis mapping with offset NaN", lambda: _core.AxisMapping("x, z, -y", NAN)
    for value in (NAN, INF):
        yield "a pose of %s to the mocap" % value, \
            lambda v=value: _core.AxisMapping().to_mocap(np.array([v, 0, 0]), 0.0)
    yield "poses and quaternions of other lengths", lambda: _core.AxisMapping().to_planar_rows(
        np.zeros((2, 3)), np.zeros((3, 4)))


def cases_of_experiments():
    for value in (NAN, INF, -1.0, 0.0):
        yield "play for %s s" % value, lambda v=value: play(duration=v)
        yield "track for %s s" % value, lambda v=value: tracking(duration=v)
        yield "excite for %s s" % value, lambda v=value: excite(duration=v)
        yield "a design of %s s" % value, lambda v=value: _core.make_design(_core.DesignParams(), v)
        yield "mocap at %s Hz" % value, lambda v=value: play(params=mocap(rate=v))
        yield "a burst of %s s" % value, lambda v=value: excite(room=room(), burst=v)
        yield "a clock of %s Hz" % value, lambda v=value: excite(design={"clock": v})
    for name in ("position_noise", "heading_noise", "latency", "loss", "gap_rate", "gap_length"):
        for value in BAD:
            yield "mocap with %s %s" % (name, value), \
                lambda n=name, v=value: play(params=mocap(**{n: v}))
    for value in (NAN, INF):
        yield "play from eta %s" % value, lambda v=value: play(eta=(0, v, 0))
        yield "play from nu %s" % value, lambda v=value: play(nu=(0, v, 0))
        yield "track from eta %s" % value, lambda v=value: tracking(eta=(0, v, 0))
        for name in ("sigma", "time", "white", "trim"):
            yield "play with a disturbance of %s %s" % (name, value), \
                lambda n=name, v=value: play(disturbance=changed_fields(
                    _core.Disturbance(), **{"sigma": np.ones(3), n: np.array([v, 1, 1])}))
        for name in ("lift", "lift_time", "state_timeout", "recovery_time", "rate"):
            yield "track with %s %s" % (name, value), lambda n=name, v=value: tracking(
                life=changed_fields(_core.LifecycleParams(), **{n: v}))
        for name in ("start", "tail", "max_error"):
            if (name, value) != ("max_error", INF):
                yield "track with %s %s" % (name, value), \
                    lambda n=name, v=value: tracking(**{n: v})
        for name in ("position_noise", "linear_jerk", "max_gap"):
            yield "smooth with %s %s" % (name, value), lambda n=name, v=value: _core.smooth(
                [0, 0.1, 0.2], np.zeros((3, 3)), changed_fields(_core.EstimatorParams(), **{n: v}))
    yield "an unknown controller flies", lambda: tracking(
        controller=changed_fields(_core.ControllerChoice(), kind="magic"))
    yield "a controller with a gain of NaN", lambda: tracking(
        controller=changed_fields(_core.ControllerChoice(), values={"k_e": NAN}))
    yield "windows of run -1", lambda: _core.cut_windows(GOOD, -1, 0.0, 2.0, 1.0)
    yield "play an input of 2", lambda: play(rows=[(0, 2, 1, 1)])
    yield "play for three thrusters", lambda: play(rows=[(0, 1, 1, 1, 1)])
    yield "play no input", lambda: play(rows=np.zeros((0, 1)))
    for order in (-1, 0, 1, 64, 10**6):
        yield "a sequence of order %d" % order, lambda o=order: _core.make_prbs(o, 1)
    for name, value in (("levels", [NAN]), ("levels", [2.0]), ("kind", "noise"),
                        ("order", 0), ("order", 99), ("hold", NAN), ("file", "/nowhere.csv")):
        changes = {"kind": "file"} if name == "file" else {}
        yield "a design with %s %s" % (name, value), \
            lambda n=name, v=value, c=changes: excite(design={**c, n: v})
    yield "an unknown controller", lambda: _core.effect_use("magic", craft())


CASES = dict(pair for make in (
    cases_of_runs, cases_of_models, cases_of_indices, cases_of_likelihood,
    cases_of_simulation_error, cases_of_inputs, cases_of_places, cases_of_experiments,
) for pair in make())


def outcome(call):
    """What a call raises, as 'Type: message'; how its process died; or 'returned'."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        signal.alarm(LONGEST)
        text = "returned"
        try:
            call()
        except BaseException as raised:  # noqa: B036 - reported, not handled
            text = "%s: %s" % (type(raised).__name__, raised)
        os.write(write, text.encode()[:2000])
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        text = pipe.read().decode(errors="replace")
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return "died of " + signal.Signals(os.WTERMSIG(status)).name
    return text


@pytest.mark.parametrize("name", list(CASES))
def test_bad_arguments_raise(name):
    found = outcome(CASES[name])
    kind, _, message = found.partition(": ")
    assert kind in REFUSALS, found
    assert message.strip() and "vector::" not in message, found


def test_good_arguments_do_not():
    """The cases above fail for what they name: the same calls with good arguments work."""
    two = [GOOD, run(name="other")]
    for threads in (1, 2):
        for entry, call in estimators(two, threads).items():
            assert outcome(call) == "returned", entry
    for call in (forecast, play, tracking, excite, simulate,
                 lambda: excite(room=room())):
        assert outcome(call) == "returned"
