"""Completion of command lines, by the protocol that a shell uses, and how fast programs start."""

import os
import subprocess
import sys

import pytest

from conftest import ROOT, located

HOOK = ROOT / "src" / "ground" / "env-hooks" / "60.ground_completion.bash"
BREAKS = " \t\n\"'><=;|&(:"


def completions(line, first=1, program="identify", cwd=None):
    """What argcomplete's protocol offers for a line: answers come on file descriptor 8."""
    environment = dict(
        os.environ,
        COMP_LINE=line,
        COMP_POINT=str(len(line)),
        _ARGCOMPLETE=str(first),
        _ARGCOMPLETE_IFS="\n",
        _ARGCOMPLETE_COMP_WORDBREAKS=BREAKS,
    )
    done = subprocess.run(
        ["bash", "-c", '"$0" 8>&1 9>/dev/null 1>/dev/null', located(program)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        timeout=60,
        cwd=cwd,
    )
    return [word.strip() for word in done.stdout.split("\n") if word.strip()]


def test_verbs_are_completed():
    assert {"import", "info", "fit", "diagnose"} <= set(completions("identify "))
    assert completions("identify di") == ["diagnose", "discover"]
    assert completions("identify dia") == ["diagnose"]


@pytest.mark.parametrize(
    "line, expected",
    [
        ("identify add motor_l", ["motor_lag"]),
        ("identify diagnose run.bag --only wind motor_l", ["motor_lag"]),
        ("identify fit --objective le", ["least-squares"]),
        ("identify fit --hol", ["--holdout"]),
        ("identify discover --no", ["--no-track"]),
        ("track --controller Model", ["ModelPredictive"]),
    ],
)
def test_options_choices_and_effects_are_completed(line, expected):
    assert completions(line, program=line.split()[0]) == expected


def test_rosrun_is_completed_by_the_environment_hook():
    """Sourced as setup.bash does it, twice; the shell's own functions are called as readline calls them."""
    script = """
        CATKIN_ENV_HOOK_WORKSPACE=$1
        _roscomplete_exe() { COMPREPLY=(former); }
        complete -F _roscomplete_exe rosrun
        . "$2"; . "$2"
        complete -p rosrun
        ask() {
          COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}; COMPREPLY=()
          _ground_rosrun; echo "${COMPREPLY[@]}"
        }
        ask rosrun ground identify dia
        ask rosrun ground identify add motor_l
        ask rosrun ground pl
        ask rosrun rviz rv
    """
    workspace = os.path.dirname(os.path.dirname(os.path.dirname(located("identify"))))
    done = subprocess.run(
        ["bash", "-c", script, "bash", workspace, str(HOOK)], capture_output=True, text=True, timeout=60
    )
    spec, *answers = [line.strip() for line in done.stdout.splitlines()]
    assert "-F _ground_rosrun rosrun" in spec
    assert answers == ["diagnose", "motor_lag", "former", "former"], done.stderr


def loaded(code, **environment):
    """Names of the modules that some code loads, in a new interpreter."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", code],
        env=dict(os.environ, **environment),
        capture_output=True,
        text=True,
        timeout=60,
    )
    return {line.split("|")[-1].strip() for line in done.stderr.splitlines() if "|" in line}


def test_help_and_completion_of_verbs_load_no_numerical_library():
    program = "import sys; from ground.cli import identify; sys.argv[1:] = %r; identify()"
    help_of_all = loaded(program % ["--help"])
    asked = loaded(
        program % [], _ARGCOMPLETE="1", COMP_LINE="identify di", COMP_POINT="11",
        _ARGCOMPLETE_STDOUT_FILENAME=os.devnull,
    )  # fmt: skip
    assert "argcomplete" in asked and "argcomplete" not in help_of_all
    for modules in (help_of_all, asked):
        assert "ground.cli" in modules
        assert not modules & {"numpy", "scipy", "pandas", "ground._core", "tqdm"}
    of_a_verb = loaded(program % ["diagnose", "--help"])
    assert "numpy" in of_a_verb and not of_a_verb & {"scipy.stats", "pandas", "plotly", "tqdm"}
