"""Results of an interrupted diagnosis in its folder are read as data and never executed."""
import dataclasses
import hashlib
import io
import os
import pickle

import numpy as np
import pytest
from conftest import MODEL

from ground import _core
from ground.analysis import held_out, likelihood, unfinished

PLANTED = []


class Malicious:
    def __reduce__(self):
        return PLANTED.append, ("run",)


def a_judged():
    model = _core.load_model(str(MODEL))
    model.add_effect("motor_lag")
    parameters = {"k": {"name": "k", "value": 0.1, "ci95": (0.05, np.inf), "identified": True}}
    blocks = (np.random.default_rng(1).normal(size=(2, 3)), np.arange(4.0))
    errors = np.arange(3.0), np.ones(3), np.array([0.1, np.nan])
    return held_out.Judged(model, parameters, *errors, blocks, np.array([0, 1]))


def a_fit():
    model = _core.load_model(str(MODEL))
    levels = {"sigma_X": 1 / 3, "time_X": np.float64(0.2)}
    found = {"name": "k", "value": 0.1, "ci95": (0.05, np.inf), "identified": True}
    blocks, eye = np.array([1.0, 2.0]), np.eye(2)
    return likelihood.Fit(
        model, levels, (0.1, -0.1), ("k",), -3.0, blocks, eye, blocks, (found,), eye, (), True
    )


def same(a, b):
    assert type(a) is type(b) or isinstance(a, np.generic), (a, b)
    if isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b)
    elif isinstance(a, _core.Model):
        assert a.format() == b.format()
    elif isinstance(a, dict):
        assert list(a) == list(b)
        [same(a[key], b[key]) for key in a]
    elif isinstance(a, (list, tuple)):
        assert len(a) == len(b)
        [same(x, y) for x, y in zip(a, b)]
    elif dataclasses.is_dataclass(a):
        [same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    else:
        assert a == b


def kept(folder, value, identity="this work"):
    """The result for a part, and whether it was computed."""
    computed = []

    def compute():
        computed.append(1)
        return value

    return unfinished.Unfinished(str(folder), identity).result("part", compute), bool(computed)


def test_results_come_back_bit_by_bit(tmp_path):
    for name, value in (("judged", a_judged()), ("fit", a_fit()), ("none", None)):
        first, computed = kept(tmp_path / name, value)
        assert computed
        again, computed = kept(tmp_path / name, "another")
        assert not computed
        same(value, again)
        assert kept(tmp_path / name, "another", "other work") == ("another", True)


def files_of(folder):
    return [folder / name for name in os.listdir(str(folder))]


def with_digest(contents):
    return hashlib.sha256(contents).digest() + contents


def objects():
    buffer = io.BytesIO()
    np.savez(buffer, np.array([Malicious()], dtype=object))
    return buffer.getvalue()


def compressed():
    buffer = io.BytesIO()
    np.savez_compressed(buffer, np.zeros(10**6))
    return buffer.getvalue()


def test_a_malicious_pickle_in_the_folder_is_never_run(tmp_path):
    PLANTED.clear()
    pickled = pickle.dumps(Malicious())
    kept(tmp_path, 1.5)
    (path,) = files_of(tmp_path)
    for contents in (pickled, with_digest(pickled), objects(), with_digest(objects())):
        for name in (path, tmp_path / path.stem):  # present and earlier names
            name.write_bytes(contents)
        assert kept(tmp_path, 2.5) == (2.5, True)
        assert kept(tmp_path, 3.5) == (2.5, False)  # the damaged file was replaced
    assert not PLANTED


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1] + bytes([data[-1] ^ 1]),
        lambda data: bytes(32) + data[32:],
        lambda data: with_digest(b"no archive"),
        lambda data: with_digest(compressed()),
        lambda data: unfinished._packed(1)[:32] + data[32:],
    ],
)
def test_a_damaged_or_foreign_file_is_computed_again(tmp_path, spoil):
    kept(tmp_path, a_judged())
    (path,) = files_of(tmp_path)
    path.write_bytes(spoil(path.read_bytes()))
    assert kept(tmp_path, 2.5) == (2.5, True)


def test_only_data_are_kept(tmp_path):
    work = unfinished.Unfinished(str(tmp_path), "this work")
    for value in (Malicious(), np.array([Malicious()])):
        with pytest.raises(TypeError, match="cannot be kept"):
            work.result("part", lambda value=value: value)
    assert not files_of(tmp_path)


def test_files_of_others_are_not_removed(tmp_path):
    folder = tmp_path / ".unfinished"
    kept(folder, 1.5)
    (folder / "notes.txt").write_text("mine")
    (folder / ".ground-x1y2.npz").write_text("half a resu")  # left by a killed process
    work = unfinished.Unfinished(str(folder), "this work")
    work.done()
    assert [p.name for p in files_of(folder)] == ["notes.txt"]
    (folder / "notes.txt").unlink()
    work.done()
    assert not folder.exists()


def test_work_continues_if_nothing_can_be_kept(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(unfinished.files.tempfile, "mkstemp", full)
    assert kept(tmp_path, 1.5) == (1.5, True)


def test_nothing_in_the_package_unpickles():
    package = os.path.dirname(unfinished.__file__) + "/.."
    for folder, _, names in os.walk(package):
        for name in names:
            if name.endswith(".py"):
                with open(os.path.join(folder, name)) as file:
                    text = file.read()
                assert "import pickle" not in text and "allow_pickle=True" not in text, name


def test_only_what_is_left_is_computed_and_the_rest_is_counted(tmp_path):
    folder, computed = str(tmp_path / "kept"), []

    def work(item):
        computed.append(item)
        return 10 * item

    first = unfinished.Unfinished(folder, "a")
    assert list(first.results(["p1", "p2"], work, [1, 2], map)) == [10, 20] and first.taken == 0
    again = unfinished.Unfinished(folder, "a")
    assert list(again.results(["p3", "p2", "p1", "p4"], work, [3, 2, 1, 4], map)) == [30, 20, 10, 40]
    assert computed == [1, 2, 3, 4] and again.taken == 2
    other = unfinished.Unfinished(folder, "b")  # results of another computation
    assert other.result("p1", lambda: 7) == 7 and other.taken == 0
    assert again.result("p1", lambda: 7) == 10 and again.taken == 3
    none = unfinished.Unfinished()
    assert (none.result("p", lambda: 1), none.result("p", lambda: 2), none.taken) == (1, 2, 0)
    again.done()
    assert not os.path.exists(folder)
