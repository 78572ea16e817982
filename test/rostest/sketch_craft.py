"""The craft of docs/howto/esp32_craft: the sketch, compiled for this computer with arduino.h."""

import os
import pathlib
import re
import subprocess
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
SKETCH = HERE.parents[1] / "docs" / "howto" / "esp32_craft" / "esp32_craft.ino"
CHANNELS = ("lift left", "lift right", "right", "left")  # of Motors, in the order of its fields
CHECKS = ("", "address,undefined", "thread")  # what the compiler watches in the running sketch


def compiled(folder, checks="", sketch=SKETCH):
    """The sketch as a program in a folder; any warning of the compiler is an error. None if this computer
    cannot run a program with these checks, whose memory is arranged in another way on some systems."""
    for header in re.findall(r"#include <(\w+\.h)>", sketch.read_text()):
        pathlib.Path(folder, header).write_text("")  # arduino.h has all of it
    program = os.path.join(str(folder), "craft_" + checks.partition(",")[0])
    command = os.environ.get("CXX", "c++").split() + ["-std=gnu++11", "-O1", "-Wall", "-Wextra", "-Werror"]
    command += ["-fsanitize=" + checks, "-fno-sanitize-recover=all"] if checks else []
    command += ["-pthread", "-I", str(folder), "-include", str(HERE / "arduino.h"), "-x", "c++", str(sketch)]
    subprocess.run(command + ["-o", program], check=True)
    trial = subprocess.run([program, "9", "0"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    return program if trial.returncode == 0 or not checks else None


class SketchCraft:
    """A craft that runs the sketch. `inputs` are its motors now, 0..1 by CHANNELS."""

    def __init__(self, program, ground_port, port):
        self.inputs = dict.fromkeys(CHANNELS, 0.0)
        self.changes = []  # time [s, time.time()], channel and input
        self.blocks = []  # times at which sending began to wait for the radio
        pins = re.search(r"kPins\[4\] = {(.*?)}", SKETCH.read_text()).group(1).split(",")
        self._channels = dict(zip(map(int, pins), CHANNELS))
        self._process = subprocess.Popen(
            [program, str(ground_port), str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            universal_newlines=True,
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self):
        for line in self._process.stdout:
            first, *rest = line.split()
            if first == "block":
                self.blocks.append(float(rest[0]))
            else:
                channel, value = self._channels[int(rest[0])], int(rest[1]) / 255
                self.inputs[channel] = value
                self.changes.append((float(first), channel, value))

    def off(self):
        return not any(self.inputs.values())

    def drives(self, left, right, lift):
        wanted = dict(zip(CHANNELS, (lift, lift, right, left)))
        return all(abs(self.inputs[c] - wanted[c]) < 0.01 for c in CHANNELS)

    def block(self, seconds):
        """Lets the next datagram that it sends wait for the radio; the time when it begins to wait."""
        before = len(self.blocks)
        self._process.stdin.write("block %g\n" % seconds)
        self._process.stdin.flush()
        while len(self.blocks) == before:
            time.sleep(0.001)
        return self.blocks[-1]

    def kill(self):
        """Ends it as a loss of power does."""
        self._process.kill()
        self._end()

    def close(self):
        """Ends it; returns what the compiler's checks found."""
        if self._process.stdin.closed:
            return ""
        return self._end()

    def _end(self):
        self._process.stdin.close()
        self._thread.join(10)
        found = self._process.stderr.read()
        self._process.wait(10)
        return found
