"""identify tracking: how a recorded craft followed its reference (thesis figures 4.6, 4.7)."""

from ground import files
from ground.recordings import tracks
from ground.reports import tracking_plots
from ground.verbs import common
from ground.verbs.track import metres

NAME = "tracking"
SUMMARY = "how recorded crafts followed their reference: path, error, saturation"


def configure(parser):
    common.reads_bags(parser)
    parser.add_argument(
        "--settled",
        type=common.seconds,
        default=0.0,
        metavar="S",
        help="errors count from so long after the reference began (%(default)g)",
    )
    parser.add_argument(
        "--picture", metavar="FILE.png", help="path, error and inputs of the longest drive"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the picture")


def run(arguments):
    if arguments.picture:
        files.refuse_existing(arguments.picture, arguments.force)
    runs, longest = [], None
    for path, recording in zip(arguments.bags, common.read(arguments)):
        drives = []
        for track in tracks.read(path, recording):
            numbers = tracks.numbers(track, arguments.settled)
            drives.append(numbers)
            if longest is None or numbers["duration"] > longest[1]["duration"]:
                longest = track, numbers, recording.name
        changes = len(recording.changes)
        runs.append({"run": recording.name, "drives": drives, "changes": changes})
        for line in _lines(recording.name, drives, changes):
            common.say(arguments, line)
    result = {"settled": arguments.settled, "runs": runs}
    if arguments.picture:
        track, numbers, name = longest
        title = ", ".join(filter(None, (name, track.controller)))
        tracking_plots.recorded(
            arguments.picture, track, numbers, title, arguments.settled, arguments.force
        )
        result["picture"] = arguments.picture
        common.say(arguments, "written to %s" % arguments.picture)
    return result


def _lines(name, drives, changes):
    for drive in drives:
        yield "%s: %s, %.1f s" % (
            name,
            drive["controller"] or "controller unknown",
            drive["duration"],
        )
        yield "error      %s rms, %s at most, %s at the end" % tuple(
            metres(drive[n]) for n in ("rms", "max", "final")
        )
        if drive["saturated_fraction"] is not None:
            yield "saturated  %.1f%% of the time" % (100 * drive["saturated_fraction"])
            yield "effort     %.3f (mean square of the inputs)" % drive["effort"]
        if drive["wanted_outside"] is not None:
            yield "wanted     outside 0..1 for %.1f%% of the time, %.2f at most" % (
                100 * drive["wanted_outside"],
                drive["wanted_largest"],
            )
    if changes:
        yield "parameters changed %d times while it ran: identify info says which" % changes
