"""A server for a page on this computer alone: its files, actions that answer in JSON, and events."""

import gzip
import hmac
import json
import os
import re
import secrets
import sys
import threading
import traceback
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Callable, Dict, Optional, Tuple
from urllib.parse import parse_qs, urlsplit

from ground.support import errors, files
from ground.support.annotations import Document

MOST_BYTES = 64 * 1024  # of a request
MOST_DROPPED = 4 * 1024 * 1024  # of a request that is too long, read and dropped [bytes]
HOSTS = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?")
SILENCE = 10.0  # time after which an open page is sent a line, so that it sees that the server lives [s]
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
KINDS = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}
Action = Callable[[Document], Any]
File = Tuple[bytes, str]  # packed content, and kind


class Server(ThreadingHTTPServer):
    """Serves on the loopback address. files: by path; the page has the path "/", and is the only file that
    needs the secret. actions: by name, functions of a request's content. wait: returns the number of the
    newest state as soon as it differs from the given number, or after a time [s]."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(
        self, port: int, files: Dict[str, File], actions: Dict[str, Action], wait: Callable[[int, float], int]
    ) -> None:
        self.secret, self.files, self.actions, self.wait = secrets.token_urlsafe(24), files, actions, wait
        self._working, self._ended, self._idle = 0, False, threading.Condition()
        super().__init__(("127.0.0.1", port), Handler)

    def enter(self) -> bool:
        """Whether an action may begin."""
        with self._idle:
            self._working += not self._ended
            return not self._ended

    def leave(self) -> None:
        """An action has ended."""
        with self._idle:
            self._working -= 1
            self._idle.notify_all()

    def end(self) -> None:
        """Ends when no action is going on: a thread in the core must not outlive the interpreter."""
        with self._idle:
            self._ended = True
            self._idle.wait_for(lambda: not self._working)
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that was closed before its answer came is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        """The address to open, with the secret."""
        return "http://127.0.0.1:%d/?token=%s" % (self.server_address[1], self.secret)


class Handler(BaseHTTPRequestHandler):
    """One request. Refused: hosts that are not this computer, pages of other origins, wrong secrets, large
    requests."""

    protocol_version = "HTTP/1.1"
    timeout = 120
    server: Server

    def do_GET(self) -> None:
        """Sends the page, its parts, or events."""
        place = urlsplit(self.path)
        if not self._foreign():
            if place.path != "/" and place.path in self.server.files:  # the same for everybody
                self._send(200, *self.server.files[place.path], gzipped=True)
            elif not self._may(parse_qs(place.query).get("token", [""])[0]):
                self._refuse(403, "wrong or missing token: open the address that was printed")
            elif place.path == "/":
                self._send(200, *self.server.files["/"], gzipped=True)
            elif place.path == "/events":
                self._events()
            else:
                self._refuse(404, "there is no such page")

    def do_POST(self) -> None:
        """Does an action, whose content and answer are JSON."""
        if self._foreign():
            return
        if not self._may(self.headers.get("X-Token", "")):
            return self._refuse(403, "wrong or missing token")
        length = self.headers.get("Content-Length", "")
        if not length.isdigit() or int(length) > MOST_BYTES:
            if length.isdigit():
                self.rfile.read(min(int(length), MOST_DROPPED))  # else it would not read the answer
            return self._refuse(413, "a request may contain at most %d bytes" % MOST_BYTES)
        if self.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            return self._refuse(415, "a request is JSON")
        name = urlsplit(self.path).path.lstrip("/")
        if name not in self.server.actions:
            return self._refuse(404, "there is no action %s" % name[:40])
        if not self.server.enter():
            return self._refuse(503, "the server ends")
        try:
            content = json.loads(self.rfile.read(int(length)))
            if not isinstance(content, dict):
                raise ValueError("not an object")
            answer, status = self.server.actions[name](content), 200
        except errors.GroundError as error:
            answer, status = {"refused": errors.sentence(error)}, 400
        except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
            if os.environ.get("GROUND_DEBUG"):
                traceback.print_exc()
            answer, status = {"refused": "not a request of this page: %s" % str(error)[:200]}, 400
        finally:
            self.server.leave()
        body = json.dumps(files.plain(answer), separators=(",", ":")).encode()
        self._send(status, body, "application/json")

    def _events(self) -> None:
        """Tells the page, as long as it is open, the number of the newest state."""
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        seen = -1
        try:
            while True:
                seen = self.server.wait(seen, SILENCE)
                self.wfile.write(b"data: %d\n\n" % seen)
                self.wfile.flush()
        except OSError:
            pass  # the page was closed

    def _may(self, token: str) -> bool:
        return hmac.compare_digest(token.encode("utf-8", "replace"), self.server.secret.encode())

    def _foreign(self) -> bool:
        """Refuses a request that does not come from a page of this server: by another name of the host, as
        after DNS rebinding, or from another origin."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if not HOSTS.fullmatch(host):
            self._refuse(403, "this server accepts requests only from this computer")
        elif origin not in (None, "http://" + host) or self.headers.get("Sec-Fetch-Site") == "cross-site":
            self._refuse(403, "requests of other pages are refused")
        else:
            return False
        return True

    def _refuse(self, status: int, why: str) -> None:
        self.close_connection = True  # what follows may be what was too long
        self._send(status, json.dumps({"refused": why}).encode(), "application/json")

    def _send(self, status: int, body: bytes, kind: str, gzipped: bool = False) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind + "; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        if gzipped:
            self.send_header("Content-Encoding", "gzip")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *what: Any) -> None:
        """Nothing is printed of requests."""


def packed(name: str, content: str) -> File:
    """A file to serve."""
    return gzip.compress(content.encode(), 3), KINDS[os.path.splitext(name)[1]]


def serve(server: Server, ended: Optional[threading.Event] = None) -> None:
    """Serves until Ctrl-C, or until an event."""
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        (ended or threading.Event()).wait()
    finally:
        server.end()
