"""The judge of every answer, on made-up predictions whose truth is known."""

import numpy as np
import pytest

from ground.analysis import judge

MATTERS = np.array([1.0, 0.5])  # [mm], [deg]


def predicted(seed, sizes, count=40, alike=0.9, loudness=0.3):
    """What hypotheses predict of four runs, each off by its own size [mm], heading by half of it [deg]. Most
    of an error is the same for all, the errors of a run are of one loudness, and neighbours are alike."""
    random = np.random.default_rng(seed)
    part_of = np.repeat(np.arange(4), count // 4)
    loud = np.exp(loudness * random.normal(size=4))[part_of]

    def slow():
        white = random.normal(size=(count + 1, 2))
        return (white[1:] + white[:-1]) / np.sqrt(2)

    common, found = slow(), []
    for size in sizes:
        own = np.sqrt(alike) * common + np.sqrt(1 - alike) * slow()
        poses = np.abs(own) * loud[:, None] * np.array([size, 0.5 * size])
        found.append(judge.Tested(poses, part_of))
    return found


def verdicts(sizes, draws=600, **how):
    """Share of each verdict over draws of what two hypotheses predict."""
    found = [judge.compared(*predicted(seed, sizes, **how), MATTERS).verdict for seed in range(draws)]
    return {name: found.count(name) / draws for name in ("better", "undecided", "worse")}


@pytest.mark.parametrize("alike, loudness", [(0.9, 0.3), (0.0, 1.0)])
def test_hypotheses_that_predict_the_same_are_seldom_told_apart(alike, loudness):
    shares = verdicts((0.5, 0.5), alike=alike, loudness=loudness)  # below what matters
    assert shares["better"] < 0.05 and shares["worse"] < 0.05


def test_what_predicts_better_is_proved_and_what_predicts_worse_vetoed():
    better, worse = verdicts((0.3, 1.0)), verdicts((1.0, 0.3))
    assert better["better"] > 0.99 and better["worse"] == 0
    assert worse["worse"] > 0.99 and worse["better"] == 0


def test_two_hypotheses_may_change_places():
    for seed in range(50):
        first, second = predicted(seed, (0.8, 1.0))
        there, back = judge.compared(first, second, 10 * MATTERS), judge.compared(second, first, 10 * MATTERS)
        assert {there.verdict, back.verdict} in ({"better", "worse"}, {"undecided"})


def test_a_rise_that_matters_is_vetoed_before_it_is_certain():
    shares = verdicts((8.0, 7.0), alike=0.5)
    small = verdicts((0.08, 0.07), alike=0.5)
    assert shares["worse"] > 1.3 * small["worse"]


def test_one_run_alone_proves_nothing():
    """In one of four runs the error falls to nothing; in the others nothing changes."""
    (found,) = predicted(1, (1.0,))
    gone = found.poses.copy()
    gone[found.part_of == 2] = 0.0
    assert judge.compared(judge.Tested(gone, found.part_of), found, MATTERS).verdict == "undecided"


def test_likelier_innovations_prove_and_do_not_outvote_a_veto():
    random = np.random.default_rng(3)
    likelier = tuple(2.0 + random.normal(size=10) for _ in range(4))
    nothing = tuple(np.zeros(10) for _ in range(4))
    same, other = predicted(1, (1.0, 1.0))
    worse, small = predicted(1, (4.0, 1.0))

    def with_blocks(tested, blocks):
        return judge.Tested(tested.poses, tested.part_of, blocks)

    assert judge.compared(with_blocks(same, likelier), with_blocks(other, nothing), MATTERS).is_better
    assert judge.compared(with_blocks(worse, likelier), with_blocks(small, nothing), MATTERS).is_worse


def test_a_motion_that_is_not_finite_never_wins():
    found, other = predicted(1, (1.0, 1.0))
    never = judge.Tested(np.full_like(found.poses, np.inf), found.part_of)
    assert judge.compared(never, found, MATTERS).is_worse and judge.compared(found, never, MATTERS).is_better
    assert not judge.compared(never, never, MATTERS).is_better
    short = judge.Tested(np.empty((0, 2)), np.empty(0, int))
    assert judge.compared(short, short, MATTERS).verdict == "undecided"
