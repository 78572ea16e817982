"""Work on a Dask cluster of real processes: the same results, in order, even if a worker dies."""
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from conftest import MODEL, process, write_bag

from ground import _core, workers
from ground.errors import GroundError
from ground.simulation import tracking
from test_launch import free_port


def slow_square(x):
    time.sleep(0.05)
    return x * x, os.getpid()


def fail(x):
    raise ValueError("no square of %d" % x)


def start(command):
    """Starts a process of Dask with this folder on its path, like a lab's own modules."""
    env = dict(os.environ)
    env["PYTHONPATH"] = os.pathsep.join([os.path.dirname(__file__), env.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable] + command,
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


@contextlib.contextmanager
def cluster(count, folder):
    distributed = pytest.importorskip("distributed")
    if not shutil.which("dask-scheduler"):
        pytest.skip("Dask is not installed")
    address = "tcp://127.0.0.1:%d" % free_port()
    scheduler = ["-m", "distributed.cli.dask_scheduler", "--host", address, "--no-dashboard"]
    worker = ["-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    processes = [start(scheduler)]
    processes += [
        start(worker + ["--no-dashboard", "--local-directory", str(folder)]) for _ in range(count)
    ]
    try:
        with distributed.Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)
        yield address, processes[1:]
    finally:
        for process in processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    with cluster(2, tmp_path_factory.mktemp("dask")) as found:
        yield found


def test_results_come_in_order_and_errors_are_passed_on(two_workers):
    import test_workers

    address, _ = two_workers
    with workers.Workers() as here, workers.Workers(address) as there:
        wanted = [x for x, _ in here.map(test_workers.slow_square, range(20))]
        got = list(there.map(test_workers.slow_square, range(20)))
        assert [x for x, _ in got] == wanted == [x * x for x in range(20)]
        assert len({pid for _, pid in got}) == 2
        with pytest.raises(ValueError, match="no square of 3"):
            list(there.map(test_workers.fail, [3]))


def test_parameters_can_be_pickled():
    import pickle

    task = tracking.task("rhodonea", size=1.25)
    back = pickle.loads(pickle.dumps(task))
    assert back.reference.kind == "rhodonea" and back.reference.size == 1.25
    assert back.reference.petals == task.reference.petals and back.settled == task.settled
    params = _core.TrackingParams()
    params.duration, params.start, params.life.lift, params.controller.kind = 33, 7, 0.3, "ModelPredictive"
    back = pickle.loads(pickle.dumps(params))
    assert (back.duration, back.start, back.life.lift) == (33, 7, 0.3)
    assert back.controller.kind == "ModelPredictive"
    assert back.tail == params.tail and back.room is None


def test_a_search_on_a_cluster_finds_the_same_gains(two_workers, tmp_path):
    address, _ = two_workers
    options = ["--model", MODEL, "--evaluations", "24", "--starts", "1", "--test-starts", "2"]
    options += ["--references", "circle", "--holdout", "--json"]
    found = []
    for name, more in (("here", []), ("there", ["--scheduler", address])):
        result = process("tune", *options, *more, "-o", tmp_path / (name + ".yaml"))
        assert result.returncode == 0, result.stderr
        found.append(json.loads(result.stdout))
        found[-1].pop("output")
    assert found[0] == found[1]


def is_same(one, other):
    """Whether two JSON documents agree. Sums of numpy depend in their last digits on where arrays lie in
    memory."""
    if isinstance(one, dict) and isinstance(other, dict):
        return list(one) == list(other) and all(is_same(one[k], other[k]) for k in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(is_same, one, other))
    return one == (pytest.approx(other, rel=1e-8) if isinstance(other, float) else other)


def test_many_bags_on_a_cluster_compare_the_same(two_workers, tmp_path):
    address, _ = two_workers
    bags = [write_bag(tmp_path / ("%d.bag" % s), seed=s, duration=4) for s in (1, 2)]
    found = []
    for name, more in (("here", []), ("there", ["--scheduler", address])):
        out = tmp_path / name
        numbers = ["--model", MODEL, "--numbers", "-o", out]
        result = process("identify", "compare", *bags, *numbers, *more)
        assert result.returncode == 0, result.stderr
        text = (out / "compare.json").read_text().replace(str(out), "OUT")
        found.append(json.loads(text))
    assert is_same(*found)


def test_a_diagnosis_on_a_cluster_is_the_same(two_workers, tmp_path):
    address, _ = two_workers
    truth = tmp_path / "truth.yaml"
    truth.write_text(MODEL.read_text().replace("effects: []", "effects: [{name: motor_lag, tau: 0.05}]"))
    bags = [
        write_bag(tmp_path / ("%d.bag" % s), model=truth, seed=s, duration=4) for s in (1, 2)
    ]
    own = tmp_path / "own.yaml"  # an effect of the user travels, too
    own.write_text("name: pull\nexpression: {Y: a*u}\nparameters: {a: {value: 0, unit: N s/m}}\n")
    options = ["--model", MODEL, "--only", "motor_lag", "input_delay", "--effects", own]
    found = []
    for name, more in (("here", []), ("there", ["--scheduler", address])):
        out = tmp_path / name
        result = process("identify", "diagnose", *bags, *options, "-o", out, *more)
        assert result.returncode == 0, result.stderr
        found.append(json.loads((out / "diagnosis.json").read_text()))
    assert is_same(*found) and found[0]["improved"]["effects"] == ["motor_lag"]


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "PATIENCE", 1)
    address = "tcp://127.0.0.1:%d" % free_port()
    with pytest.raises(GroundError, match="%s: no Dask scheduler answers" % address):
        workers.Workers(address)
