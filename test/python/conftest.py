"""Helpers of the tests in Python."""

import contextlib
import functools
import io
import json
import os
import pathlib
import runpy
import shutil
import socket
import subprocess
import sys
import time
from unittest import mock

import jsonschema
import numpy as np
import pytest

from ground.support import progress

ROOT = pathlib.Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data" / "epfl_2019"
SCRIPTS = ROOT / "src" / "ground" / "scripts"
MODEL = ROOT / "cfg" / "hovercraft" / "tiny_whoover.yaml"
sys.path.insert(0, str(ROOT / "test" / "bench"))
# Tests of minutes whose subject seldom changes
slow = pytest.mark.skipif(not os.environ.get("SLOW"), reason="slow: make test SLOW=1 runs it")


@pytest.fixture(scope="session", autouse=True)
def no_progress():
    """Nothing is shown of work in this process, however busy the computer is."""
    with mock.patch.object(progress, "QUIET", float("inf")):
        yield


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """What the package keeps between calls is kept for these tests only."""
    with mock.patch.dict(os.environ, XDG_CACHE_HOME=str(tmp_path_factory.mktemp("cache"))):
        yield


@pytest.fixture(scope="session")
def one_preparation():
    """What discoveries know before the first flight, which takes seconds, is computed once for a model and
    a room."""
    from ground.discovery.analyst import Analyst

    prepare, known = Analyst._prepare, {}

    def prepare_once(self):
        room = self.room
        place = [room.corners, room.margin, room.home, room.braking, room.latency]
        key = self.given.format() + repr(place)
        if key not in known:
            before = set(vars(self))
            prepare(self)
            added = set(vars(self)) - before | {"sizes"}
            known[key] = {name: vars(self)[name] for name in added}
        for name, value in known[key].items():
            setattr(self, name, dict(value) if isinstance(value, dict) else value)

    with mock.patch.object(Analyst, "_prepare", prepare_once):
        yield


def nominal():
    """MODEL as the core has it; each call gives another copy."""
    from ground import _core

    return _core.load_model(str(MODEL))


@pytest.fixture(scope="session")
def craft():
    """MODEL as users have it."""
    import ground

    return ground.Model.load(MODEL)


@pytest.fixture(scope="session")
def flown(tmp_path_factory):
    """A bag of a craft with a constant yaw moment of 2e-5 N m, which its model does not have."""
    import ground

    bag = tmp_path_factory.mktemp("flown") / "run.bag"
    ground.simulate(ground.Model.load(MODEL).with_effect("yaw_bias", n0=2e-5), seed=5).save(bag)
    return bag


@pytest.fixture(scope="session")
def diagnosed(flown):
    """The ground.Diagnosis of that run."""
    import ground

    return ground.diagnose(MODEL, flown, only=["yaw_bias"])


def identify(*arguments):
    """Runs the tool as a user does, and validates the JSON file that it writes."""
    result = program("identify", *arguments)
    files = {("compare",): "compare.json", ("diagnose",): "diagnosis.json", ("history",): "history.json"}
    written = files.get(arguments[:1])
    if written and result.returncode == 0 and "-o" in arguments:
        path = pathlib.Path(str(arguments[arguments.index("-o") + 1])) / written
        schema(path.stem).validate(json.loads(path.read_text()))
    return result


def succeeds(*arguments):
    """The result of the tool, which must end without an error."""
    result = identify(*arguments)
    assert result.returncode == 0, result.stderr
    return result


def json_of(*arguments):
    """What the tool prints with --json."""
    return json.loads(succeeds(*arguments, "--json").stdout)


def fails(result, *words, status=1):
    """Checks for one line on stderr (besides warnings and listed points) with the words, and no traceback."""
    assert result.returncode == status, result.stderr
    assert "Traceback" not in result.stderr
    if status == 1:
        errors = [s for s in result.stderr.strip().splitlines() if not s.startswith(("warning: ", "  - "))]
        assert len(errors) == 1, result.stderr
    for word in words:
        assert word in result.stderr, result.stderr


@functools.lru_cache(maxsize=None)
def schema(name):
    """The validator for a schema in docs/schemas."""
    path = ROOT / "docs" / "schemas" / (name + ".schema.json")
    return jsonschema.Draft7Validator(json.loads(path.read_text()))


def program(name, *arguments):
    """Runs a program of the package with a user's arguments in this process, because a new process takes
    a second to load its libraries. Returns a CompletedProcess."""
    from ground import cli

    argv = [str(a) for a in arguments]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        with mock.patch("sys.argv", [name] + argv):
            try:
                status = cli.program(name, argv) if name in cli.PROGRAMS else cli.main(argv)
            except SystemExit as end:  # raised by argparse
                status = end.code
    return subprocess.CompletedProcess([name] + argv, status, out.getvalue(), err.getvalue())


def script(monkeypatch, name, *arguments):
    """Exit status of a program, run in this process."""
    monkeypatch.setattr("sys.argv", [name] + [str(a) for a in arguments])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPTS / name), run_name="__main__")
    return ended.value.code or 0


@functools.lru_cache(maxsize=None)
def located(name):
    """Path of the program that rosrun would run; rosrun itself takes a second to find it."""
    find = ["catkin_find", "--first-only", "--libexec", "ground", name]
    return subprocess.check_output(find, text=True).strip()


def process(name, *arguments):
    """Runs a program in a new process, for tests of its process."""
    return subprocess.run(
        [located(name)] + [str(a) for a in arguments], capture_output=True, text=True, timeout=120
    )


@pytest.fixture(scope="session")
def real_bags(tmp_path_factory):
    """Bags of the real recordings by their stamps, imported once; skips the test if they are missing."""
    if not SHARED.is_dir():
        pytest.skip("the real recordings of 2019 are missing beside the workspace")
    folder, bags = tmp_path_factory.mktemp("real"), {}
    for pose in sorted(SHARED.glob("pose_*.csv")):
        stamp = pose.stem[len("pose_") :]
        bags[stamp] = folder / (stamp + ".bag")
        result = identify("import", SHARED / ("controls_%s.csv" % stamp), pose, "-o", bags[stamp])
        assert result.returncode == 0, result.stderr
    return bags


def simulate_run(duration=8.0, seed=1, noise=1.0, model=MODEL, strength=1.0, nu=(0, 0, 0)):
    """Stamps, poses (x, y, psi) and commands of a simulated PRBS run."""
    from ground import _core

    model = _core.load_model(str(model))
    clock = 15.0
    edges = np.arange(int(duration * clock)) / clock
    bits = np.resize(np.array(_core.make_prbs(9, seed), float), (len(edges), 2))
    inputs = np.column_stack([edges, strength * bits, np.ones(len(edges))])
    times = np.arange(0, duration, 0.01)
    run = _core.simulate(model, inputs, times, np.zeros(3), np.array(nu, float))
    random = np.random.default_rng(seed)
    eta = run["eta"] + noise * random.normal(0, [3e-4, 3e-4, 5e-3], (len(times), 3))
    eta[:, 2] = np.angle(np.exp(1j * eta[:, 2]))
    return times, eta, inputs


def run_data(duration=8.0, seed=1, noise=1.0, truth=None, kept=slice(None)):
    """_core.RunData of a simulated run, perhaps of another craft; kept: which poses remain."""
    from ground import _core
    from ground.poses import repair

    times, eta, inputs = simulate_run(duration, seed, noise)
    levels = np.array([3e-4, 3e-4, 5e-3])
    if truth is not None:
        random = np.random.default_rng(seed)
        eta = _core.simulate(truth, inputs, times, np.zeros(3), np.zeros(3))["eta"]
        eta = eta + noise * random.normal(0, levels, eta.shape)
    eta[:, 2] = np.unwrap(eta[:, 2])
    times, eta = times[kept], eta[kept]
    smooth = repair.smooth(times, eta, (levels[0], levels[2]), _core.RunScales())
    return _core.RunData("run%d" % seed, times, smooth["eta"], smooth["nu"], inputs, eta, levels)


def with_effect(path, entry):
    """Writes the model of the craft with an effect."""
    path.write_text(MODEL.read_text().replace("effects: []", "effects:\n  - " + entry))
    return path


def recording_of(times, eta, inputs, **more):
    """A Recording of stamps (n,), poses (n, 3) and rows of stamp and commands."""
    from ground.reading.recording import Recording

    return Recording("run", times, eta, inputs[:, 0], inputs[:, 1:], "made up", **more)


BAGS = {}  # contents of bags that write_bag has written, by what they are of


def write_bag(path, start=1000.0, change=None, **options):
    """Writes a bag of a simulated run with the topics of the thesis's system; returns its path."""
    import genpy
    import rosbag
    from geometry_msgs.msg import PointStamped

    path, model = pathlib.Path(path), pathlib.Path(options.get("model", MODEL)).read_text()
    known = None if change else (start, model, repr(sorted(options.items())))
    if known in BAGS:
        path.write_bytes(BAGS[known])
        return path
    times, eta, inputs = simulate_run(**options)
    if change:
        times, eta, inputs = change(times, eta, inputs)
    with rosbag.Bag(str(path), "w") as bag:
        for topic, stamps, rows in (("pose", times, eta), ("controls", inputs[:, 0], inputs[:, 1:])):
            received = genpy.Time.from_sec(start)  # a recorder's clock never jumps back
            for stamp, row in zip(stamps, rows):
                message = PointStamped()
                message.header.stamp = genpy.Time.from_sec(start + stamp)
                message.point.x, message.point.y, message.point.z = row
                received = max(received + genpy.Duration(0, 1), message.header.stamp)
                bag.write(topic, message, received)
    if known:
        BAGS[known] = path.read_bytes()
    return path


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_for(condition, timeout, what):
    """Waits for the first true value of condition(); fails after `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.05)
    raise AssertionError("waited %d s in vain: %s" % (timeout, what))


def mapping_as_logged(folder):
    """cfg/mapping/four_thrusters.yaml with the names that the logger wrote and no heading offset."""
    text = (ROOT / "cfg" / "mapping" / "four_thrusters.yaml").read_text()
    for field in ("position", "orientation"):
        left, right = "{field: %s.x, unit: mic" % field, "{field: %s.y, unit: mic" % field
        text = text.replace(left, "{@").replace(right, left).replace("{@", right)
    path = folder / "as_logged.yaml"
    path.write_text(text.replace("heading_offset: 3.14", "# heading_offset: 3.14"))
    return path


def started_browser():
    """A browser without a window; the test is skipped where there is none."""
    webdriver = pytest.importorskip("selenium.webdriver")
    service = pytest.importorskip("selenium.webdriver.chrome.service")
    if not shutil.which("chromedriver"):
        pytest.skip("chromedriver is not installed")
    options = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--window-size=1280,900"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(service=service.Service(shutil.which("chromedriver")), options=options)


@pytest.fixture(scope="module")
def browser():
    driver = started_browser()
    yield driver
    driver.quit()


@pytest.fixture
def as_wide_as(browser):
    """A function that makes the browser's window as wide as a device [pixels]."""

    def resize(width):
        device = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", device)

    yield resize
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
