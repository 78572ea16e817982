"""Entry points of the programs identify, track and tune."""

from ground.errors import guarded

# Imports take a second; inside `guarded`, Ctrl-C during that time prints no traceback either.


def identify() -> int:
    """Exit status of identify VERB."""

    def work() -> int:
        from ground import cli

        return cli.main()

    return guarded("identify", work)


def track() -> int:
    """Exit status of track."""

    def work() -> int:
        from ground import cli, verbs

        return cli.program(verbs.TRACK)

    return guarded("track", work)


def tune() -> int:
    """Exit status of tune."""

    def work() -> int:
        from ground import cli, verbs

        return cli.program(verbs.TUNE)

    return guarded("tune", work)
