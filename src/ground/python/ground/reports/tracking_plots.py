"""Pictures of controllers in closed loop, and of the search for their gains."""

from typing import Mapping, Optional, Sequence, Tuple, Union

import matplotlib.pyplot as plt
import numpy as np

from ground import _core
from ground.annotations import Array, Document
from ground.recordings.tracks import Track
from ground.reports.appearance import LEFT, MEASURED, MODELS, RIGHT
from ground.reports.plots import save
from ground.reports.words import number
from ground.simulation import tuning
from ground.simulation.tracking import Tracked


def driven(
    path: str,
    run: Union[Tracked, Track],
    title: str,
    counts: Tuple[float, float],
    room: Optional[_core.RoomPlan] = None,
    force: bool = False,
) -> None:
    """Path, error, inputs and computing times of a simulated tracking.Tracked or a recorded
    tracks.Track. counts: the span of time in which errors count [s]; room: the _core.RoomPlan that it
    was in, whose walls are drawn."""
    figure = plt.figure(figsize=(13, 8))
    grid = figure.add_gridspec(
        3, 2, width_ratios=[1, 1.4], height_ratios=[1, 1, 0.6], hspace=0.1, wspace=0.18
    )
    _draw_path(figure.add_subplot(grid[:, 0]), run, room)
    error = figure.add_subplot(grid[0, 1])
    _draw_error(error, run, counts)
    inputs = figure.add_subplot(grid[1, 1], sharex=error)
    _draw_inputs(inputs, run)
    computing = figure.add_subplot(grid[2, 1], sharex=error)
    _draw_computing(computing, run.computing)
    figure.suptitle(title, fontsize=11)
    save(figure, path, force)


def title(name: str, numbers: Document) -> str:
    """Title of the picture of a run, by its numbers."""
    return "%s: error %s m rms, saturated %.0f%% of the time" % (
        name,
        number(numbers["rms"]),
        100 * (numbers["saturated_fraction"] or 0),
    )


def _draw_path(axis: plt.Axes, run: Union[Tracked, Track], room: Optional[_core.RoomPlan]) -> None:
    reference = run.reference
    if room is not None:
        walls = np.array(list(room.corners) + [room.corners[0]])
        axis.plot(walls[:, 1], walls[:, 0], color="#555555", lw=2, label="walls")
    axis.plot(reference[:, 1], reference[:, 0], color=MODELS[2], lw=4, alpha=0.4, label="reference")
    axis.plot(run.eta[:, 1], run.eta[:, 0], color=MEASURED, lw=1, label="craft")
    every = max(1, len(run.eta) // 24)
    heading = run.eta[::every]
    axis.quiver(
        heading[:, 1],
        heading[:, 0],
        np.sin(heading[:, 2]),
        np.cos(heading[:, 2]),
        color=MODELS[0],
        scale=28,
        width=0.004,
        label="heading",
        zorder=3,
    )
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("y [m] (world_ned)")
    axis.set_ylabel("x [m] (world_ned)")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _draw_error(axis: plt.Axes, run: Union[Tracked, Track], counts: Tuple[float, float]) -> None:
    axis.semilogy(run.times, np.maximum(run.errors, 1e-7), color=MEASURED, lw=1)
    axis.axvspan(*counts, color=MODELS[2], alpha=0.12, label="counts")
    axis.set_ylabel("error [m]")
    axis.tick_params(labelbottom=False)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _draw_inputs(axis: plt.Axes, run: Union[Tracked, Track]) -> None:
    """The inputs, and behind them what was wanted before they were limited."""
    if len(run.wanted):
        _draw_rows(axis, run.wanted, "wanted, ", alpha=0.35)
        least, most = run.wanted[:, 1:].min(), run.wanted[:, 1:].max()
        axis.set_ylim(np.clip(least, -1, 0) - 0.05, np.clip(most, 1, 2) + 0.05)
    _draw_rows(axis, run.inputs)
    axis.set_ylabel("input [-]")
    axis.tick_params(labelbottom=False)
    axis.legend(fontsize=8, loc="upper right")
    axis.grid(alpha=0.3)


def _draw_computing(axis: plt.Axes, rows: Array) -> None:
    """Rows of time, processor time of a decision [s]."""
    if len(rows):
        axis.plot(rows[:, 0], 1e3 * rows[:, 1], ".", color=MEASURED, ms=2)
        axis.set_ylim(bottom=0)
    else:
        axis.text(0.5, 0.5, "not recorded", ha="center", transform=axis.transAxes, fontsize=9)
    axis.set_ylabel("computing [ms]")
    axis.set_xlabel("time since the reference began [s]")
    axis.grid(alpha=0.3)


def _draw_rows(axis: plt.Axes, rows: Array, prefix: str = "", alpha: float = 1.0) -> None:
    """Rows of time, left, right."""
    for column, label, color in ((1, "left", LEFT), (2, "right", RIGHT)):
        axis.step(
            rows[:, 0],
            rows[:, column],
            where="post",
            color=color,
            lw=0.7,
            alpha=alpha,
            label=prefix + label,
        )


def tuned(
    path: str,
    compared: Mapping[str, tuning.Candidate],
    tried: Sequence[tuning.Candidate],
    result: Document,
    force: bool = False,
) -> None:
    """What tune tried: error against saturation and effort; and errors before and after."""
    figure, (cloud, bars) = plt.subplots(
        1, 2, figsize=(14, 6), gridspec_kw={"width_ratios": [1, 1.3]}
    )
    errors = [10 ** tuning.score(c, tuning.Weights(0, 0)) for c in tried]
    shown = cloud.scatter(
        errors,
        [100 * c.saturated for c in tried],
        c=[c.effort for c in tried],
        s=12,
        cmap="viridis",
        alpha=0.6,
    )
    best = sorted((t["error"], 100 * t["saturated"]) for t in result["trade_off"])
    cloud.plot(*zip(*best), ".", color=MODELS[0], ms=5, label="none better in all three")
    cloud.set_xscale("log")
    cloud.set_xlabel("error [m], mean of references and conditions")
    cloud.set_ylabel("saturated [% of the time]")
    cloud.set_title("every candidate; what was traded for what", fontsize=10)
    cloud.legend(fontsize=8)
    cloud.grid(alpha=0.3)
    figure.colorbar(shown, ax=cloud, label="effort (mean square of the inputs)")
    rows = result["table"]
    names = list(compared)
    height = 0.8 / len(names)
    for count, (name, color) in enumerate(
        zip(names, [MEASURED, "#999999", MODELS[4], MODELS[1]][-len(names) :])
    ):
        medians = np.array([row["rms"][name]["median"] for row in rows])
        low = medians - [row["rms"][name]["p05"] for row in rows]
        high = np.array([row["rms"][name]["p95"] for row in rows]) - medians
        places = np.arange(len(rows))[::-1] + 0.4 - height * (count + 0.5)
        bars.barh(
            places, medians, height, xerr=[low, high], color=color, label=name, error_kw={"lw": 0.8}
        )
    bars.set_yticks(np.arange(len(rows))[::-1])
    bars.set_yticklabels(
        ["%s%s, %s" % (r["reference"], " *" if r["held_out"] else "", r["condition"]) for r in rows]
    )
    bars.set_xscale("log")
    bars.set_xlabel("error rms [m]: median, 5 to 95% of fresh starts (* not seen by the search)")
    bars.legend(fontsize=8)
    bars.grid(alpha=0.3, axis="x")
    figure.tight_layout()
    save(figure, path, force)
