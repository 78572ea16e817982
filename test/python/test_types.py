"""The compiled core: what loads with it, and arguments that its documentation names."""

import subprocess
import sys

import pytest

from conftest import MODEL
from ground import _core


def test_the_core_loads_without_numpy():
    """Launch files start many programs that need the core alone; numpy would take half of their time."""
    script = "import sys; from ground import _core; sys.exit('numpy' in sys.modules)"
    assert subprocess.call([sys.executable, "-c", script]) == 0


def test_a_wrong_argument_names_the_right_ones():
    with pytest.raises(TypeError, match="times"):
        _core.simulate(_core.load_model(str(MODEL)))
