"""Recordings are kept as they were read and repaired, which changes nothing but the time that it takes."""

import errno
import io
import multiprocessing
import os
import re
import time
from unittest import mock

import numpy as np
import pytest
from conftest import MODEL, identify, write_bag

import ground
from ground.api import recordings as api
from ground.progress import Work
from ground.recordings import (
    bag_reader,
    batches,
    cache,
    codecs,
    columns,
    many,
    quality,
    readers,
    recording,
)


@pytest.fixture
def bag(tmp_path):
    (tmp_path / "bags").mkdir()
    return write_bag(tmp_path / "bags" / "run.bag")


def found(bag, cached=True, **options):
    """The Columns of a bag's recording and of its run, with arrays as bytes."""
    (read,) = ground.read(bag, cached=cached, **options)
    (run,) = api.repaired([read], Work())
    return [plain(columns.of_recording(read)), plain(columns.of_run(run))]


def plain(given):
    arrays = {n: (a.dtype.str, a.shape, a.tobytes()) for n, a in given.arrays.items()}
    return given.facts, arrays


def entries(bag):
    folder = bag.parent / cache.FOLDER
    return sorted(folder.glob("*.npz")) if folder.is_dir() else []


@pytest.fixture
def nothing_is_read(monkeypatch):
    """A switch that makes all reading and repairing fail."""

    def refuse(*_):
        raise AssertionError("read or repaired again")

    def switch():
        monkeypatch.setattr(readers, "read", refuse)
        monkeypatch.setattr(quality, "repair", refuse)

    return switch


def test_a_recording_is_read_and_repaired_once(bag, nothing_is_read):
    wanted = found(bag, cached=False)
    assert entries(bag) == []
    assert found(bag) == wanted and len(entries(bag)) == 2
    nothing_is_read()
    assert found(bag) == wanted
    assert {p.name for p in (bag.parent / cache.FOLDER).iterdir()} > set(cache.MARKS)


def test_a_bag_that_has_changed_is_read_anew_even_with_the_same_size_and_time(bag):
    before, status = found(bag), os.stat(bag)
    data = bytearray(bag.read_bytes())
    other = write_bag(bag.parent / "other.bag", seed=2)
    assert found(other) != before
    at = data.rindex(np.float64(api.read(bag)[0].eta[-1, 0]).tobytes())
    data[at : at + 8] = np.float64(0.123).tobytes()
    bag.write_bytes(data)
    os.utime(bag, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert os.stat(bag).st_size == status.st_size
    assert found(bag) != before and found(bag) == found(bag, cached=False)
    assert api.read(bag)[0].eta[-1, 0] == 0.123


def test_options_and_the_file_beside_a_bag_are_part_of_the_key(bag):
    first = found(bag)
    assert found(bag, heading_offset=0.3) == found(bag, False, heading_offset=0.3) != first
    beside = bag.with_suffix(".yaml")
    for offset in (0.1, 0.2):
        beside.write_text("mocap_state: {axes: 'x, z, -y', heading_offset: %g}" % offset)
        assert found(bag) == found(bag, cached=False) != first
    beside.unlink()
    assert found(bag) == first


def test_other_code_makes_entries_useless(bag, monkeypatch):
    found(bag)
    monkeypatch.setattr(cache, "_code", lambda: "another version")
    found(bag)
    assert len(entries(bag)) == 4


def test_a_damaged_entry_is_ignored(bag):
    wanted, random = found(bag), np.random.default_rng(1)
    sound = {path: path.read_bytes() for path in entries(bag)}
    for path, data in sound.items():
        for number in range(30):
            cut = number % 3 == 0
            damaged = bytearray(data[: int(random.integers(len(data)))] if cut else data)
            if not cut:
                damaged[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
            path.write_bytes(damaged)
            assert found(bag) == wanted
        path.write_bytes(data)


class Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_an_entry_from_elsewhere_runs_nothing_and_is_ignored(bag, tmp_path):
    wanted = found(bag)
    for path in entries(bag):
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        key, facts = arrays["key"], arrays["facts"]
        trap = np.array([Trap(tmp_path / "trap")], object)
        for changed in (
            {"facts": trap},
            {"facts": np.array("{}")},
            {"facts": np.array(str(facts).replace('"', "'"))},
            {"key": np.array("of another recording")},
            {"eta": np.zeros((7, 3))},
            {"eta": trap},
        ):
            np.savez(path, **{"key": key, **arrays, **changed})
            assert found(bag) == wanted
        np.savez(path, key=key, facts=facts)
        assert found(bag) == wanted
    assert not (tmp_path / "trap").exists()


def test_a_folder_that_is_read_only_stays_as_it_is(bag):
    wanted = found(bag, cached=False)
    bag.parent.chmod(0o555)
    try:
        assert found(bag) == wanted
        assert [p.name for p in bag.parent.iterdir()] == ["run.bag"]
    finally:
        bag.parent.chmod(0o755)


def test_a_full_disk_leaves_nothing_behind(bag, monkeypatch):
    wanted = found(bag, cached=False)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(os, "replace", full)
        assert found(bag) == wanted
    assert not (bag.parent / cache.FOLDER).exists()
    assert found(bag) == wanted and len(entries(bag)) == 2
    with monkeypatch.context() as disk:
        disk.setattr(os, "replace", full)
        assert found(bag, heading_offset=0.1) != wanted
    assert len(list((bag.parent / cache.FOLDER).iterdir())) == 2 + len(cache.MARKS)


def test_processes_that_write_at_once_do_not_disturb_each_other(bag):
    wanted = found(bag, cached=False)
    with multiprocessing.Pool(4) as pool:
        assert all(each == wanted for each in pool.map(found, [bag] * 12, chunksize=1))
    assert len(entries(bag)) == 2
    assert {p.suffix for p in (bag.parent / cache.FOLDER).iterdir()} == {".npz", ".TAG", ""}


def test_it_can_be_switched_off(bag, monkeypatch):
    assert identify("info", bag, "--no-cache").returncode == 0
    assert found(bag, cached=False) and entries(bag) == []
    monkeypatch.setenv(cache.OFF, "1")
    assert identify("info", bag).returncode == 0
    assert found(bag) and entries(bag) == []


def test_a_fit_is_the_same_with_and_without_it(bag, tmp_path):
    other = write_bag(bag.parent / "other.bag", seed=2)

    def fitted(*options):
        path = tmp_path / "fitted.yaml"
        result = identify("fit", bag, other, "--model", MODEL, "-o", path, "--force", *options)
        assert result.returncode == 0, result.stderr
        return result.stdout, re.sub("(date|command):.*", "", path.read_text())

    anew = fitted("--no-cache")
    assert fitted() == anew and fitted() == anew


def test_several_processes_read_what_one_reads(bag, monkeypatch):
    bags = [bag, *(write_bag(bag.parent / ("%d.bag" % n), seed=n) for n in range(2, 5))]
    alone = [found(path, cached=False) for path in bags]
    monkeypatch.setattr(many, "_alone", lambda *_: False)
    read = ground.read(bags, cached=False)
    runs = api.repaired(read, Work())
    assert [[plain(columns.of_recording(r)), plain(columns.of_run(q))] for r, q in zip(read, runs)] == alone
    (bag.parent / "bad.bag").write_text("nonsense")
    with pytest.raises(ground.GroundError, match="bad.bag: not a bag"):
        ground.read(bag.parent)


def test_few_entries_are_kept_and_none_of_recordings_that_are_gone(bag):
    other = write_bag(bag.parent / "other.bag", seed=2)
    found(other)
    for number in range(cache.KEPT + 3):
        found(bag, heading_offset=0.01 * number)
        time.sleep(0.01)  # entries are ordered by time
    folder = str(bag.parent / cache.FOLDER)
    abandoned = bag.parent / cache.FOLDER / (cache.TEMPORARY + "x.npz")
    abandoned.touch()
    os.utime(abandoned, (0, 0))
    other.unlink()
    cache.tidy(folder)
    assert len(entries(bag)) == 2 * cache.KEPT and not abandoned.exists()
    newest = found(bag, heading_offset=0.01 * (cache.KEPT + 2))
    assert len(entries(bag)) == 2 * cache.KEPT and newest


def odd_bag(path):
    """Writes a bag of poses in three layouts, of which some are lost or far off; returns its path."""
    codec, random = codecs.installed(), np.random.default_rng(1)
    with codec.bag_writer(str(path)) as bag:
        for number in range(400):
            time_of = codec.Time(*divmod(10**12 + number * 10**7, 10**9))
            pose = codec.new("geometry_msgs/PoseStamped")
            pose.header.stamp, pose.header.frame_id = time_of, "mocap"[: number % 3]
            pose.pose.position.x, pose.pose.position.z = random.normal(0, 1, 2)
            half = 0.004 * number
            pose.pose.orientation.y, pose.pose.orientation.w = -np.sin(half), np.cos(half)
            if number % 7 == 0:
                pose.pose.orientation.w = random.choice([np.nan, 3.0, 0.2])
            if number % 11 == 0:
                pose.pose.position.x = 1e6
            bag.write("/mocap/pose", pose, time_of)
            command = codec.new("ground_msgs/Controls", left=number % 5 / 4, right=0.5, lift=1.0)
            command.header.stamp = time_of
            bag.write("/controls", command, time_of)
    return path


def test_messages_decoded_together_are_those_decoded_one_by_one(bag, monkeypatch, tmp_path):
    simulated = tmp_path / "simulated.bag"
    ground.simulate(MODEL, "prbs", duration=4, seed=3).save(simulated)
    bags = [bag, simulated, odd_bag(tmp_path / "odd.bag")]
    one_by_one = mock.Mock(wraps=recording._one_by_one)
    monkeypatch.setattr(recording, "_one_by_one", one_by_one)
    together = [columns.of_recording(readers.read(str(path))) for path in bags]
    assert not one_by_one.called and "left out" in together[2].facts
    monkeypatch.setattr(recording, "_at_once", lambda *_: None)
    for path, wanted in zip(bags, together):
        assert plain(columns.of_recording(readers.read(str(path)))) == plain(wanted)
    assert one_by_one.call_count == len(bags)


def test_messages_that_differ_in_their_strings_are_decoded_one_by_one(tmp_path, monkeypatch):
    codec = codecs.installed()
    bag = write_bag(tmp_path / "run.bag")
    known = codec.known("geometry_msgs/PointStamped")
    with bag_reader.BagReader(str(bag)) as source:
        batch = source.batch("pose")
    assert len(batch.groups) == 1 and batch.values(["point.x", "nothing"]) is None

    def message(frame):
        found = codec.new("geometry_msgs/PointStamped")
        found.header.frame_id = frame
        buffer = io.BytesIO()
        found.serialize(buffer)
        return buffer.getvalue()

    times = np.arange(2)
    same, others = [message("one"), message("one")], [message("one"), message("two")]
    kind = "geometry_msgs/PointStamped"
    assert batches.gathered(kind, known, times, same) is not None
    assert batches.gathered(kind, known, times, others) is None
    assert batches.gathered(kind, known, times, [same[0], same[1][:-1]]) is None
