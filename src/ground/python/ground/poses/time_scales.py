"""Times that suit a craft."""

from ground import _core

WINDOW = 1.5  # length of the windows of the error [time scales]


def usual_window(model: _core.Model) -> float:
    """Length of the windows of the error that suits a model [s]: long enough for what is missing to show,
    and short enough that random pushes do not hide it. 1.5 s for a palm-sized hovercraft."""
    return WINDOW * _core.time_scale(model)
