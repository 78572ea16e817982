"""Launch files with controller:=none, in which a node of the user sends the commands."""

import socket

import pytest

from conftest import free_port, wait_for
from test_launch import configured
from test_launch import roslaunch as launched

EXPERIMENTS = ["sim_prbs", "sim_tracking", "room_prbs", "room_tracking"]


def arguments(name):
    return ["mocap_host:=127.0.0.1"] * name.startswith("room")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_only_the_controller_is_left_out(name):
    def nodes(*more):
        config = configured(name + ".launch", *arguments(name), *more)
        return {node.name for node in config.nodes}, config.params

    usual, _ = nodes()
    without, parameters = nodes("controller:=none")
    assert usual - without == {"controller"} and without <= usual
    assert parameters["/sender/room"].value.endswith("room_4x4.yaml")
    flown_by = {parameter for parameter in parameters if parameter.startswith("/controller/")}
    assert flown_by == {"/controller/model", "/controller/room"}  # files of the run, which are recorded


@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.parametrize("wrong", ["controller:=nobody", "exit_when_done:=true"])
def test_what_cannot_be_is_refused_before_anything_starts(name, wrong, capfd):
    from roslaunch.core import RLException

    with pytest.raises(RLException):
        configured(name + ".launch", *arguments(name), "controller:=none", wrong)
    said = capfd.readouterr().err
    assert wrong.partition(":=")[0] in said and "it must be one of" in said


@pytest.mark.parametrize("room, warns", [([], False), (["room:=none"], True)])
def test_a_launch_without_a_room_warns_that_there_is_no_fence(room, warns, tmp_path):
    port, log = free_port(socket.SOCK_DGRAM), tmp_path / "log"

    with launched(log, "sim_tracking.launch", "controller:=none", "port:=%d" % port, *room):
        wait_for(lambda: in_use(port), 60, "the sender")
    said = log.read_text()
    assert "listening on UDP port %d" % port in said
    assert len([line for line in said.splitlines() if "WARN" in line and "no fence" in line]) == warns


def in_use(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return True
    return False
