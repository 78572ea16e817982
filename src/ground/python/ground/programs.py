"""Entry points of the programs identify, track and tune: they return an exit status."""

from ground.support.errors import guarded

# Imports take a second; inside `guarded`, Ctrl-C during that time prints no traceback either.


def identify() -> int:
    """Exit status of identify VERB."""
    return _guarded("identify")


def track() -> int:
    """Exit status of track."""
    return _guarded("track")


def tune() -> int:
    """Exit status of tune."""
    return _guarded("tune")


def _guarded(name: str) -> int:
    def work() -> int:
        from ground import cli

        return cli.main() if name == "identify" else cli.program(name)

    return guarded(name, work)
