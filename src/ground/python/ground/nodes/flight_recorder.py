"""Records a flight: one bag of all topics that record.launch records, in a folder of a discovery."""

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import time
import xmlrpc.client
from typing import List

import rosgraph
import rospy

from ground.support.errors import GroundError

TIMEOUT = 20.0  # until the recorder listens, and until the bag is closed [s]
TAIL = 0.3  # time recorded after the end of a flight [s]
LISTENED = ("controls", "sent", "state", "drive")  # topics that the recorder must listen to before a flight


class FlightRecorder:
    """A running recorder, from its construction until close()."""

    def __init__(self, program: str, folder: str, name: str) -> None:
        """program: the recorder, scripts/record. name: of the bag, without .bag; if it is in use,
        NAME-2 and so on. Returns when it records; raises GroundError when it does not."""
        self._name = _unused(folder, name)
        self.path = os.path.join(folder, self._name + ".bag")
        remappings = [word for word in sys.argv if ":=" in word and not word.startswith("_")]
        # In a session of its own: Ctrl-C is for the node, which first lands the craft.
        self._process = subprocess.Popen(
            [program, "--dir", folder, "--name", self._name, *remappings],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            self._wait_until_it_listens()
        except BaseException:
            self.close()
            raise

    def _wait_until_it_listens(self) -> None:
        deadline = time.monotonic() + TIMEOUT
        node = rospy.resolve_name("record_" + self._name.replace("-", "_"))
        wanted = {rospy.resolve_name(topic) for topic in LISTENED}
        while not (self._writes() and wanted <= set(_heard_by(node))):
            if self._process.poll() is not None:
                raise GroundError(
                    "the flight recorder ended with status %d; its message is above"
                    % self._process.returncode
                )
            if time.monotonic() > deadline:
                raise GroundError(
                    "the flight recorder did not start within %g s: does the mocap publish "
                    "poses, and are there 200 MB free in %s?" % (TIMEOUT, os.path.dirname(self.path))
                )
            time.sleep(0.05)

    def _writes(self) -> bool:
        with contextlib.suppress(OSError):
            return os.path.getsize(self.path + ".active") > 0
        return False

    def has_ended(self) -> bool:
        """Whether it records no more."""
        return self._process.poll() is not None

    def close(self) -> str:
        """Ends the recording after the last messages. Returns the path of the bag; empty when nothing
        was recorded."""
        if self._process.poll() is None:
            time.sleep(TAIL)
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for path in (self.path, self.path + ".active"):
            if os.path.exists(path):
                return path
        return ""


def _unused(folder: str, name: str) -> str:
    """The name, or NAME-2 and so on: the first of which there is neither bag nor parameter file."""
    stem, ends = os.path.join(folder, name), (".bag", ".bag.active", ".yaml")
    paths = itertools.chain([stem], ("%s-%d" % (stem, number) for number in itertools.count(2)))
    unused = next(path for path in paths if not any(os.path.exists(path + end) for end in ends))
    return os.path.basename(unused)


def _heard_by(node: str) -> List[str]:
    """Topics from which a node has a connection; empty when it does not answer."""
    with contextlib.suppress(OSError, rosgraph.MasterException, xmlrpc.client.Error):
        uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
        _, _, rows = rospy.core.xmlrpcapi(uri).getBusInfo(rospy.get_name())
        return [str(row[4]) for row in rows if row[2] == "i" and (len(row) < 6 or row[5])]
    return []
