"""Pictures of measurement and model, and of where the model fails."""

from typing import Any, List, Mapping, Optional, Sequence

import matplotlib

matplotlib.use("Agg")  # before pyplot is imported, which would choose another
import matplotlib.pyplot as plt
import numpy as np

from ground import files
from ground.analysis import failure
from ground.analysis.failure import Missing
from ground.annotations import Array, ArrayLike, Document
from ground.recordings import repair
from ground.reports.appearance import (
    CHANNELS,
    ERROR_AGAINST,
    LEFT,
    MEASURED,
    MODELS,
    RIGHT,
    model_color,
    scaled,
    short_label,
)
from ground.reports.words import number

LABELS = ["%s [%s]" % (name, unit) for _, name, unit in CHANNELS]
TIME = "time since the start of the run [s]"


def comparison(path: str, studies: Sequence[Document], force: bool = False) -> None:
    """Velocities, commands and path of one run against models."""
    run = studies[0]["run"]
    times, nu, eta = np.array(run.times), np.array(run.nu), np.array(run.eta)
    figure = plt.figure(figsize=(14, 8.5))
    grid = figure.add_gridspec(
        4, 2, width_ratios=[2, 1], height_ratios=[3, 3, 3, 1.4], hspace=0.16, wspace=0.16
    )
    first = None
    for channel in range(3):
        axis = figure.add_subplot(grid[channel, 0], sharex=first)
        first = first or axis
        axis.plot(times, nu[:, channel], color=MEASURED, lw=3, alpha=0.45, label="measured")
        for study, color in zip(studies, _colors(studies)):
            for count, piece in enumerate(study["evaluation"].pieces):
                axis.plot(
                    piece["times"],
                    piece["nu"][:, channel],
                    color=color,
                    lw=1.3,
                    label=study["label"] if count == 0 else None,
                )
        axis.set_ylabel(LABELS[channel])
        axis.grid(alpha=0.3)
        axis.tick_params(labelbottom=False)
    _legend_above(first, len(studies) + 1)
    axis = figure.add_subplot(grid[3, 0], sharex=first)
    _draw_commands(axis, studies[0])
    axis.set_ylabel("input [-]")
    axis.set_xlabel(TIME)
    axis.legend(loc="upper right", ncol=2, fontsize=8)

    axis = figure.add_subplot(grid[:2, 1])
    axis.plot(eta[:, 1], eta[:, 0], color=MEASURED, lw=3, alpha=0.45)
    for study, color in zip(studies, _colors(studies)):
        for piece in study["evaluation"].pieces:
            axis.plot(piece["eta"][:, 1], piece["eta"][:, 0], color=color, lw=1.2)
    axis.plot(eta[0, 1], eta[0, 0], "o", color=MEASURED, ms=6)
    axis.annotate("start", (eta[0, 1], eta[0, 0]), (5, 5), textcoords="offset points")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("y [m] (world_ned)")
    axis.set_ylabel("x [m] (world_ned)")
    axis.set_title("path seen from above", fontsize=10)
    axis.grid(alpha=0.3)

    _draw_table(figure.add_subplot(grid[2:, 1]), studies)
    figure.suptitle(
        "%s: velocities in the body frame, model restarted every 1.5 s" % run.name, fontsize=12
    )
    figure.subplots_adjust(left=0.06, right=0.98, top=0.91, bottom=0.07)
    save(figure, path, force)


def _draw_commands(axis: plt.Axes, study: Document) -> None:
    run = study["run"]
    times, inputs = np.array(run.times), run.inputs
    shown = (inputs[:, 0] >= times[0] - 1) & (inputs[:, 0] <= times[-1])
    for column, label, color in ((1, "left", LEFT), (2, "right", RIGHT)):
        axis.step(
            inputs[shown, 0],
            inputs[shown, column] / study["model"].input_max,
            where="post",
            color=color,
            lw=1,
            label=label,
        )
    axis.set_xlim(times[0], times[-1])
    axis.grid(alpha=0.3)


def _draw_table(axis: plt.Axes, studies: Sequence[Document]) -> None:
    axis.axis("off")
    columns = ["model", "runs", "error", "predic-\ntion", "(3.4)\n4 s", "fit u\n[%]", "v\n[%]"]
    columns.append("r\n[%]")
    rows = []
    for study in studies:
        n = study["numbers"]
        rows.append(
            [study["label"], study["role"].replace("_", " "), number(n["error"])]
            + [number(n["prediction_error"]), number(n["thesis_objective"])]
            + ["%.0f" % n["fit_percent"][c] for c in ("u", "v", "r")]
        )
    table = axis.table(
        cellText=rows,
        colLabels=columns,
        loc="center",
        cellLoc="center",
        colWidths=[0.27, 0.15, 0.13, 0.13, 0.13, 0.09, 0.09, 0.09],
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.scale(1, 1.7)
    for column in range(len(columns)):
        table[(0, column)].set_height(table[(0, column)].get_height() * 1.5)
    off = [s for s in studies if _axes_differ(s)]
    for count, study in enumerate(off):
        angle = study["missing"].numbers["thrust"]["measured"]["angle_deg"]
        axis.text(
            0.5,
            0.1 - 0.14 * count,
            "BODY AXES DIFFER: thrust acts at %.0f deg\nfrom the body x axis of %s"
            % (angle, study["label"]),
            transform=axis.transAxes,
            ha="center",
            color="#c00000",
            fontsize=9,
            fontweight="bold",
        )
    longest = max(len(s["label"]) for s in studies)
    for row, color in enumerate(_colors(studies), start=1):
        table[(row, 0)].get_text().set_color(color)
        if longest > 14:  # what the column holds at full size
            table[(row, 0)].set_fontsize(max(5, 9 * 14 / longest))


def where(path: str, studies: Sequence[Document], force: bool = False) -> None:
    """Normalised error of one run, channel by channel, against what was measured."""
    figure, axes = plt.subplots(
        3,
        len(ERROR_AGAINST) + 1,
        figsize=(19, 8.5),
        sharey=False,
        gridspec_kw={"width_ratios": [1] * len(ERROR_AGAINST) + [1.35]},
    )
    shown = studies[-1]
    for row, channel in enumerate("uvr"):
        top = 1.1 * max(
            np.max(s["where"][name]["error"][channel]) for s in studies for name in ERROR_AGAINST
        )
        for column, name in enumerate(ERROR_AGAINST):
            axis = axes[row, column]
            for count, (study, color) in enumerate(zip(studies, _colors(studies))):
                entry = study["where"][name]
                _draw_bins(axis, entry, entry["error"][channel], None, color, study["label"])
                axis.text(
                    0.97,
                    0.97 - 0.1 * count,
                    _percent(entry["share"][channel]),
                    color=color,
                    fontsize=8,
                    ha="right",
                    va="top",
                    transform=axis.transAxes,
                )
            axis.set_ylim(0, top)
            _small(axis, entry, row == 2, column == 0)
            if column == 0:
                axis.set_ylabel(LABELS[row].split(" [")[0] + "\nmean |error| / sigma")
        entry = shown["where"]["position"]
        bar = _draw_map(figure, axes[row, -1], entry, entry["error"][channel], row == 2)
        if row == 0:
            bar.set_label("map of %s" % shown["label"], fontsize=9)
    axes[0, 0].legend(
        *axes[0, 0].get_legend_handles_labels(),
        loc="lower left",
        bbox_to_anchor=(0, 1.02),
        ncol=len(studies),
        fontsize=9,
        frameon=False,
    )
    figure.suptitle(
        "%s: where the error is (windows of 1.5 s); number: share of the error's variance that the "
        "variable explains, beyond chance" % shown["run"].name,
        fontsize=12,
    )
    figure.subplots_adjust(left=0.05, right=0.97, top=0.89, bottom=0.08, wspace=0.12, hspace=0.12)
    save(figure, path, force)


def residuals(path: str, studies: Sequence[Document], force: bool = False) -> None:
    """Correlation of one-step residuals with themselves and with the inputs."""
    figure, axes = plt.subplots(3, 3, figsize=(15, 9.5))
    columns = [
        ("autocorrelation", "with itself, this much earlier"),
        ("input_sum", "with the command u_L+u_R, this much earlier"),
        ("input_difference", "with the command u_L-u_R, this much earlier"),
    ]
    for row, channel in enumerate(("ahead", "starboard", "heading")):
        for column, (kind, title) in enumerate(columns):
            axis = axes[row, column]
            axis.axhline(0, color=MEASURED, lw=0.6)
            for study, color in zip(studies, _colors(studies)):
                entry = study["residuals"]["channels"][channel][kind]
                if entry is None:
                    axis.text(0.5, 0.5, "the command never changes", transform=axis.transAxes)
                    continue
                lags = 1e3 * np.array(entry["lag_seconds"])
                band = np.array(entry["band99"])
                axis.fill_between(lags, -band, band, color=color, alpha=0.13, lw=0)
                verdict = "%d of %d outside" % (entry["outside"], entry["lags"])
                label = "%s: %s" % (study["label"], verdict)
                axis.plot(lags, entry["value"], "o-", color=color, ms=3, lw=1, label=label)
            if column:
                axis.axvline(0, color=MEASURED, lw=0.6)
            low, high = axis.get_ylim()
            reach = max(0.15, -low, high)
            axis.set_ylim(-reach, 1.12 * reach)
            axis.legend(loc="upper right", fontsize=8, framealpha=0.8)
            axis.grid(alpha=0.3)
            if row == 0:
                axis.set_title(title, fontsize=10)
            if row == 2:
                axis.set_xlabel("lag [ms]")
            if column == 0:
                axis.set_ylabel("residual %s\ncorrelation [-]" % channel)
    figure.suptitle(
        "%s: residuals from one pose to the next (Kalman filter around the model); shaded: 99%% "
        "band, where a true model stays" % studies[0]["run"].name,
        fontsize=12,
    )
    figure.subplots_adjust(left=0.07, right=0.98, top=0.91, bottom=0.06, wspace=0.16, hspace=0.16)
    save(figure, path, force)


WRENCH_COLUMNS = ["u_L", "u_R", "u_L+u_R", "u_L-u_R", "u", "v", "r", "heading", "x", "y"]
WRENCH_LABELS = {
    "X": "surge force X\n[%s]",
    "Y": "side force Y\n[%s]",
    "N": "yaw moment N\n[%s]",
}


def wrench(path: str, study: Document, force: bool = False) -> None:
    """The wrench that one model lacks in one run: over time, and against what was measured."""
    missing, color = study["missing"], MODELS[0]
    figure = plt.figure(figsize=(19, 12))
    outer = figure.add_gridspec(2, 1, height_ratios=[1, 1.05], hspace=0.2)
    top = outer[0].subgridspec(4, 3, width_ratios=[4.2, 1.3, 1.5], height_ratios=[3, 3, 3, 1])
    bottom = outer[1].subgridspec(3, len(WRENCH_COLUMNS), wspace=0.12, hspace=0.14)
    first: Any = None  # of the axes that share their time
    for row, (channel, entry) in enumerate(missing.numbers["channels"].items()):
        factor, unit = scaled(entry)
        label = WRENCH_LABELS[channel] % unit
        axis = figure.add_subplot(top[row, 0], sharex=first)
        first = first or axis
        _draw_series(axis, missing, row, factor, color)
        axis.set_ylabel(label)
        axis.text(
            0.01,
            0.96,
            "rms %.3g %s; full thrust gives %.3g"
            % (factor * entry["rms"], unit, factor * entry["full_scale"]),
            transform=axis.transAxes,
            va="top",
            fontsize=9,
            bbox={"facecolor": "white", "alpha": 0.7, "lw": 0},
        )
        axis.tick_params(labelbottom=False)
        _draw_dependences(figure, bottom, row, entry, factor, label, color)
    title = "missing wrench over time, with two standard deviations"
    if missing.numbers["disturbances"]:
        title += "; grey: left out, no input explains the motion (contact, hand, wrong poses)"
    first.set_title(title, fontsize=10)
    axis = figure.add_subplot(top[3, 0], sharex=first)
    _draw_commands(axis, study)
    axis.set_ylabel("input [-]")
    axis.set_xlabel(TIME)
    axis.legend(loc="upper right", ncol=2, fontsize=8)
    _draw_thrust(figure.add_subplot(top[:, 1]), missing.numbers["thrust"], color)
    _draw_force_map(figure.add_subplot(top[:, 2]), missing)
    figure.suptitle(
        "%s: the force and moment that %s lacks (body frame).  Below: against what was measured; "
        "number and shade: share of its variance explained, beyond chance"
        % (study["run"].name, study["label"]),
        fontsize=12,
    )
    figure.subplots_adjust(left=0.055, right=0.985, top=0.93, bottom=0.05)
    save(figure, path, force)


def _draw_series(axis: plt.Axes, missing: Missing, column: int, factor: float, color: str) -> None:
    values, sigma = factor * missing.wrench[:, column], factor * missing.sigma[:, column]
    # nothing is known inside gaps: no line across
    breaks = np.flatnonzero(np.diff(missing.times) > repair.MAX_GAP) + 1
    times = np.insert(missing.times, breaks, np.nan)
    values, sigma = np.insert(values, breaks, np.nan), np.insert(sigma, breaks, np.nan)
    axis.fill_between(times, values - 2 * sigma, values + 2 * sigma, color=color, alpha=0.25, lw=0)
    axis.plot(times, values, color=color, lw=0.9)
    for event in missing.numbers["disturbances"]:
        axis.axvspan(event["start"], event["end"], color="#888888", alpha=0.35, lw=0)
    axis.axhline(0, color=MEASURED, lw=0.6)
    reach = 1.15 * np.nanquantile(np.abs(values) + 2 * sigma, 0.995)
    if reach > 0:
        axis.set_ylim(-reach, reach)
    axis.grid(alpha=0.3)


def _draw_dependences(
    figure: plt.Figure, grid: Any, row: int, entry: Document, factor: float, label: str, color: str
) -> None:
    against = entry["against"]
    means = [factor * np.array(against[name]["mean"]) for name in WRENCH_COLUMNS]
    reach = 1.3 * max(np.quantile(np.abs(m), 0.9) for m in means)
    for column, name in enumerate(WRENCH_COLUMNS):
        axis = figure.add_subplot(grid[row, column])
        one = against[name]
        share = one["share"]
        named = failure.is_named(share)
        axis.set_facecolor(plt.cm.Oranges(0.6 * share["share"] if named else 0.0))
        axis.axhline(0, color=MEASURED, lw=0.6)
        errors = factor * np.array(one["standard_error"])
        _draw_bins(axis, one, means[column], errors, color, None)
        axis.text(
            0.97,
            0.96,
            _percent(share),
            ha="right",
            va="top",
            fontsize=10,
            fontweight="bold" if named else "normal",
            transform=axis.transAxes,
        )
        if reach > 0:
            axis.set_ylim(-reach, reach)
        _small(axis, one, row == 2, column == 0)
        if column == 0:
            axis.set_ylabel(label)


def _draw_thrust(axis: plt.Axes, thrust: Optional[Document], color: str) -> None:
    """Body axes seen from above, with the force per unit command by model and as measured."""
    axis.set_title(
        "force that a lasting thrust command\nbrings about, seen from above", fontsize=10
    )
    axis.axis("off")
    axis.set_aspect("equal")
    axis.set_xlim(-1.35, 1.35)
    axis.set_ylim(-2.3, 1.5)
    if thrust is None:
        axis.text(0, 0, "the thrust command\nnever changes", ha="center")
        return
    axis.add_patch(plt.Circle((0, 0), 0.32, fill=False, color="#999999"))
    for dx, dy, text in ((0, 1.25, "x ahead"), (1.15, 0, "y starboard")):
        axis.annotate("", (dx, dy), (0, 0), arrowprops={"arrowstyle": "->", "color": "#999999"})
        axis.text(dx, dy + 0.06, text, color="#777777", fontsize=8, ha="center", va="bottom")
    largest = max(thrust[k]["force_per_unit_input"] for k in ("model", "measured"))
    lines = (("model", color, 7), ("measured", MEASURED, 3))
    for count, (kind, shade, width) in enumerate(lines):
        one = thrust[kind]
        angle, size = np.radians(one["angle_deg"]), one["force_per_unit_input"]
        if size > 0:
            axis.annotate(
                "",
                (size / largest * np.sin(angle), size / largest * np.cos(angle)),
                (0, 0),
                arrowprops={"arrowstyle": "-|>", "color": shade, "lw": width, "alpha": 0.8},
            )
        text = "%s: %.3g N per unit at %.0f deg" % (kind, size, one["angle_deg"])
        axis.text(0, -1.3 - 0.28 * count, text, color=shade, ha="center", fontsize=9)
    if thrust["body_axes_differ"]:
        text = "BODY AXES DIFFER\nby %.0f deg" % thrust["off_deg"]
        axis.text(0, -2.25, text, color="#c00000", ha="center", fontsize=12, fontweight="bold")


def _draw_force_map(axis: plt.Axes, missing: Missing) -> None:
    """Mean missing force in the world's axes, cell by cell."""
    against = missing.numbers["channels"]["X"]["against"]["position"]
    centres = np.array(against["centres"])
    c, s = np.cos(missing.heading), np.sin(missing.heading)
    body = missing.wrench[:, :2]
    world = np.column_stack([c * body[:, 0] - s * body[:, 1], s * body[:, 0] + c * body[:, 1]])
    nearest = np.argmin(((missing.position[:, None, :] - centres[None]) ** 2).sum(axis=2), axis=1)
    mean = np.array([world[nearest == i].mean(axis=0) for i in range(len(centres))])
    axis.plot(missing.position[:, 1], missing.position[:, 0], color=MEASURED, lw=0.7, alpha=0.3)
    quiver = axis.quiver(centres[:, 1], centres[:, 0], mean[:, 1], mean[:, 0], color=MODELS[0])
    size = float("%.1g" % np.hypot(*mean.T).max())
    if size > 0:
        axis.quiverkey(quiver, 0.8, 0.04, size, "%g N" % size, labelpos="W")
    axis.set_aspect("equal")
    axis.margins(0.15)
    axis.set_xlabel("y [m] (world_ned)", fontsize=9)
    axis.set_ylabel("x [m] (world_ned)", fontsize=9)
    axis.tick_params(labelsize=8)
    axis.set_title("mean missing force in the\nworld's axes, place by place", fontsize=10)
    axis.grid(alpha=0.3)


def _draw_bins(
    axis: plt.Axes,
    entry: Document,
    values: ArrayLike,
    errors: Optional[Array],
    color: str,
    label: Optional[str],
) -> None:
    centres, values = np.array(entry["centres"]), np.array(values)
    if errors is not None:
        axis.fill_between(
            centres, values - 2 * errors, values + 2 * errors, color=color, alpha=0.25, lw=0
        )
    axis.plot(centres, values, "o-", color=color, ms=3.5, lw=1.3, label=label)


def _draw_map(
    figure: plt.Figure, axis: plt.Axes, entry: Document, values: ArrayLike, last: bool
) -> Any:
    centres = np.array(entry["centres"])
    points = axis.scatter(
        centres[:, 1], centres[:, 0], c=values, marker="s", s=180, cmap="viridis", vmin=0
    )
    axis.margins(0.15)
    axis.tick_params(labelsize=7)
    axis.yaxis.tick_right()
    axis.yaxis.set_label_position("right")
    axis.set_ylabel("x [m]", fontsize=8)
    if last:
        axis.set_xlabel("y [m] (world_ned)", fontsize=9)
    else:
        axis.tick_params(labelbottom=False)
    bar = figure.colorbar(points, ax=axis, location="top", fraction=0.06, pad=0.03)
    bar.ax.tick_params(labelsize=7)
    return bar


def _small(axis: plt.Axes, entry: Document, last: bool, first: bool) -> None:
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=8, labelbottom=last, labelleft=first)
    if last:
        axis.set_xlabel(
            "%s [%s]" % (short_label(entry), entry["unit"]),
            fontsize=9,
        )


def _axes_differ(study: Document) -> bool:
    missing = study.get("missing")
    thrust = missing.numbers["thrust"] if missing else None
    return thrust is not None and thrust["body_axes_differ"]


def _percent(share: Mapping[str, float]) -> str:
    return "%.0f%%" % (100 * share["share"])


def _legend_above(axis: plt.Axes, columns: int) -> None:
    axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=columns, fontsize=9, frameon=False)


def _colors(studies: Sequence[Document]) -> List[str]:
    return [model_color(i) for i in range(len(studies))]


def save(figure: plt.Figure, path: str, force: bool) -> None:
    """Writes the picture and lets the figure go."""
    with files.new_file(path, force) as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)
