"""The command line: completion, how fast programs start, and progress of long work."""

import io
import json
import os
import re
import subprocess
import sys

import pexpect
import pytest

from conftest import MODEL, ROOT, located, process
from ground.support import progress
from ground.support.progress import Report, Work

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


# --- progress of long work


LONG = ["--model", MODEL, "--input", "prbs", "--duration", "400"]


def test_a_function_is_told_of_stages_units_and_findings():
    told = []
    work = Work(told.append)
    with work.stage("reading", 3):
        for _ in work.each("ab"):
            pass
        work.reach(3)
        work.reach(2)
        with work.stage("fitting"):
            work.more(2)
            work.step()
            work.note("k is 0.062")
    work.step()  # after the last stage
    assert [(r.what, r.done, r.of) for r in told] == [
        ("reading", 0, 3), ("reading", 1, 3), ("reading", 2, 3), ("reading", 3, 3),
        ("fitting", 0, 1), ("fitting", 1, 2), ("fitting", 1, 2),
    ]  # fmt: skip
    assert str(told[1]) == "reading, 1 of 3" and str(told[-1]) == "k is 0.062"
    assert Work.of(work) is work


def test_json_tells_other_programs_at_once(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress.shown("identify fit", "json") as work, work.stage("reading", 4):
        work.note("a gap")
    reports = [Report(**json.loads(line)["progress"]) for line in sys.stderr.getvalue().splitlines()]
    assert reports == [Report("reading", 0, 4), Report("reading", 0, 4, "a gap")]


def test_a_bar_is_drawn_on_a_terminal_and_removed(tmp_path):
    """Through a pseudo-terminal, as a user has it: a bar with its stage, then no trace of it."""
    arguments = map(str, ["simulate", *LONG, "-o", tmp_path / "run.bag"])
    child = pexpect.spawn(
        located("identify"), list(arguments), encoding="utf-8", timeout=120, dimensions=(24, 100)
    )
    child.expect(r"writing the bag \(thousands of messages\): +\d+%")
    child.expect(r"\r *\r[^\r\n]*Simulated: +402\.00 s, ")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0


@pytest.mark.parametrize("how, expected", [("off", False), ("lines", True)])
def test_progress_can_be_chosen(how, expected, tmp_path):
    """Not on a terminal: lines, or nothing; the result on standard output is the same."""
    done = process("identify", "simulate", *LONG, "-o", tmp_path / "run.bag", "--progress", how)
    assert done.returncode == 0, done.stderr
    assert ("identify simulate: writing the bag" in done.stderr) == expected
    assert re.search("[\r\x1b]", done.stderr) is None and "writing" not in done.stdout
