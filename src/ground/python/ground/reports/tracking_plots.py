"""Pictures of controllers in closed loop, and of the search for their gains."""
import numpy as np

from ground.reports.appearance import LEFT, MEASURED, MODELS, RIGHT
from ground.reports.plots import plt, save
from ground.reports.words import number
from ground.simulation import tuning


def tracked(path, run, task, result, force=False):
    """Path, error and inputs of a tracking.Tracked, with its numbers in the title."""
    figure = plt.figure(figsize=(13, 6.5))
    grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.4], hspace=0.12, wspace=0.18)
    axis = figure.add_subplot(grid[:, 0])
    axis.plot(
        run.wanted[:, 1], run.wanted[:, 0], color=MODELS[2], lw=4, alpha=0.4, label="reference"
    )
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
    error = figure.add_subplot(grid[0, 1])
    error.semilogy(run.times, np.maximum(run.errors, 1e-7), color=MEASURED, lw=1)
    error.axvspan(task.settled, task.until, color=MODELS[2], alpha=0.12, label="counts")
    error.set_ylabel("error [m]")
    error.tick_params(labelbottom=False)
    error.legend(fontsize=8)
    error.grid(alpha=0.3)
    inputs = figure.add_subplot(grid[1, 1], sharex=error)
    for column, label, color in ((1, "left", LEFT), (2, "right", RIGHT)):
        inputs.step(
            run.decisions[:, 0],
            run.decisions[:, column],
            where="post",
            color=color,
            lw=0.7,
            label=label,
        )
    inputs.set_ylabel("input [-]")
    inputs.set_xlabel("time since the reference began [s]")
    inputs.legend(fontsize=8, loc="upper right")
    inputs.grid(alpha=0.3)
    figure.suptitle(
        "%s, %s: error %s m rms, saturated %.0f%% of the time"
        % (
            result["controller"],
            result["reference"],
            number(run.numbers["rms"]),
            100 * run.numbers["saturated_fraction"],
        ),
        fontsize=11,
    )
    save(figure, path, force)


def tuned(path, compared, tried, result, force=False):
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
