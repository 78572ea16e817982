"""The result of a comparison in a sentence."""

from ground.reports.words import listed
from ground.support.annotations import Document


def comparison(ranking: Document, noise_floor: float) -> str:
    """One sentence on the error of the models compared: which predicts best, or that errors do not say so
    because models were fitted to the runs."""
    errors, held_out = ranking["errors"], ranking["role"] == "held_out"
    (best, least), *others = errors.items()
    text = "%s has an error of %.3f" % (best, least)
    if others:
        text = "%s %s best: its error is %.3f, that of %s" % (
            best,
            "predicts" if held_out else "fits",
            least,
            listed(["%s %.3f" % other for other in others]),
        )
    floor = "the noise of the poses alone would leave %.3f." % noise_floor
    return "%s; %s%s" % (text, floor, "" if held_out else " " + _used(ranking))


def _used(ranking: Document) -> str:
    """What errors on runs that models were fitted to do not say."""
    names = listed(ranking["fitted"])
    what = "which model predicts better" if len(ranking["errors"]) > 1 else "how well it predicts"
    return "%s was fitted to these runs: compare on other recordings to learn %s." % (names, what)
