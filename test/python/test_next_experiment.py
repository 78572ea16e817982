"""Effects that the runs cannot tell apart: they are named together, with an experiment that can."""
import numpy as np
import pytest
from conftest import MODEL


def runs_of(truth, schedules, psi=0.7, seed=1):
    """Simulated runs as the tool sees them (_core.RunData), all started at the same heading."""
    from ground import _core, experiments, quality

    mocap = _core.MocapParams()
    mocap.rate, mocap.position_noise, mocap.heading_noise = 120.0, 3e-4, 5e-3
    return [
        quality.Run(
            experiments.simulate(
                truth, s, "run %d" % i, pose=(0, 0, psi), mocap=mocap, seed=10 * seed + i
            )
        ).data(truth)
        for i, s in enumerate(schedules)
    ]


def straight(seed):
    """Runs in which the craft hardly turns."""
    from ground import experiments

    random = np.random.default_rng(seed)
    found = []
    for _ in range(2):
        edges = np.arange(0, 6, 0.5)
        level = random.uniform(0.1, 0.6, len(edges))
        rows = np.column_stack([edges, level, level + random.uniform(-0.001, 0.001, len(edges))])
        found.append(experiments.with_lift(rows, 6.0))
    return found


def diagnosed(runs, names):
    from ground import _core, candidates, diagnosis, diagnosis_report

    model = _core.load_model(str(MODEL))
    found = diagnosis.Diagnosis(runs, model, [candidates.of_library(n) for n in names])
    found.grow()
    return diagnosis_report.of(found, found.conclude(), "model")


@pytest.mark.parametrize("hidden", ["floor_tilt", "body_force_bias"])
def test_a_tilt_and_a_constant_force_need_a_turn(hidden):
    from ground import _core, next_experiment

    names = ["floor_tilt", "body_force_bias"]
    truth = _core.load_model(str(MODEL))
    truth.add_effect(hidden)
    sizes = {"floor_tilt": {"sx": 0.006, "sy": 0.004}, "body_force_bias": {"x0": 4e-3, "y0": -2e-3}}
    for name, value in sizes[hidden].items():
        truth.set_value("%s.%s" % (hidden, name), value)
    grouped, separated = 0, 0
    seeds = range(1, 6)
    for seed in seeds:
        old = runs_of(truth, straight(seed), seed=seed)
        report = diagnosed(old, names)
        if set(report["candidates"][0]["group"]) != set(names):
            assert report["candidates"][0]["effect"] == hidden  # it turned enough
            continue
        grouped += 1
        proposed = report["next_experiment"]
        assert set(proposed["separates"]) == set(names)
        assert proposed["expected_disagreement"] > 0.5
        new = runs_of(truth, [next_experiment.schedule_of(proposed["arguments"])], seed=seed + 50)
        report = diagnosed(old + new, names)
        separated += report["candidates"][0]["group"] == [hidden]
    assert grouped >= 1
    assert separated >= 0.8 * grouped
