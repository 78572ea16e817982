"""Bad arguments raise at every entry of the core: no crash, no endless loop, no silent number."""

import functools
import json
import os
import signal

import numpy as np
import pytest

from conftest import ROOT
from conftest import nominal as craft
from ground import _core

NAN, INF = float("nan"), float("inf")
BAD = [NAN, INF, -1.0]
LONGEST = 20  # time after which a call counts as endless [s]
REFUSALS = ("ValueError", "IndexError", "RuntimeError", "KeyError", "TypeError", "OverflowError")

FOUR = ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"
BLAST = '{name: blast, expression: {X: "c*u*u*u"}, parameters: {c: {value: 1e9, unit: N s^3/m^3}}}'


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
    given = {
        "name": "run",
        "times": times,
        "eta": found["eta"],
        "nu": found["nu"],
        "inputs": inputs,
        "poses": found["eta"],
        "noise": np.array([1e-3, 1e-3, 1e-2]),
    }
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
    return _core.track_reference(
        model or craft(),
        believed or craft(),
        params,
        np.array(eta, float),
        np.zeros(3),
        mocap or _core.MocapParams(),
        1,
    )


def excite(model=None, believed=None, duration=1.0, room=None, design=None, **returns):
    params = changed_fields(_core.ExcitationParams(), duration=duration, room=room)
    changed_fields(params.design, **(design or {}))
    changed_fields(params.returns, **returns)
    return _core.excite(
        model or craft(), believed or craft(), params, np.zeros(3), np.zeros(3), _core.MocapParams(), 1
    )


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
    rows=((0, 1, 1, 1),), duration=1.0, eta=(0, 0, 0), nu=(0, 0, 0), params=None, model=None, disturbance=None
):
    return _core.play_schedule(
        model or craft(),
        np.array(rows, float),
        duration,
        np.array(eta, float),
        np.array(nu, float),
        params or _core.MocapParams(),
        1,
        disturbance or _core.Disturbance(),
    )


def simulate(model=None, inputs=GOOD.inputs, times=GOOD.times, eta=(0, 0, 0), nu=(0, 0, 0), **other):
    return _core.simulate(model or craft(), inputs, times, np.array(eta, float), np.array(nu, float), **other)


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
        "SimulationError.simulate poses": lambda: error(runs, _core.Target.poses).simulate(craft()),
        "SimulationError.fit": lambda: error(runs).fit(craft(), free, threads=threads),
        "SimulationError.fit poses": lambda: error(runs, _core.Target.poses).fit(
            craft(), free, threads=threads
        ),
        "cut_windows": first(lambda one: _core.cut_windows(one, 0, 0.0, 2.0, 1.0)),
        "predict": first(lambda one: _core.predict(craft(), one, WINDOWS[:1], np.zeros((1, 3)))),
    }


def error(runs, target=_core.Target.velocities):
    firsts = (0, 49, 98, 149)
    spans = [_core.Window(i, first, first + 49) for i in range(len(runs)) for first in firsts]
    return simulation_error(runs, spans, target)


def cases_of_runs():
    for what, runs in bad_runs():
        for entry, call in estimators(runs, 2).items():
            yield "%s of %s" % (entry, what), call


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
        "SimulationError.fit poses": lambda: error(two, _core.Target.poses).fit(model, free, threads=threads),
        "GreyBox.smooth": lambda: box(two).smooth(at, 1),
        "predict": lambda: _core.predict(model, GOOD, WINDOWS[:1], np.ones((1, 3))),
        "simulate": lambda: simulate(model=model, nu=(1, 0, 0)),
        "play_schedule": lambda: play(model=model, nu=(1, 0, 0)),
    }


def cases_of_models():
    """Models that do not belong to the runs, or whose motion is not finite."""
    for what, model in (("four thrusters", four()), ("motion not finite", explosive())):
        for entry, call in entries_of_models(model, 2).items():
            yield "%s, %s" % (entry, what), call
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
    for index in (-1, 1, 2**31 - 1, 2**40):
        yield "sigma %d" % index, lambda i=index: simulation_error().sigma(i)
        yield "residuals of run %d" % index, lambda i=index: box().residuals(point(), i)
        yield "forecast of run %d" % index, lambda i=index: forecast(run=i)
        yield "a window of run %d" % index, lambda i=index: simulation_error(windows=[_core.Window(i, 0, 50)])
    for span in ((-1, 50), (0, 200), (50, 10), (0, 2**31 - 1)):
        yield "a window of %d to %d" % span, lambda s=span: simulation_error(windows=[_core.Window(0, *s)])
        yield (
            "predict %d to %d" % span,
            lambda s=span: _core.predict(craft(), GOOD, [_core.Window(0, *s)], np.zeros((1, 3))),
        )
    yield "forecasts from behind the end", lambda: forecast(starts=[200])


def cases_of_numbers():
    """One number of a call that is otherwise good is wrong."""
    disturbance, life = _core.Disturbance, _core.LifecycleParams
    finite = {
        "eta": lambda v: simulate(eta=(v, 0, 0)),
        "nu": lambda v: simulate(nu=(0, v, 0)),
        "a wrench": lambda v: simulate(wrench=changed(np.zeros((200, 3)), v)),
        "inputs": lambda v: simulate(inputs=changed(GOOD.inputs, v)),
        "a time": lambda v: simulate(times=[0.0, v]),
        "the start of a drive": lambda v: simulate(drives=[v]),
        "inputs of a run": lambda v: run(inputs=changed(GOOD.inputs, v)),
        "a stamp to smooth": lambda v: _core.smooth(
            [0, 0.1, v, 0.3], np.zeros((4, 3)), _core.EstimatorParams()
        ),
        "a pose to smooth": lambda v: _core.smooth(
            [0, 0.1, 0.2, 0.3], changed(np.zeros((4, 3)), v), _core.EstimatorParams()
        ),
        "a played input": lambda v: play(rows=[(0, v, 1, 1)]),
        "the place of a circle": lambda v: tracking(reference=reference(x=v)),
        "a time on a reference": lambda v: reference().sample([0.0, v]),
        "a place in a room": lambda v: room().clearance((v, 0.0)),
        "a pose for the mocap": lambda v: _core.AxisMapping().to_mocap(np.array([v, 0, 0]), 0.0),
        "velocities to predict from": lambda v: _core.predict(craft(), GOOD, WINDOWS, np.full((2, 3), v)),
        "initial states": lambda v: simulation_error().fit(craft(), ["k"], initial=[np.full(3, v)] * 2),
    }
    positive = {
        "a level": lambda v: box().likelihood(point(sigma_X=v)),
        "a level of scores": lambda v: box().scores(point(sigma_X=v), ["k"]),
        "blocks of scores": lambda v: box().scores(point(), ["k"], block=v),
        "the cap of a fit": lambda v: box().fit(point(), ["k"], cap=v),
        "a horizon": lambda v: forecast(horizons=[v]),
        "windows": lambda v: _core.cut_windows(GOOD, 0, 0.0, 2.0, v),
        "a width": lambda v: simulation_error().fit(craft(), ["k"], width=v),
        "a duration": lambda v: play(duration=v),
        "a tracked duration": lambda v: tracking(duration=v),
        "an excited duration": lambda v: excite(duration=v),
        "frames": lambda v: play(params=mocap(rate=v)),
        "noise": lambda v: play(params=mocap(position_noise=v)),
        "loss": lambda v: play(params=mocap(loss=v)),
        "a burst": lambda v: excite(room=room(), burst=v),
        "a clock": lambda v: excite(design={"clock": v}),
        "a margin": lambda v: excite(room=room(margin=v)),
        "a rate of control": lambda v: tracking(life=changed_fields(life(), rate=v)),
        "a disturbance": lambda v: play(disturbance=changed_fields(disturbance(), sigma=np.array([v, 1, 1]))),
        "the mass": lambda v: craft().set_value("m", v),
    }
    for what, call in {**finite, **positive}.items():
        for value in (NAN, -1.0 if what in positive else INF):
            yield "%s is %s" % (what, value), lambda c=call, v=value: c(v)


def cases_of_names():
    """What does not exist, is given twice, or has the wrong size."""
    for free in ([], ["mass"], ["k", "k"]):
        yield "a fit of %s" % free, lambda f=free: simulation_error().fit(craft(), f)
    for kind in ("file", "spiral", ""):
        yield "a reference of kind '%s'" % kind, lambda k=kind: reference(kind=k).extent()
    for name, value in (("levels", [2.0]), ("kind", "noise"), ("order", 99)):
        yield "a design with %s %s" % (name, value), lambda n=name, v=value: excite(design={n: v})
    yield "an absent level", lambda: _core.GreyBoxPoint(craft(), {})
    yield "no windows", lambda: simulation_error(windows=[])
    yield "a craft at rest", lambda: simulation_error(runs=[run(nu=np.zeros((200, 3)))])
    yield "a short wrench", lambda: simulate(wrench=np.zeros((3, 3)))
    yield "descending inputs", lambda: simulate(inputs=np.array(GOOD.inputs)[::-1])
    yield "inputs of a column", lambda: simulate(inputs=np.array(GOOD.inputs)[:, :1])
    yield "three thrusters", lambda: play(rows=[(0, 1, 1, 1, 1)])
    yield "no poses", lambda: _core.smooth([], np.zeros((0, 3)), _core.EstimatorParams())
    yield "a room of two corners", lambda: excite(room=room(corners=[(0, 0), (1, 1)]))
    yield "an axis mapping of nothing", lambda: _core.AxisMapping("")
    yield "a sequence of order 64", lambda: _core.make_prbs(64, 1)
    yield "an unknown controller", lambda: _core.effect_use("magic", craft())
    yield (
        "a controller that flies",
        lambda: tracking(controller=changed_fields(_core.ControllerChoice(), kind="magic")),
    )


CASES = dict(
    pair
    for make in (cases_of_runs, cases_of_models, cases_of_indices, cases_of_numbers, cases_of_names)
    for pair in make()
)


def outcome(call):
    """What a call raises, as 'Type: message'; or 'returned'."""
    try:
        call()
    except BaseException as raised:  # noqa: B036 - reported, not handled
        return "%s: %s" % (type(raised).__name__, raised)
    return "returned"


@functools.lru_cache(maxsize=None)
def outcomes():
    """The outcome of each case, or how the process died in which they run one by one."""
    found, names = {}, list(CASES)
    while len(found) < len(names):
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(read)
            for name in names[len(found) :]:
                signal.alarm(LONGEST)
                os.write(write, json.dumps(outcome(CASES[name])).encode() + b"\n")
            os._exit(0)
        os.close(write)
        with os.fdopen(read) as pipe:
            lines = pipe.read().splitlines()
        _, status = os.waitpid(child, 0)
        found.update(zip(names[len(found) :], map(json.loads, lines)))
        if os.WIFSIGNALED(status):
            found[names[len(found)]] = "died of " + signal.Signals(os.WTERMSIG(status)).name
    return found


@pytest.mark.parametrize("name", list(CASES))
def test_bad_arguments_raise(name):
    found = outcomes()[name]
    kind, _, message = found.partition(": ")
    assert kind in REFUSALS, found
    assert message.strip() and "vector::" not in message, found


def test_good_arguments_do_not():
    """The cases above fail for what they name: the same calls with good arguments work."""
    two = [GOOD, run(name="other")]
    for threads in (1, 2):
        for call in estimators(two, threads).values():
            call()
    for call in (forecast, play, tracking, excite, simulate, lambda: excite(room=room())):
        call()
