"""Pictures of measurement and model."""
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend has to be chosen first)
import numpy as np  # noqa: E402

from ground import files  # noqa: E402

MEASURED = "#222222"
MODELS = ["#d1495b", "#1f77b4", "#2a9d5c", "#8e5ea2", "#e08e0b"]
LABELS = ["surge u [m/s]", "sway v [m/s]", "yaw rate r [rad/s]"]


def comparison(path, run, inputs, models, force=False):
    """Velocities, commands and path of one run against models, to a PNG.

    `inputs`: rows of time, left, right, lift; `models`: (label, numbers, pieces) each.
    """
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
        for (label, _, pieces), color in zip(models, _colors(models)):
            for number, piece in enumerate(pieces):
                axis.plot(
                    piece["times"],
                    piece["nu"][:, channel],
                    color=color,
                    lw=1.3,
                    label=label if number == 0 else None,
                )
        axis.set_ylabel(LABELS[channel])
        axis.grid(alpha=0.3)
        axis.tick_params(labelbottom=False)
    first.legend(
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncol=len(models) + 1,
        fontsize=9,
        frameon=False,
    )
    axis = figure.add_subplot(grid[3, 0], sharex=first)
    shown = (inputs[:, 0] >= times[0] - 1) & (inputs[:, 0] <= times[-1])
    for column, label, color in ((1, "left", "#3b6fb6"), (2, "right", "#e08e0b")):
        axis.step(
            inputs[shown, 0], inputs[shown, column], where="post", color=color, lw=1, label=label
        )
    axis.set_xlim(times[0], times[-1])
    axis.set_ylabel("input [-]")
    axis.set_xlabel("time since the start of the run [s]")
    axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=2, fontsize=8, frameon=False)
    axis.grid(alpha=0.3)

    axis = figure.add_subplot(grid[:2, 1])
    axis.plot(eta[:, 1], eta[:, 0], color=MEASURED, lw=3, alpha=0.45)
    for (label, _, pieces), color in zip(models, _colors(models)):
        for number, piece in enumerate(pieces):
            axis.plot(
                piece["eta"][:, 1],
                piece["eta"][:, 0],
                color=color,
                lw=1.2,
                label=label if number == 0 else None,
            )
    axis.plot(eta[0, 1], eta[0, 0], "o", color=MEASURED, ms=6, label="start")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("y [m] (world_ned)")
    axis.set_ylabel("x [m] (world_ned)")
    axis.set_title("path seen from above", fontsize=10)
    axis.grid(alpha=0.3)

    axis = figure.add_subplot(grid[2:, 1])
    axis.axis("off")
    rows = [
        [label, "%.3f" % n["error"], _number(n["thesis_objective"])]
        + ["%.0f" % n["fit_percent"][c] for c in ("u", "v", "r")]
        for label, n, _ in models
    ]
    table = axis.table(
        cellText=rows,
        colLabels=["model", "error", "(3.4), 4 s", "fit u [%]", "fit v [%]", "fit r [%]"],
        loc="center",
        colWidths=[0.3, 0.13, 0.18, 0.17, 0.17, 0.17],
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.scale(1, 1.7)
    longest = max(len(label) for label, _, _ in models)
    for row, color in enumerate(_colors(models), start=1):
        table[(row, 0)].get_text().set_color(color)
        if longest > 16:  # what the column holds at full size
            table[(row, 0)].set_fontsize(max(5, 9 * 16 / longest))
    figure.suptitle(
        "%s: velocities in the body frame, model restarted every 1.5 s" % run.name, fontsize=12
    )
    figure.subplots_adjust(left=0.06, right=0.98, top=0.91, bottom=0.07)
    with files.new_file(path, force) as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)


def _colors(models):
    return [MODELS[i % len(MODELS)] for i in range(len(models))]


def _number(value):
    return "-" if value is None else "%.3f" % value
