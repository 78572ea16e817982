"""Launch files as users start them: documentation, errors, recordings, and rviz."""

import contextlib
import os
import pathlib
import runpy
import shutil
import signal
import socket
import subprocess
import time
import types
import xml.etree.ElementTree
from unittest import mock

import numpy as np
import pytest
import rosbag
import yaml

import ground
from conftest import (
    MODEL,
    ROOT,
    SCRIPTS,
    free_port,
    identify,
    json_of,
    located,
    process,
    slow,
    succeeds,
    wait_for,
    write_bag,
)
from ground import _core

RUNNING = 3  # ControllerStatus
LAUNCH = sorted(p.name for p in (ROOT / "launch").glob("*.launch"))


@contextlib.contextmanager
def roslaunch(log, *arguments, **environment):
    """Runs a launch file on a separate master, and ends it as by Ctrl-C."""
    port = free_port()
    env = dict(os.environ, ROS_MASTER_URI="http://localhost:%d" % port, **environment)
    with open(str(log), "w") as output:
        process = subprocess.Popen(
            ["roslaunch", "-p", str(port), "ground"] + list(arguments),
            stdout=output,
            stderr=subprocess.STDOUT,
            env=env,
        )
        try:
            process.env = env
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def udp():
    """The argument that gives a launch a free port to its craft."""
    return "port:=%d" % free_port(socket.SOCK_DGRAM)


def answer(launch, *command, timeout=20):
    """Standard output of a command on the master of a launch."""
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=launch.env, timeout=timeout
    )
    return done.stdout


@pytest.mark.parametrize("name", LAUNCH)
def test_every_argument_is_documented_and_required_only_without_default(name, capsys):
    from roslaunch import arg_dump

    path = str(ROOT / "launch" / name)
    arg_dump.dump_args([path])  # prints the output of roslaunch --ros-args
    output = capsys.readouterr().out
    assert "undocumented" not in output.lower(), output
    listed, optional = output.partition("Optional Arguments:")[::2]
    required = {line.split(":")[0].strip() for line in listed.splitlines()[1:]}
    arguments = xml.etree.ElementTree.parse(path).getroot().findall("arg")
    arguments = [a for a in arguments if "value" not in a.keys()]  # the others cannot be given
    assert required == {a.get("name") for a in arguments if "default" not in a.keys()}
    assert len(optional.splitlines()) - 1 + len(required) == len(arguments)
    text = (ROOT / "launch" / name).read_text()
    assert text.count(" doc=") >= len(arguments) > 0


def test_launch_files_name_no_absolute_path():
    for path in (ROOT / "launch").rglob("*.launch*"):
        for line in path.read_text().splitlines():
            assert '"/home' not in line and '"/work' not in line and '"/opt' not in line, line


@pytest.mark.parametrize("body, system", [("hovercraft", "vrpn"), ("craft 3", "optitrack")])
def test_the_mocap_and_the_body_are_chosen_in_every_launch_of_a_real_craft(body, system):
    given = ["mocap_host:=motive", "mocap:=" + system, "body:=" + body]
    launches = {"room_prbs": [], "room_tracking": [], "own_stop": [], "discover": ["real:=true"]}
    for name, real in launches.items() if system == "vrpn" else [("room_prbs", [])]:
        config = configured(name + ".launch", *given, *real)
        (client,) = [node for node in config.nodes if node.type == "mocap_client"]
        wanted = {"mocap": system, "server": "motive", "body": body, "trackers": [body]}
        for parameter, value in wanted.items():
            assert config.params["/%s/%s" % (client.name, parameter)].value == value
        assert client.required


def test_poses_of_another_body_of_vrpn_client_ros_reach_the_state():
    for body, topic in (("teapot", "teapot"), ("3rd craft: red", "rdcraftred")):
        config = configured("room_prbs.launch", "mocap_host:=motive", "body:=" + body)
        (client,) = [node for node in config.nodes if node.type == "mocap_client"]
        assert [(a.split("/")[-2], b.split("/")[-2]) for a, b in client.remap_args] == [(topic, "hovercraft")]


def running_below(parent, program):
    """Whether a process has a child whose executable's path has `program` in it."""
    with contextlib.suppress(OSError):
        children = pathlib.Path("/proc/%d/task/%d/children" % (parent, parent)).read_text().split()
        return any(program in os.readlink("/proc/%s/exe" % child) for child in children)
    return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_empty_recording_leaves_no_file(tmp_path, number):
    # Without a master the recorder waits until it is ended.
    env = dict(os.environ, ROS_MASTER_URI="http://localhost:%d" % free_port())
    command = [located("record"), "--dir", str(tmp_path), "--experiment", "nothing"]
    recorder = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True)
    try:
        wait_for(lambda: running_below(recorder.pid, "rosbag"), 20, "the recorder")
        assert len(list(tmp_path.glob("*_nothing.yaml"))) == 1
        time.sleep(0.5)  # time to install its signal handlers
        recorder.send_signal(number)
        recorder.wait(10)
        wait_for(lambda: not list(tmp_path.iterdir()), 5, "an empty folder")
    finally:
        recorder.kill()
    assert "Traceback" not in recorder.communicate()[1]


def record_short_run(log, bags):
    """Records an experiment of 8 s with a live change of two nodes; gives its bag."""
    flight = ["duration:=8", "exit_when_done:=true", "heading_offset:=0.25", udp()]
    recorded = ["record:=true", "bag_dir:=%s" % bags, "experiment:=short"]
    with roslaunch(log, "sim_prbs.launch", *flight, *recorded) as launch:
        wait_for(lambda: list(bags.glob("*_short_0.bag.active")), 30, "the recording")
        changes = [
            subprocess.Popen([located("parameters")] + change, env=launch.env)
            for change in (["visualizer", "rate=7.5"], ["simulator", "k_factor=0.9"])
        ]
        assert [change.wait(timeout=30) for change in changes] == [0, 0]
        launch.wait(timeout=60)
    text = log.read_text()
    assert "the controller is done" in text
    errors = [line for line in text.splitlines() if "\x1b[31m" in line]
    assert "Subscribing to" not in text
    assert "has died" not in text and errors == [], "it must end without errors: " + text
    found = list(bags.glob("*_short_0.bag"))
    assert len(found) == 1, text
    return found[0]


def check_recording(bag):
    """Checks the parameters beside a bag, its topics, and what `identify info` prints of it."""
    parameters = bag.with_name(bag.name.replace("_0.bag", ".yaml"))
    assert "real_time_factor" in parameters.read_text()
    kept = yaml.safe_load(parameters.read_text())["run_files"]
    kept = {os.path.realpath(path): text for path, text in kept.items()}
    room = ROOT / "cfg/room/room_4x4.yaml"
    assert kept[str(room)] == room.read_text() and kept[str(MODEL)] == MODEL.read_text()
    info = subprocess.check_output(["rosbag", "info", str(bag)], text=True)
    for topic in ("/controls", "/state", "/vrpn_client_node/hovercraft/pose", "/sender/status"):
        assert topic + " " in info
    measured = identify("info", str(bag)).stdout
    assert "heading_offset 0.25 rad (recorded in the bag)" in measured
    assert "room room_4x4.yaml ('4 x 4 m', kept with the run)" in measured
    assert "s: visualizer: rate 10 -> 7.5" in measured
    assert "k_factor 1 -> 0.9" in " ".join(measured.split())


def check_replay(log, bag):
    """Replays a bag; checks that a path is predicted and that the settings of the run apply."""
    with roslaunch(log, "replay.launch", "bag:=%s" % bag, "rviz:=false") as launch:
        echo = ["rostopic", "echo", "-n", "1"]

        def predicted():
            with contextlib.suppress(subprocess.TimeoutExpired):
                return "x:" in answer(launch, *echo, "/path/predicted/poses[5]/pose/position", timeout=15)

        wait_for(predicted, 40, "a predicted path")
        settings = answer(launch, *echo, "/mocap_state/settings")
        assert "heading_offset: 0.25" in settings, "settings of the run apply to its replay"


def check_prediction(bag):
    """How far the model was off after a second, live and by `identify compare` on the recording. Both judge
    8 s, from starts of their own: some 15 of them are a sample that scatters by a fifth."""
    with rosbag.Bag(str(bag)) as messages:
        errors = [m.eta_error for _, m, _ in messages.read_messages("/model_error") if m.excited]
    squares = np.mean(np.array(errors) ** 2, axis=0)
    live = 1e3 * np.sqrt(squares[0] + squares[1]), np.degrees(np.sqrt(squares[2]))
    (run,) = json_of("compare", "--numbers", "--model", MODEL, "-o", bag.with_suffix(""), bag)["runs"]
    (found,) = [h for h in run["models"]["tiny_whoover"]["horizons"] if h["seconds"] == 1.0]
    print(live, found)  # to see on failure
    assert live[0] == pytest.approx(found["position_mm"], rel=0.4)
    assert live[1] == pytest.approx(found["heading_deg"], rel=0.4)


def test_an_experiment_is_recorded_and_replayed(tmp_path):
    bag = record_short_run(tmp_path / "log", tmp_path / "bags")
    check_recording(bag)
    check_prediction(bag)
    check_replay(tmp_path / "replay", bag)


MISTAKES = [
    ("sim_tracking.launch", "reference:=circel", "must be one of: circle, line, rhodonea"),
    ("sim_tracking.launch", "controller:=TrajectoryTraking", "must be one of: Excitation, OpenLoopPRBS, "),
    ("sim_tracking.launch", "file:=way.csv", "way.csv does not exist"),
    ("sim_tracking.launch", "model:=nowhere.yaml", "nowhere.yaml: cannot be read: No such file"),
    ("sim_prbs.launch", "truth:=craft.yaml", "craft.yaml, line 1: "),
    ("sim_prbs.launch", "model2:=fifo", "fifo: it is not a regular file"),
    ("replay.launch", "bag:=fifo", "fifo does not exist, or is not a file"),
    ("own_stop.launch", "mocap_host:=none", "it must be given: mocap_host:=ADDRESS of the computer"),
    ("room_prbs.launch", "mocap_host:=none", "it must be given: mocap_host:=ADDRESS of the computer"),
    ("room_prbs.launch", None, "mocap_host:=ADDRESS"),
    ("room_tracking.launch", None, "mocap_host:=ADDRESS"),
    ("own_stop.launch", None, "mocap_host:=ADDRESS"),
    ("own_stop.launch", "mocap:=optitrak", "must be one of: optitrack, vrpn, vicon, qualisys"),
    ("bench.launch", "design:=prbs", "must be one of: single-thruster, steps"),
]


START, PRINTED = os.getcwd(), {}


def configured(name, *arguments):
    """The configuration that roslaunch reads from a launch file, before it starts anything.

    A launch file takes the values of some twenty parameters from programs. Those that ended well are not
    started again, except by tests whose files are in a working folder of their own."""
    from roslaunch.config import ROSLaunchConfig
    from roslaunch.loader import Loader
    from roslaunch.xmlloader import XmlLoader

    value_of = Loader.param_value

    def remembered(loader, *given):
        key = given[-1], os.environ.get("ROS_HOME")  # the last one is the command
        if not given[-1] or os.getcwd() != START:
            return value_of(loader, *given)
        if key not in PRINTED:
            PRINTED[key] = value_of(loader, *given)
        return PRINTED[key]

    config = ROSLaunchConfig()
    with mock.patch.object(Loader, "param_value", remembered):
        XmlLoader().load(str(ROOT / "launch" / name), config, argv=list(arguments), verbose=False)
    return config


def loaded(name, *arguments):
    """{name: value} of the parameters that a launch file sets."""
    parameters = configured(name, *arguments).params
    return {name: parameter.value for name, parameter in parameters.items()}


def test_tracking_is_predictive_by_default_and_gains_belong_to_the_controller():
    where = ["room_tracking.launch", "mocap_host:=localhost"]
    config = configured(*where)
    controller = next(node for node in config.nodes if node.name == "controller")
    assert "ground/ModelPredictive" in controller.args
    assert "/controller/k_e" not in config.params
    backstepping = where + ["controller:=TrajectoryTracking"]
    assert loaded(*backstepping)["/controller/k_e"] == pytest.approx(0.00690762)
    given = "gains:=%s" % (ROOT / "cfg" / "gains" / "thesis_4_11.yaml")
    assert loaded(*backstepping, given)["/controller/k_e"] == 4.0


def test_a_real_experiment_reads_the_record_of_the_own_stop(tmp_path, monkeypatch):
    room = ["mocap_host:=localhost"]
    monkeypatch.setenv("ROS_HOME", "/elsewhere")
    file = "/elsewhere/ground/own_stop.yaml"
    for name in ("room_prbs.launch", "room_tracking.launch"):
        assert loaded(name, *room)["/sender/own_stop"] == file
    assert loaded("room_prbs.launch", "own_stop:=none", *room)["/sender/own_stop"] == ""
    assert loaded("sim_prbs.launch")["/sender/own_stop"] == ""
    assert loaded("own_stop.launch", *room)["/prove_stop/output"] == file
    monkeypatch.chdir(tmp_path)
    mine = str(tmp_path / "mine.yaml")
    simulated = loaded("own_stop.launch", "own_stop:=mine.yaml", "simulated:=true", "watchdog:=0")
    assert simulated["/prove_stop/output"] == mine and simulated["/simulator/watchdog"] == 0


def test_only_the_bench_is_armed_without_mocap():
    for name in ("room_prbs", "room_tracking", "own_stop"):
        for room in ([], ["room:=none"]):
            config = configured(name + ".launch", "mocap_host:=localhost", *room)
            assert config.params["/sender/bench"].value is False, "an earlier launch's must be replaced"
            assert "/controller/require_state" not in config.params
            assert "/controller/" in config.clear_params
    config = configured("bench.launch")
    assert config.params["/sender/bench"].value is True
    assert config.params["/controller/require_state"].value is False
    assert {"/controller/", "/sender/"} <= set(config.clear_params)
    for name in ("/sender/auto_arm", "/sender/room", "/controller/auto_start", "/controller/room"):
        assert name not in config.params


def test_bench_puts_zero_before_each_level_and_plays_them_once():
    parameters = loaded("bench.launch", "levels:=0.5, 1", "hold:=3")
    assert parameters["/controller/levels"] == "0 0.5 0 1"
    assert parameters["/controller/duration"] == 2 * 4 * 3
    assert parameters["/controller/lift"] == 0
    parameters = loaded("bench.launch", "levels:=1", "design:=steps")
    assert parameters["/controller/levels"] == "0 1"
    assert parameters["/controller/duration"] == 2 * 10


def test_the_bench_prints_its_levels_and_writes_a_table_beside_the_bag(tmp_path):
    log = tmp_path / "log"
    given = ["simulated:=true", "levels:=0.5 1", "hold:=1", "bag_dir:=%s" % tmp_path, udp()]
    with roslaunch(log, "bench.launch", *given) as launch:

        def call(*words):
            return answer(launch, "rosservice", "call", *words)

        wait_for(lambda: list(tmp_path.glob("*_bench_0.bag.active")), 30, "the recording")
        wait_for(lambda: "success: True" in call("/sender/arm", "true"), 30, "arming")
        assert "success: True" in call("/controller/start")
        table = wait_for(lambda: list(tmp_path.glob("*_thrust.csv")), 30, "the table")[0]
        assert "success: True" in call("/controller/start")
        wait_for(lambda: list(tmp_path.glob("*_thrust-1.csv")), 30, "the second table")
    text = log.read_text()
    bag = list(tmp_path.glob("*_bench_0.bag"))[0]
    assert table.name == bag.name.replace("_0.bag", "_thrust.csv")
    assert table.read_text() == "input,left,right\n0.5,,\n1,,\n"
    assert "without mocap there is no fence; tie the craft down" in text
    for line in ("left 0.5, right 0 since 1.0 s", "left 0, right 1 since 7.0 s", "write the for"):
        assert line in text, text
    assert "has died" not in text and "Traceback" not in text, text


@pytest.mark.parametrize("name, wrong, reason", MISTAKES)
def test_a_wrong_or_missing_argument_is_one_line(tmp_path, monkeypatch, capfd, name, wrong, reason):
    from roslaunch.core import RLException

    monkeypatch.chdir(tmp_path)
    pathlib.Path("craft.yaml").write_text("not a model\n")
    os.mkfifo("fifo")
    with pytest.raises(RLException):
        loaded(name, *[wrong] * bool(wrong))
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(wrong + ": " if wrong else "") and reason in line


def output_of(*words, **environment):
    """Exit status and output of roslaunch."""
    result = subprocess.run(
        ["roslaunch"] + [str(word) for word in words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
        env=dict(os.environ, **environment),
    )
    return result.returncode, result.stdout


def test_a_wrong_argument_ends_a_launch_before_anything_starts():
    status, output = output_of("ground", "sim_tracking.launch", "rvizz:=false")
    assert status == 1 and "rvizz:=false: no argument rvizz; did you mean rviz?" in output
    for word in ("started with pid", "FATAL", "Traceback"):
        assert word not in output, output


def test_a_users_own_launch_file_passes_its_arguments_to_ours(tmp_path):
    mine = tmp_path / "mine.launch"
    mine.write_text(
        """<launch>
          <arg name="colour" default="red"/>
          <arg name="seed" default="7"/>
          <group ns="mine">
            <include file="$(find ground)/launch/sim_tracking.launch">
              <arg name="manager_of_mine" value="$(arg colour)" if="false"/>
              <arg name="seed" value="$(arg seed)"/>
            </include>
          </group>
          <include file="$(find ground)/launch/record.launch" pass_all_args="true"/>
        </launch>"""
    )
    # experiment is an argument of record.launch, which gets all that are given.
    status, output = output_of("--nodes", mine, "colour:=blue", "seed:=3", "experiment:=own")
    assert status == 0, output
    assert {"/mine/ground_manager", "/mine/controller", "/record"} <= set(output.split())
    # trueth is nobody's argument; truth is one of sim_tracking.launch, to which it is not passed.
    status, output = output_of("--nodes", mine, "truth:=x.yaml")
    assert status == 1 and "no argument truth" in output, output


def test_a_second_launch_is_refused_and_the_first_one_drives_on(tmp_path):
    port = udp()
    with roslaunch(tmp_path / "log", "sim_tracking.launch", port) as launch:

        def drives():
            state = answer(launch, "rostopic", "echo", "-n", "1", "controller/status/state", timeout=30)
            return state.startswith("%d" % RUNNING)

        wait_for(drives, 40, "the craft to drive")
        master = {"ROS_MASTER_URI": launch.env["ROS_MASTER_URI"]}
        status, output = output_of("ground", "bench.launch", **master)
        assert status == 1
        (line,) = [line for line in output.splitlines() if line.startswith("/ground_manager")]
        assert "runs already" in line
        assert "started with pid" not in output and "Traceback" not in output, output
        # Another craft in a namespace of its own would get a second /clock, or simulated time.
        free = udp()
        for name, reason in (
            ("sim_prbs.launch", "/ground_manager publishes /clock already"),
            ("bench.launch", "/use_sim_time is true"),
        ):
            status, output = output_of("ground", name, free, ROS_NAMESPACE="b", **master)
            assert status == 1 and "started with pid" not in output, output
            assert sum(line.startswith(reason) for line in output.splitlines()) == 1, output
        # On a master of its own, only the port is shared.
        alone = str(free_port())
        status, output = output_of("-p", alone, "ground", "sim_prbs.launch", port)
        assert status == 1 and "another port:=" in output and "started with pid" not in output, output
        assert output_of("--nodes", "ground", "sim_prbs.launch", port, **master)[0] == 0

        # What is meant to run beside it does.
        beside = [
            subprocess.Popen(
                ["roslaunch", "ground", name] + more,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=launch.env,
            )
            for name, more in (
                ("record.launch", ["bag_dir:=%s" % tmp_path]),
                ("identification.launch", ["output:=%s" % tmp_path]),
            )
        ]
        try:
            wait_for(lambda: list(tmp_path.glob("*.bag.active")), 30, "the recording")
            status, output = output_of("ground", "record.launch", **master)
            assert status == 1 and "/record runs already" in output, output
        finally:
            for process in beside:
                process.send_signal(signal.SIGINT)
            assert [process.wait(timeout=30) for process in beside] == [0, 0]
        assert launch.poll() is None and drives()
    assert "has died" not in (tmp_path / "log").read_text()


UNSHARED = ["unshare"] + (["--user", "--map-root-user"] if os.getuid() else []) + ["--uts", "sh", "-c"]


def away(*words, **environment):
    """Exit status and output of a command in a new shell that has sourced the workspace, on a computer whose
    name does not resolve."""
    if subprocess.run(UNSHARED + ["hostname nowhere-xyz"], stderr=subprocess.DEVNULL).returncode:
        pytest.skip("no computer of another name can be made here")
    setup = pathlib.Path(located("record")).parents[2] / "setup.bash"
    shell = 'hostname nowhere-xyz && exec bash -c \'. %s && exec "$@"\' bash "$@"' % setup
    env = {name: value for name, value in os.environ.items() if name not in ("ROS_IP", "ROS_HOSTNAME")}
    result = subprocess.run(
        UNSHARED + [shell, "sh", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
        env={**env, **environment},
    )
    return result.returncode, result.stdout


def test_a_simulated_launch_runs_where_the_name_of_the_computer_does_not_resolve():
    """Also where the profile of each shell sets ROS_MASTER_URI."""
    port = free_port()
    uri = "http://localhost:%d" % port
    flight = ["duration:=0.2", "lift_time:=0", "exit_when_done:=true"]
    command = ["roslaunch", "-p", port, "ground", "sim_prbs.launch", udp(), *flight]
    status, output = away(*command, ROS_MASTER_URI=uri)
    assert status == 0 and "the controller is done" in output, output


def test_a_real_craft_is_not_launched_at_the_loopback_address():
    port = free_port()
    room = ["roslaunch", "-p", port, "ground", "room_prbs.launch", "mocap_host:=127.0.0.1", "rviz:=false"]
    status, output = away(*room, udp())
    assert status == 1 and "started with pid" not in output, output
    (line,) = [line for line in output.splitlines() if "nowhere-xyz is not an address" in line]
    assert "export ROS_IP=" in line


def test_the_loopback_address_is_for_a_master_on_this_computer_and_replaces_no_choice():
    show = ["sh", "-c", "echo ROS_IP=$ROS_IP"]
    here = "http://localhost:11311"
    for uri, address, expected in (
        (here, "", "127.0.0.1"),
        ("http://nowhere-xyz:11311/", "", "127.0.0.1"),
        ("http://robot:11311", "", ""),
        (here, "192.0.2.7", "192.0.2.7"),
    ):
        given = {"ROS_IP": address} if address else {}
        assert away(*show, ROS_MASTER_URI=uri, **given) == (0, "ROS_IP=%s\n" % expected)
    assert away(*show, ROS_MASTER_URI=here, ROS_HOSTNAME="other") == (0, "ROS_IP=\n")


def test_a_demo_that_does_not_start_says_why(tmp_path):
    demo = runpy.run_path(str(SCRIPTS / "demo"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", demo["PORTS"]["udp"]))
        shown = process("demo", "--out", tmp_path)
    (line,) = shown.stderr.splitlines()
    assert shown.returncode == 1 and "UDP port %d is in use" % demo["PORTS"]["udp"] in line, shown.stderr


def test_two_simulations_in_one_launch_are_refused_and_two_real_crafts_are_not(tmp_path):
    mine = tmp_path / "mine.launch"
    include = '<group ns="%s"><include file="$(find ground)/launch/%s">%s</include></group>'
    for name, more, expected in (
        ("sim_prbs.launch", "", 1),
        (
            "room_prbs.launch",
            '<arg name="mocap_host" value="m"/><arg name="bag_dir" value="%s"/>' % tmp_path,
            0,
        ),
    ):
        mine.write_text("<launch>%s</launch>" % "".join(include % (ns, name, more) for ns in "ab"))
        check = runpy.run_path(str(SCRIPTS / "check_launch"))
        launch, _ = check["load"](types.SimpleNamespace(port=free_port()), [str(mine)], [])
        problem = check["timed"](launch)
        assert bool(problem) == expected and (not problem or "publish /clock" in problem), problem


def test_a_launch_replaces_nodes_that_were_killed(tmp_path):
    """The master still knows them."""
    import rosgraph

    port = free_port()
    uri = "http://localhost:%d" % port
    core = subprocess.Popen(
        ["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        wait_for(lambda: rosgraph.is_master_online(uri), 20, "a master")
        dead = "http://localhost:%d" % free_port()
        rosgraph.Master("/ground_manager", uri).registerService("/x/y", "rosrpc://localhost:1", dead)
        port = udp()
        checked = [port, "duration:=0.2", "lift_time:=0", "exit_when_done:=true"]
        status, output = output_of("ground", "sim_prbs.launch", *checked, ROS_MASTER_URI=uri)
        assert status == 0 and "the controller is done" in output, output
    finally:
        core.terminate()
        core.wait()


RELATIVE = [
    (
        "sim_tracking.launch",
        {
            "model": "/controller/model",
            "model2": "/live_comparison/model2",
            "truth": "/simulator/model",
            "gains": "/controller/gains",
            "file": "/controller/file",
        },
    ),
    ("sim_prbs.launch", {"csv": "/controller/file"}),
    ("identification.launch", {"output": "/identification/output", "bag_dir": "/identification/bag_dir"}),
]


def test_relative_paths_are_relative_to_the_callers_folder(tmp_path, monkeypatch):
    folder = tmp_path / "a folder"
    folder.mkdir()
    for name in ("model", "truth", "model2"):
        shutil.copyfile(str(ROOT / "cfg/hovercraft/tiny_whoover.yaml"), str(folder / name))
    (folder / "csv").write_text("1,-1\n")
    (folder / "file").write_text("x,y\n0,0\n1,1\n")
    (folder / "gains").write_text("k_e: 0.01\n")
    write_bag(folder / "bag", duration=1.0)
    monkeypatch.chdir(folder)
    for launch, arguments in RELATIVE:
        parameters = loaded(launch, *("%s:=%s" % (name, name) for name in arguments))
        for name, parameter in arguments.items():
            assert parameters[parameter] == str(folder / name)


def test_a_run_is_replayed_in_its_room_and_with_its_model(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "ros"))
    monkeypatch.chdir(tmp_path)
    for source, name in ((MODEL, "craft.yaml"), (ROOT / "cfg/room/room_4x4.yaml", "room.yaml")):
        text = source.read_text().replace("margin: 0.2", "margin: 0.3")
        pathlib.Path(name).write_text(text.replace('name: "Tiny Whoover"', "name: mine"))
    command = ["--input", "tracking", "--size", 1, "--duration", 2, "-o", "run.bag"]
    files = ["--model", "craft.yaml", "--room", "room.yaml", "--controller", "ModelPredictive"]
    succeeds("simulate", *command, *files)
    shown = loaded("replay.launch", "bag:=run.bag")
    assert shown["/visualizer/room"] == str(tmp_path / "room.yaml")
    for node in ("/live_comparison", "/visualizer"):
        assert shown[node + "/model"] == str(tmp_path / "craft.yaml")
    for name in ("room.yaml", "craft.yaml"):
        pathlib.Path(name).write_text("something else")
    shown = loaded("replay.launch", "bag:=run.bag")
    assert "margin: 0.3" in pathlib.Path(shown["/visualizer/room"]).read_text()
    assert "name: mine" in pathlib.Path(shown["/live_comparison/model"]).read_text()
    shown = loaded("replay.launch", "bag:=run.bag", "room:=none", "model:=%s" % MODEL)
    assert (shown["/visualizer/room"], shown["/visualizer/model"]) == ("", str(MODEL))
    write_bag("old.bag", duration=1.0)
    shown = loaded("replay.launch", "bag:=old.bag")
    assert shown["/visualizer/room"] == ""
    assert os.path.realpath(shown["/visualizer/model"]) == str(MODEL)


@slow
def test_rviz_shows_a_recording_against_two_models(tmp_path):
    from PIL import Image

    truth = str(ROOT / "test" / "rostest" / "tilted_craft.yaml")
    bag = str(tmp_path / "run.bag")
    tracking = ["--input", "tracking", "--reference", "circle", "--size", "1", "--duration", "40"]
    succeeds("simulate", "--model", truth, "-o", bag, *tracking)

    if not shutil.which("rviz") or not shutil.which("Xvfb"):
        pytest.skip("rviz or Xvfb is not installed")
    display = next(n for n in range(80, 200) if not os.path.exists("/tmp/.X11-unix/X%d" % n))
    screen = subprocess.Popen(
        ["Xvfb", ":%d" % display, "-screen", "0", "1300x900x24", "+extension", "GLX", "-noreset"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_for(lambda: os.path.exists("/tmp/.X11-unix/X%d" % display), 10, "a screen")
        # llvmpipe is faster, but sometimes crashes while LLVM 15 compiles shaders.
        drawing = dict(
            DISPLAY=":%d" % display,
            LIBGL_ALWAYS_SOFTWARE="1",
            GALLIUM_DRIVER="softpipe",
            QT_X11_NO_MITSHM="1",
        )
        picture = str(tmp_path / "rviz.png")

        def colours():
            subprocess.run(
                ["import", "-window", "root", picture], env=dict(os.environ, **drawing), check=True
            )
            scene = Image.open(picture).convert("RGB").crop((500, 70, 1280, 870))  # beside the legend
            pixels = scene.resize((465, 400), Image.NEAREST).getdata()
            close = lambda c, to: all(abs(a - b) < 25 for a, b in zip(c, to))  # noqa: E731
            of = _core.palette
            wanted = {
                "reference": of["reference"],
                "measured": of["measured"],
                "predicted": of["models"][0],
                "predicted2": of["models"][1],
                "thrust": of["thrusters"][1],
                "floor": "#9fa469",  # a large error everywhere, with light on it
            }
            wanted = {n: [int(c[i : i + 2], 16) for i in (1, 3, 5)] for n, c in wanted.items()}
            return {name: sum(close(p, c) for p in pixels) for name, c in wanted.items()}

        models = ["model:=%s" % MODEL, "model2:=" + truth]
        with roslaunch(tmp_path / "log", "replay.launch", "bag:=" + bag, *models, **drawing):
            seen = {}

            def all_there():
                seen.update(colours())
                least = dict(reference=200, measured=200, predicted=20, predicted2=5, thrust=5, floor=500)
                return all(seen[name] > count for name, count in least.items())

            try:
                wait_for(all_there, 90, "craft and paths in rviz")
            except AssertionError:
                raise AssertionError("rviz shows %s" % seen)
    finally:
        screen.terminate()
        screen.wait()


@pytest.mark.parametrize("launch", ["room_tracking.launch", "discover.launch"])
def test_nothing_starts_that_could_not_be_recorded(tmp_path, launch):
    (tmp_path / "file").write_text("")
    given = ["mocap_host:=127.0.0.1"] * launch.startswith("room") + ["rviz:=false"]
    given += [] if launch.startswith("discover") else ["record:=true"]
    argument = "folder" if launch.startswith("discover") else "bag_dir"
    port = free_port()
    status, output = output_of(
        "-p", port, "ground", launch, *given, "%s:=%s" % (argument, tmp_path / "file/bags")
    )
    assert status == 1 and "started with pid" not in output, output
    (line,) = [line for line in output.splitlines() if line.startswith(argument + ":=")]
    assert "cannot write to the bag folder" in line
    for name in ("new/bags", "new"):  # a folder that does not exist yet is fine, and is made only to record
        configured(launch, *given, "%s:=%s" % (argument, tmp_path / name))
    assert not (tmp_path / "new").exists()


def test_two_crafts_are_recorded_with_their_own_names_and_a_mocap_of_both(tmp_path):
    """A launch in a namespace, whose poses are remapped to those of a mocap outside of it."""
    mine = tmp_path / "mine.launch"
    mine.write_text(
        """<launch><group ns="a">
          <remap from="vrpn_client_node/hovercraft/pose" to="/mocap/first/pose"/>
          <include file="$(find ground)/launch/sim_prbs.launch">
            <arg name="record" value="true"/>
            <arg name="bag_dir" value="%s"/>
            <arg name="port" value="%d"/>
            <arg name="duration" value="6"/>
            <arg name="exit_when_done" value="true"/>
          </include>
        </group></launch>"""
        % (tmp_path, free_port(socket.SOCK_DGRAM))
    )
    status, output = output_of("-p", free_port(), mine)
    assert status == 0 and "no node publishes" not in output, output
    (bag,) = tmp_path.glob("*.bag")
    (run,) = ground.read(bag)
    # A craft beside it: the same messages under other names in the same bag.
    both = str(tmp_path / "both.bag")
    with rosbag.Bag(str(bag)) as one, rosbag.Bag(both, "w") as two:
        for topic, message, time_of in one.read_messages():
            two.write(topic, message, time_of)
            if topic.startswith(("/a/", "/mocap/first/")):
                beside = topic.replace("/a/", "/lab/b/").replace("first", "second")
                if beside.endswith(("/controls", "/sent")):
                    message.left = 0.25
                two.write(beside, message, time_of)
    assert run.controls.max() > 0.5 and len(run.eta) > 400
    shutil.copyfile(str(bag.with_name(bag.name.replace("_0.bag", ".yaml"))), str(tmp_path / "both.yaml"))
    refused = identify("info", both)
    assert refused.returncode == 1 and "--namespace" in refused.stderr and "a, lab/b" in refused.stderr
    (first,) = ground.read(both, namespace="a", pose_topic="/mocap/first/pose")
    (second,) = ground.read(both, namespace="/lab/b/", pose_topic="/mocap/second/pose")
    assert np.array_equal(first.controls, run.controls) and np.array_equal(first.eta, run.eta)
    assert first.settings.sources == run.settings.sources
    assert set(second.controls[:, 0]) == {0.25}
    for verb in ("info", "fit", "compare"):
        model = ["--model", MODEL] if verb != "info" else []
        output = ["-o", tmp_path / verb] if verb != "info" else []
        succeeds(verb, both, "--namespace", "a", "--pose-topic", "/mocap/first/pose", *model, *output)


def test_a_topic_that_nobody_publishes_is_missed_at_once_and_at_the_end(tmp_path):
    log = tmp_path / "log"
    with roslaunch(log, "record.launch", "bag_dir:=%s" % tmp_path):
        wait_for(lambda: "no node publishes" in log.read_text(), 40, "a line about missing topics")
        missed = log.read_text().count("no node publishes")
    lines = [line for line in log.read_text().splitlines() if "no node publishes" in line]
    assert missed == 1 and len(lines) == 2
    assert all("/vrpn_client_node/hovercraft/pose" in line and "/controls" in line for line in lines)


def kill(argument, master=""):
    """Kills all processes that have an argument with this ending, and this master in their environment;
    returns their number."""
    count = 0
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
            if any(word.endswith(argument) for word in words) and (
                master.encode() in (folder / "environ").read_bytes()
            ):
                os.kill(int(folder.name), signal.SIGKILL)
                count += 1
    return count


def test_a_killed_supervisor_of_the_recorder_fails_the_launch(tmp_path):
    """Nobody takes a launch whose recording ended early for one that went well."""
    log = tmp_path / "log"
    given = ["bag_dir:=%s" % tmp_path, "experiment:=orphan", "duration:=60", "record:=true", "rviz:=false"]
    with roslaunch(log, "sim_prbs.launch", *given, udp()) as running:
        wait_for(lambda: list(tmp_path.glob("*_orphan_0.bag.active")), 30, "the recording")
        tasks = pathlib.Path("/proc/%d/task" % running.pid).glob("*/children")
        nodes = [node for task in tasks for node in task.read_text().split()]
        (recorder,) = [n for n in nodes if "ground/record" in pathlib.Path("/proc", n, "cmdline").read_text()]
        os.kill(int(recorder), signal.SIGKILL)
        assert running.wait(timeout=30) != 0
        assert "nothing more is recorded" in log.read_text()
        assert not kill("__name:=ground_manager", running.env["ROS_MASTER_URI"]), "all nodes have ended"
        wait_for(lambda: list(tmp_path.glob("*_orphan_0.bag")), 10, "a closed bag")


def test_a_recorder_that_is_killed_loses_less_than_a_second(tmp_path):
    import rospy

    given = ["duration:=60", "record:=true", "bag_dir:=%s" % tmp_path, "experiment:=killed", udp()]
    with roslaunch(tmp_path / "log", "sim_prbs.launch", *given) as launch:
        active = wait_for(lambda: list(tmp_path.glob("*_killed_0.bag.active")), 30, "the recording")[0]
        wait_for(lambda: active.stat().st_size > 300e3, 40, "some recorded seconds")
        clock = answer(launch, "rostopic", "echo", "-n", "1", "/clock/clock")
        assert kill("killed.bag")
        values = [int(line.split(":")[1]) for line in clock.splitlines() if ":" in line]
        killed_after = rospy.Time(*values)
        # Nobody flies without a recording: the drive and its launch end, and scripts notice it.
        assert launch.wait(timeout=30) != 0
        (line,) = [text for text in (tmp_path / "log").read_text().splitlines() if "\x1b[31m" in text]
        assert "nothing more is recorded" in line
        assert not kill("__name:=ground_manager", launch.env["ROS_MASTER_URI"]), "all nodes have ended"
    assert not list(tmp_path.glob("*_killed_0.bag"))
    succeeds("info", active)
    copy = tmp_path / "copy.bag"
    shutil.copyfile(str(active), str(copy))
    with rosbag.Bag(str(copy), "a", allow_unindexed=True) as bag:
        list(bag.reindex())
    with rosbag.Bag(str(copy)) as bag:
        assert bag.get_end_time() > killed_after.to_sec() - 1.0
        topics = bag.get_type_and_topic_info().topics
    assert {"/state", "/controls", "/vrpn_client_node/hovercraft/pose"} <= set(topics)


# Launches with controller:=none, in which a node of the user sends the commands

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

    arguments = ["controller:=none", "port:=%d" % port, *room]
    with roslaunch(log, "sim_tracking.launch", *arguments, ROSCONSOLE_STDOUT_LINE_BUFFERED="1"):
        wait_for(lambda: "listening on UDP port %d" % port in log.read_text(), 60, "the sender")
    said = log.read_text()
    assert len([line for line in said.splitlines() if "WARN" in line and "no fence" in line]) == warns
