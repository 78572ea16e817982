"""Numbers that tests compare do not depend on the processor.

Compilers and libraries choose instructions for a processor, and other instructions round differently. Here
the tests that compare numbers with what files show run with instructions that every x86-64 has.
"""

import os
import subprocess
import sys

from numpy.core import _multiarray_umath as numpy_core

from conftest import ROOT, slow
from test_downstream import devel_space

pytestmark = slow
COMPARING = ("test/python/test_track.py::test_the_mvwt_tracks_as_in_the_thesis",)
PAGES = ("test/python/test_examples.py::test_pages_show_what_their_commands_print[tutorial.md]",)
# Settings of NumPy, OpenBLAS and the C library
PLAIN = {
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        name for name in getattr(numpy_core, "__cpu_dispatch__", ()) if numpy_core.__cpu_features__[name]
    ),
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "1",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
}


def run(*command, **environment):
    done = subprocess.run(
        [str(part) for part in command],
        cwd=str(ROOT),
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout


def compare(folder, tests, settings):
    """Runs the comparing tests with settings, which commands of pages get from the setup of a workspace."""
    settings = {"CMAKE_PREFIX_PATH": "%s:$CMAKE_PREFIX_PATH" % folder, **settings}
    setup = ["source '%s/setup.bash'" % devel_space()]
    setup += ['export %s="%s"' % setting for setting in settings.items()]
    (folder / "setup.bash").write_text("\n".join(setup) + "\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *tests]
    run("bash", "-c", 'source "$0" && exec "$@"', folder / "setup.bash", *command)


def test_numbers_hold_where_libraries_know_no_instructions_of_this_processor(tmp_path):
    compare(tmp_path, COMPARING, PLAIN)


def test_numbers_hold_with_a_core_for_any_processor(tmp_path):
    folder = devel_space().parent / "any_processor"
    options = ["CMAKE_BUILD_TYPE=Release", "CMAKE_UNITY_BUILD=ON", "SKBUILD_PROJECT_VERSION=0"]
    options += [name + "_EXECUTABLE=" + sys.executable for name in ("Python", "Python3", "PYTHON")]
    source = ROOT / "src" / "ground" / "python"
    run("cmake", "-S", source, "-B", folder, *("-D" + option for option in options))
    run(ROOT / ".ci" / "build", folder, "ground_simulation", "ground_identification")
    compare(tmp_path, COMPARING + PAGES, {**PLAIN, "LD_LIBRARY_PATH": "%s:$LD_LIBRARY_PATH" % folder})
    libraries = "%s:%s" % (folder, os.environ["LD_LIBRARY_PATH"])
    for name in ("model", "estimation", "safety", "control", "simulation", "identification"):
        program = devel_space() / "lib" / "ground" / ("ground_%s_test" % name)
        run(program, "--gtest_brief=1", **{**PLAIN, "LD_LIBRARY_PATH": libraries})
