"""A laboratory on the wall's clock: a craft on UDP that moves by a model, and a mocap that sees it."""

import contextlib
import math
import os
import random
import socket
import threading
import time

import numpy as np
from fake_craft import SO_TIMESTAMPNS, STATE, Packet, decode_motors, receive

from ground import _core

STEP = 0.0045  # of the craft's motion, and from the exposure of a frame to its sending [s]
FRAME = 0.01  # between frames of the mocap [s]
FRICTION = 2.0  # deceleration by the floor without lift [m/s^2]
WATCHDOG = 0.25  # after which the craft's motors stop without commands [s]
HEIGHT = 0.04  # of the rigid body over the floor [m]


def ask_for_priority():
    """Gives the calling thread real-time priority, where the system grants it: a real craft does not wait."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(20))


class FakeLab:
    """model: file of the craft; motive: the FakeMotive that sees it as body 1.

    packets: those of the sender. spoil(pose): changes the bodies of a frame, or None: no frame is sent.
    last_good: when the newest frame was sent that nobody spoilt [s, time.time()].
    """

    def __init__(self, model, sender_port, motive, seed=1):
        self.motive, self.packets, self.spoil = motive, [], None
        self.eta, self.nu = np.zeros(3), np.zeros(3)
        self.last_good = time.time()
        self._model = _core.load_model(str(model))
        self._random = random.Random(seed)
        self._sender = ("127.0.0.1", sender_port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self._inputs, self._commanded = (0.0, 0.0, 0.0), 0.0
        self._alive, self._moving, self._moved = True, threading.Lock(), time.monotonic()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._hear, self._move)]
        for thread in self._threads:
            thread.start()

    def thrust_between(self, start, end):
        """Times of packets with thrust [s, time.time()]."""
        return [p.time for p in self.packets if start < p.time <= end and (p.left or p.right)]

    def body(self):
        """The craft as the mocap measures it now: number, position (y up), quaternion, whether it is seen."""
        x, y = (v + self._random.gauss(0, 0.0003) for v in self.eta[:2])
        half = -0.5 * (self.eta[2] + self._random.gauss(0, 0.005))
        return 1, (x, HEIGHT, y), (0.0, math.sin(half), 0.0, math.cos(half)), True

    def close(self):
        """Ends craft and mocap."""
        self._alive = False
        for thread in self._threads:
            thread.join()
        self._socket.close()
        self.motive.close()

    def _hear(self):
        ask_for_priority()
        said = 0.0
        while self._alive:
            if time.monotonic() - said > 0.05:
                said = time.monotonic()
                self._socket.sendto(STATE, self._sender)
            try:
                data, _, arrival = receive(self._socket)
            except socket.timeout:
                continue
            lift, _, right, left = ((v - 1000) / 1000 for v in decode_motors(data))
            with self._moving:
                self._advance()
                self._inputs, self._commanded = (left, right, lift), time.monotonic()
            self.packets.append(Packet(arrival, left, right, lift))

    def _advance(self):
        """Moves the craft until now."""
        now = time.monotonic()
        seconds, self._moved = now - self._moved, now
        inputs = self._inputs if now - self._commanded < WATCHDOG else (0.0, 0.0, 0.0)
        after = _core.simulate(self._model, [[0.0, *inputs]], [0.0, seconds], self.eta, self.nu)
        self.eta, self.nu = after["eta"][-1], after["nu"][-1]
        if inputs[2] == 0:  # it sits on the floor, which brakes it
            self.nu = self.nu * max(0.0, 1 - FRICTION * seconds / max(1e-9, np.hypot(*self.nu[:2])))

    def _move(self):
        ask_for_priority()
        exposed, seen = time.monotonic(), None
        while self._alive:
            time.sleep(STEP)
            with self._moving:
                self._advance()
                now = self._moved
                if seen is not None:
                    self._show(seen, now - exposed)
                    seen = None
                elif now - exposed >= FRAME - STEP / 2:
                    exposed, seen = now, self.body()

    def _show(self, body, age):
        """Sends a frame that was exposed `age` before [s]."""
        spoil = self.spoil
        bodies = [body] if spoil is None else spoil(body)
        if spoil is None and self.motive.spoil is None:
            self.last_good = time.time()
        if bodies is not None:
            self.motive.send(bodies, age)
