"""The motion shows which channel drives which thruster, with which sign and heading."""

import json
import math
import sys

import pytest
from conftest import MODEL, ROOT, SHARED, identify
from ground.recordings import layouts

import ground
from ground import _core
from ground.errors import GroundError

sys.path.insert(0, str(ROOT / "test" / "bench"))
import mistakes

RAW = SHARED.parent / "epfl_2019_12"
LEVER = _core.load_model(str(MODEL)).value("l")
PAIR = [layouts.Thruster("left", 0, -LEVER, 0), layouts.Thruster("right", 0, LEVER, 0)]
FOUR = [
    layouts.Thruster("back_left", -0.05, -0.0425, 0),
    layouts.Thruster("back_right", -0.05, 0.0425, 0),
    layouts.Thruster("front_left", 0.05, -0.0425, math.pi),
    layouts.Thruster("front_right", 0.05, 0.0425, math.pi),
]


def judged(folder, change=None, seed=5):
    run = mistakes.Recorded(seed)
    if change:
        change(run)
    path, mapping = run.write(folder / "run")
    return layouts.judge(ground.read(path, mapping=mapping), PAIR)


def test_a_left_thruster_turns_the_craft_to_the_right():
    assert PAIR[0].effect == (1, 0, LEVER)
    assert FOUR[2].effect == pytest.approx((-1, 0, -0.0425))


def test_an_honest_run_fits_as_it_is(tmp_path):
    verdict = judged(tmp_path)
    assert verdict.is_as_recorded and verdict.alike == []
    assert verdict.best.force > 0.3 and verdict.best.turn > 0.3
    assert verdict.sentence(PAIR).startswith("channels and heading fit as they are: the commands")


@pytest.mark.parametrize(
    "change, channels, signs, offset",
    [
        (mistakes.swapped, ("right", "left"), (1, 1), 0),
        (mistakes.inverted(1), ("left", "right"), (-1, 1), 0),
        (mistakes.turned(math.pi), ("left", "right"), (1, 1), math.pi),
        (mistakes.turned(-math.pi / 2), ("left", "right"), (1, 1), -math.pi / 2),
    ],
    ids=["swapped", "inverted", "half a turn", "quarter turn"],
)
def test_a_mistake_is_found(change, channels, signs, offset, tmp_path):
    verdict = judged(tmp_path, change)
    assert not verdict.is_as_recorded
    assert verdict.best.channels == channels
    assert verdict.best.signs == signs
    assert verdict.best.heading_offset == offset
    assert verdict.best.share > verdict.recorded.share + 0.15


def test_info_says_which_channel_drives_which_thruster(tmp_path):
    run = mistakes.Recorded(5)
    mistakes.swapped(run)
    path, mapping = run.write(tmp_path / "run")
    options = (path, "--mapping", mapping, "--model", MODEL)
    result = identify("info", *options)
    assert result.returncode == 0, result.stderr
    assert "left is driven by right, right is driven by left: the commands" in result.stdout
    (described,) = json.loads(identify("info", *options, "--json").stdout)
    assert described["layout"]["best"]["channels"] == ["right", "left"]


def test_a_channel_that_is_missing_is_named(tmp_path):
    path, mapping = mistakes.Recorded(5).write(tmp_path / "run")
    with pytest.raises(GroundError, match="no command is named back_left or"):
        layouts.judge(ground.read(path, mapping=mapping), FOUR)


@pytest.mark.filterwarnings("ignore::ground.errors.RecordingWarning")
def test_the_second_craft_is_read_and_what_cannot_be_told_is_said():
    """Its log says back for front, or left for right of a body that looks backwards: both are the same
    to the motion. The bench decides: back thrusters push forward."""
    if not RAW.is_dir():
        pytest.skip("the real recordings of December 2019 are not beside the workspace")
    mapping = ROOT / "cfg" / "mapping" / "four_thrusters.yaml"
    recordings = ground.read(RAW, mapping=mapping)
    ways = {
        (("front_left", "front_right", "back_left", "back_right"), 0.0),
        (("back_right", "back_left", "front_right", "front_left"), math.pi),
    }
    for some in (recordings, *[[one] for one in recordings]):
        verdict = layouts.judge(some, FOUR)
        found = [verdict.best, *verdict.alike]
        assert {(h.channels, h.heading_offset) for h in found} == ways
        assert all(h.signs == (1, 1, 1, 1) for h in found)
        assert verdict.recorded.share < 0.01 < 0.1 < verdict.best.share
        assert "these data cannot distinguish it from" in verdict.sentence(FOUR)
