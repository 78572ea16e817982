"""The Python API: its examples, its types, and what importing it loads."""

import ast
import dataclasses
import doctest
import html
import importlib
import inspect
import json
import pickle
import pydoc
import re
import subprocess
import sys
import traceback
import typing
import warnings

import numpy as np
import pandas
import pytest

import ground
from conftest import MODEL, ROOT, slow, write_bag
from ground.support import docstrings
from ground.support.public import HOMES

GAINS = ROOT / "cfg" / "gains" / "tiny_whoover.yaml"
ROOM = ROOT / "cfg" / "room" / "room_4x4.yaml"
MODULES = sorted(set(HOMES.values()))


@pytest.mark.parametrize(
    "name",
    [
        # its examples are two whole discoveries
        pytest.param(name, marks=slow if name == "ground.discovery.discover" else ())
        for name in MODULES
    ],
)
def test_examples_hold(name, flown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    files = {
        "ground": ground,
        "np": np,
        "bag": str(flown),
        "model_file": str(MODEL),
        "room_file": str(ROOM),
        "gains_file": str(GAINS),
    }
    assert doctest.testmod(module, extraglobs=files).failed == 0


# What numpydoc.validate finds: sections, the summary, and each parameter of the signature with type and text
RULES = set("GL06 GL07 SS01 SS03 PR01 PR02 PR04 PR05 PR06 PR07 PR09 PR10 RT02".split())


@pytest.mark.parametrize("name", ground.__all__)
def test_a_public_docstring_is_of_numpys_style(name):
    from numpydoc.docscrape import FunctionDoc
    from numpydoc.validate import validate

    public = getattr(ground, name)
    methods = inspect.getmembers(public, inspect.isroutine) if inspect.isclass(public) else []
    shown = {name: public}
    for one, method in methods:
        of_ground = str(getattr(method, "__module__", "")).startswith("ground.") and not one.startswith("_")
        if of_ground and not docstrings.is_internal(method):
            shown[name + "." + one] = method
    assert ">>>" in public.__doc__
    for one, value in shown.items():
        errors = [text for code, text in validate("ground." + one)["errors"] if code in RULES]
        if inspect.isclass(value):  # fields and results, which users do not make, have no Parameters
            errors = [text for text in errors if "\nParameters\n" in value.__doc__]
        else:
            found, signature = FunctionDoc(value), inspect.signature(value)
            if signature.return_annotation is not None and not found["Returns"]:
                errors.append("nothing says what it returns")
            raises = re.search(r"^ +raise ", inspect.getsource(value), re.M)
            if (raises or signature.parameters and value is public) and not found["Raises"]:
                errors.append("nothing says what it raises")
        assert not errors, one


def test_every_field_of_a_public_class_has_its_meaning_beside_it():
    from sphinx.pycode import ModuleAnalyzer

    for kind in filter(dataclasses.is_dataclass, (getattr(ground, name) for name in ground.__all__)):
        known = set()
        for base in kind.__mro__:
            if base.__module__.startswith("ground."):
                of_module = ModuleAnalyzer.for_module(base.__module__).find_attr_docs()
                known |= {field for owner, field in of_module if owner == base.__name__}
        assert {field.name for field in dataclasses.fields(kind)} <= known, kind
        assert known <= {row.split(" : ")[0] for row in kind.__doc__.splitlines()}, kind
    assert "\ncondition : float\n    condition number of the scaled" in inspect.getdoc(ground.Fit)


def test_completion_offers_no_internals():
    offered = dir(ground.Effect("wind"))
    assert {"to_frame", "summary", "name"} <= {*offered} and not {"lines", "headline", "of"} & {*offered}


def test_the_types_of_a_verb_can_be_evaluated():
    assert typing.get_type_hints(ground.fit)["return"] is ground.Fit


def test_every_public_name_has_a_home():
    assert sorted(HOMES) == sorted(ground.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = ground.fitt


@pytest.mark.parametrize(
    "wrong,words",
    [
        (lambda craft: craft["kk"], "no parameter 'kk'"),
        (lambda craft: craft.unit("kk"), "no parameter 'kk'"),
        (lambda craft: craft.with_values(kk=2), "no parameter 'kk'"),
        (lambda craft: craft.with_values({"kk": 2}), "no parameter 'kk'"),
        (lambda craft: ground.fit(["run.bag"], craft), "a model.* not list"),
        (lambda craft: ground.compare(craft, craft), "a recording.* not Model"),
        (lambda craft: ground.read([craft]), "a recording.* not Model"),
        (lambda craft: ground.diagnose(3, "run.bag"), "a model.* not int"),
        (lambda craft: craft + 3, "an effect.* not int"),
        (lambda craft: ground.Room.load(None), "a room.* not NoneType"),
    ],
)
def test_a_slip_is_one_clear_line(wrong, words):
    with pytest.raises(ground.GroundError, match=words) as error:
        wrong(ground.Model.load(MODEL))
    assert "\n" not in str(error.value)
    assert "".join(traceback.format_exception(None, error.value, None)).count(str(error.value)) == 1


def test_a_model_that_comes_with_ground_is_loaded_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    craft = ground.Model.load("tiny_whoover")
    assert craft == ground.Model.load(MODEL)
    assert ground.Model.load("propeller_ship").effects
    with pytest.raises(ground.GroundError, match="did you mean tiny_whoover.*free_flyer"):
        ground.Model.load("tiny_hoover")
    craft.with_values(k=0.07).save("tiny_whoover")  # a file here comes first
    assert ground.Model.load("tiny_whoover")["k"] == 0.07


def test_results_have_the_names_of_statsmodels():
    fit = ground.fit(MODEL, ground.simulate(MODEL, "prbs", duration=6, seed=1), free=["k", "N_r"])
    assert list(fit.params) == [fit.model["k"], fit.model["N_r"]] and list(fit.bse.index) == ["k", "N_r"]
    assert (fit.bse.values == fit.to_frame()["std_error"].values).all() and (fit.bse > 0).all()
    for name in ("llf", "aic", "bic"):
        with pytest.raises(ground.GroundError, match="no likelihood; a diagnosis"):
            getattr(fit, name)


def test_a_diagnosis_has_a_likelihood_and_estimates(tmp_path):
    craft = ground.Model.load(MODEL).with_effect("yaw_bias", n0=2e-4)
    run = ground.simulate(craft, "prbs", duration=12, seed=2)
    with_it, without = (ground.diagnose(MODEL, run, only=[name]) for name in ("yaw_bias", "motor_lag"))
    assert with_it.effects == ("yaw_bias",) and not without.effects
    gain = with_it.llf - without.llf
    assert gain > 10 and with_it.aic < without.aic and with_it.bic < without.bic
    assert with_it.aic - without.aic == pytest.approx(2 - 2 * gain)
    assert " mN m (95%: " in with_it.to_frame().loc["yaw_bias", "estimates"]
    assert with_it.params["yaw_bias.n0"] == with_it.improved["yaw_bias.n0"]
    with_it.save(tmp_path / "saved")
    assert ground.load(tmp_path / "saved").bic == with_it.bic


# A system without what only Unix has, and without nodes. Libraries load first: they choose by the system.
ELSEWHERE = """
import concurrent.futures, importlib, multiprocessing, os, signal, socket, subprocess, sys, tempfile, time
import argcomplete, cmaes, jinja2, jsonschema, numpy, pandas, plotly.graph_objects, plotly.io
import rosbags.highlevel, scipy.optimize, scipy.signal, scipy.stats, tqdm, yaml
UNIX = {
    os: "fork forkpty getegid geteuid getgid getloadavg getpgid getpgrp getuid killpg mkfifo nice openpty "
    "pipe2 posix_fadvise pread sched_getaffinity sched_setaffinity setpgid setsid statvfs sysconf uname "
    "wait wait3 O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK O_SYNC",
    signal: "SIGALRM SIGCHLD SIGHUP SIGKILL SIGPIPE SIGQUIT SIGTSTP SIGUSR1 SIGUSR2 SIGWINCH alarm pause "
    "pthread_sigmask setitimer sigwait",
    socket: "AF_UNIX SO_REUSEPORT socketpair",
    time: "clock_gettime tzset CLOCK_MONOTONIC CLOCK_REALTIME",
}
for module, names in UNIX.items():
    for name in names.split():
        vars(module).pop(name)
for name in "fcntl grp pty pwd readline resource rosbag rospy syslog termios tty".split():
    sys.modules[name] = None
multiprocessing.set_start_method("spawn")
model, *modules = sys.argv[1:]
for name in modules:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in ("casadi", "foxglove", "google", "pyulog", "xarray"):  # the wheel's options
            raise
import ground
from ground.data import measured
measured.WORTH_REPAIRING = 0
runs = [ground.simulate(model, "prbs", duration=8, seed=s, name="run %d" % s) for s in (1, 2)]
print(ground.fit(model, runs, free=["k"]).parameters["k"].ci95)
"""


def test_all_of_the_wheel_imports_and_fits_on_a_system_that_is_not_unix():
    package = ROOT / "src" / "ground" / "python" / "ground"
    paths = [path.relative_to(package.parent).with_suffix("") for path in sorted(package.rglob("*.py"))]
    wheel = [".".join(path.parts) for path in paths if path.parts[1] != "nodes" and path.name != "__init__"]
    assert len(wheel) > 100
    command = [sys.executable, "-c", ELSEWHERE, str(MODEL), *wheel]
    low, high = ast.literal_eval(subprocess.check_output(command, text=True))
    true = ground.Model.load(MODEL).to_frame().loc["k", "value"]
    assert 0.95 * true < low < high < 1.05 * true


def test_results_are_frozen_and_show_themselves(flown):
    found = ground.fit(MODEL, flown, free=["k"])
    with pytest.raises(AttributeError):
        found.objective = 0.0
    assert "95% interval" in repr(found) and "held out" in found.summary()
    page = found._repr_html_()
    assert "<table" in page and "low" in page
    assert "Prediction after" in page and html.escape("ground.diagnose(fit.model") in page
    frame = found.to_frame()
    assert frame.loc["k", "low"] < frame.loc["k", "value"] < frame.loc["k", "high"]
    assert ground.Model.load(MODEL).to_frame().loc["m", "unit"] == "kg"


def test_a_model_never_changes():
    craft = ground.Model.load(MODEL)
    text = craft.format()
    changed = craft.with_values({"k": 0.1}).with_effect("motor_lag", tau=0.05)
    assert changed["motor_lag.tau"] == 0.05 and changed.without_effect("motor_lag")["k"] == 0.1
    assert craft.format() == text and changed.path == ""
    for wrong in (
        lambda: craft.with_values({"nope": 1.0}),
        lambda: craft.with_effect("nope"),
        lambda: craft.without_effect("motor_lag"),
        lambda: ground.Model.load("nothing.yaml"),
        lambda: ground.Model.parse("nonsense: 1"),
    ):
        with pytest.raises(ground.GroundError):
            wrong()


def test_arrays_and_tables_drive_a_craft():
    times = np.arange(0, 5, 0.5)
    rows = np.column_stack([times, 0.5 + 0.5 * np.sin(times), times < 2])
    without = ground.simulate(MODEL, inputs=rows, lift=0.8)
    assert set(np.unique(without.lift)) == {0.0, 0.8}
    lifted = ground.simulate(MODEL, inputs=np.column_stack([rows, np.ones(len(times))]))
    frame = lifted.to_frame()
    again = ground.simulate(MODEL, inputs=frame)
    assert np.abs(again.truth_eta[-1] - lifted.truth_eta[-1]).max() < 0.2
    assert set(lifted.controls[:, 0]) == {0.0, *rows[:-1, 1]}  # the last row ends it
    for wrong, words in (
        (rows[:, :2], "shape"),
        (2 * rows, "range"),
        (rows[::-1], "ascend"),
        ("prbs", "not numbers"),
        (frame.drop(columns="left"), "no column left"),
    ):
        with pytest.raises(ground.GroundError, match=words):
            ground.simulate(MODEL, inputs=wrong)
    with pytest.raises(ground.OptionError, match="lift .* input array"):
        ground.simulate(MODEL, inputs=frame, lift=0.5)


def test_errors_name_arguments_as_python_has_them(flown):
    cases = {
        "burst needs room": dict(burst=3.0),
        "clock does not fit input tracking": dict(input="tracking", clock=3.0),
        "lift: 2 is not between 0 and 1": dict(lift=2.0),
        "'sing' is neither one of": dict(input="sing"),
        "disturbance accepts a SHARE": dict(disturbance=(3.0, 1.0)),
    }
    for message, options in cases.items():
        with pytest.raises(ground.OptionError) as error:
            ground.simulate(MODEL, **options)
        assert str(error.value).startswith(message)
    with pytest.raises(ground.OptionError, match="objective must be one of"):
        ground.fit(MODEL, flown, objective="beauty")
    with pytest.raises(ground.GroundError, match="the same bag is given twice"):
        ground.read([flown, flown])
    with pytest.raises(ground.GroundError, match="both for the fit and as holdout"):
        ground.fit(MODEL, flown, holdout=[flown])


def test_a_warning_points_at_the_callers_line(tmp_path):
    bag = write_bag(tmp_path / "short.bag", duration=4)
    odd = tmp_path / "odd.yaml"
    odd.write_text(MODEL.read_text().replace("m: 0.0583", "m: 583"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ground.fit(odd, bag, free=["k"])
    mine = [w for w in caught if issubclass(w.category, ground.GroundWarning)]
    assert mine and all(w.filename == __file__ for w in mine)
    assert any("m" in str(w.message) for w in mine)


def test_the_notebook_runs_and_finds_the_hidden_effect(monkeypatch):
    notebook = ROOT / "docs" / "notebooks" / "demo.ipynb"
    monkeypatch.chdir(notebook.parent)
    names = {}
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "clear the outputs before a commit"
            show(cell["source"], names)
    assert names["diagnosis"].effects == ("thrust_asymmetry",)
    low, high = names["added"].parameters["thrust_asymmetry.a"].ci95
    assert low < 0.1 < high
    assert names["verdict"].best == "Tiny Whoover with thrust_asymmetry"
    before, after = names["_"]
    assert after < 0.1 * before


def show(source, names):
    """Runs a cell and renders the value of its last line as a notebook does."""
    *lines, last = ast.parse("".join(source)).body
    exec(compile(ast.Module(lines, []), "a cell", "exec"), names)
    value = names["_"] = eval(compile(ast.Expression(last.value), "its last line", "eval"), names)
    if hasattr(value, "_repr_html_"):
        assert value._repr_html_().count("<tr>") >= 2


def test_options_are_keywords_or_one_object_and_can_be_pickled(flown):
    from ground.fitting.fit import FitOptions
    from ground.simulation.simulate import SimulateOptions

    options = FitOptions(free=["k"], starts=2)
    one = ground.fit(MODEL, flown, options=options)
    assert one.starts["tried"] == 2 and list(one.parameters) == ["k"]
    assert ground.fit(MODEL, flown, options=options, starts=1).starts["tried"] == 1
    assert "starts" in inspect.signature(ground.fit).parameters
    assert "\nstarts : int, default 1\n    Fit from the model's values" in ground.fit.__doc__
    for kept in (options, SimulateOptions(size=1.2, room=None), ground.fit):
        assert pickle.loads(pickle.dumps(kept)) == kept
    with pytest.raises(TypeError, match="colour"):
        ground.fit(MODEL, flown, colour="red")


WRONG = {  # a call with the craft, a run and what is wrong; words of the error
    "window: -1": lambda craft, run: ground.fit(craft, run, window=-1),
    "window: nan": lambda craft, run: ground.compare(craft, run, window=float("nan")),
    "window: 0 ": lambda craft, run: ground.predict(craft, run, window=0),
    "start: '10'": lambda craft, run: ground.fit(craft, run, start="10"),
    "starts: 2.5": lambda craft, run: ground.fit(craft, run, starts=2.5),
    "ends at 5 s": lambda craft, run: ground.fit(craft, run, start=10, end=5),
    "free: ": lambda craft, run: ground.fit(craft, run, free=[["k"]]),
    "prior: 5": lambda craft, run: ground.fit(craft, run, prior=5),
    "no effect is left": lambda craft, run: ground.diagnose(craft, run, only=[]),
    "^matters": lambda craft, run: ground.diagnose(craft, run, matters="2"),
    "rate: -1": lambda craft, run: ground.track(craft, rate=-1),
    "^perturb": lambda craft, run: ground.track(craft, perturb={"k": "a"}),
    "noise": lambda craft, run: ground.read("run.bag", noise=[0.001]),
    "duration: '15'": lambda craft, run: ground.simulate(craft, duration="15"),
    "start_pose": lambda craft, run: ground.simulate(craft, start_pose=(0, 0)),
    "imu: 'no'": lambda craft, run: ground.simulate(craft, imu="no"),
    "not list": lambda craft, run: ground.simulate(craft, ["prbs"]),
    "^k: 'a'": lambda craft, run: craft.with_values(k="a"),
    "motor_lag.tau: '50 ms'": lambda craft, run: craft.with_effect("motor_lag", tau="50 ms"),
    "not SimulatedRun": lambda craft, run: ground.compare(run, craft),
    "from_frame": lambda craft, run: ground.fit(craft, run.to_frame()),
    "did you mean room_4x4": lambda craft, run: ground.Room.load("room_4x5"),
}


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_argument_is_one_line(craft, words):
    run = ground.simulate(craft, "prbs", duration=3)
    with pytest.raises(ground.GroundError, match=words) as error:
        WRONG[words](craft, run)
    assert "\n" not in str(error.value) and "_core" not in str(error.value)


def test_a_single_name_is_one_name(craft):
    run = ground.simulate(craft, "prbs", duration=6)
    assert list(ground.fit(craft, run, free="I_z").parameters) == ["I_z"]
    assert [one["effect"] for one in ground.diagnose(craft, run, only="yaw_bias").tried] == ["yaw_bias"]
    levels = np.array([0.2, 0.8])
    assert set(ground.simulate(craft, levels=levels, duration=3).controls[:, 0]) == {0.0, *levels}


def test_a_level_of_confidence_is_no_alpha(craft):
    fit = ground.fit(craft, ground.simulate(craft, "prbs", duration=6), free=["k"])
    assert fit.conf_int(alpha=0.01).equals(fit.conf_int(0.99))
    with pytest.raises(ground.GroundError, match="0.95.*alpha"):
        fit.conf_int(0.05)


def test_rooms_and_gains_have_names_and_text(craft, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(ground.Room.load("room_4x4").corners) == 4
    assert not ground.track(craft, gains="tiny_whoover", end_time=2).stopped
    run = ground.simulate(craft, "prbs", duration=3)
    run.save("run.bag")
    for load in (ground.Model.load, ground.Room.load):
        with pytest.raises(ground.GroundError, match="run.bag.*text"):
            load("run.bag")
    run.to_frame().to_csv("own.csv")
    with pytest.raises(ground.GroundError, match="from_frame.*read_csv"):
        ground.read("own.csv")
    again = ground.Recording.from_frame(pandas.read_csv("own.csv"))
    assert again.channels == run.channels and again.eta == pytest.approx(run.eta)


def test_an_effect_that_does_nothing_is_told(craft):
    with pytest.warns(ground.GroundWarning, match="wind does nothing"):
        ground.simulate(craft + "wind", duration=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ground.simulate(craft.with_effect("wind", wx=0.2), duration=1)


def test_help_and_completion_show_what_is_public():
    assert {name for name in dir(ground) if not name.startswith("__")} == set(ground.__all__)
    assert not [name for name in ground.__all__ if " at 0x" in pydoc.render_doc(getattr(ground, name))]
