"""The page's server: this machine only, behind a token, until Done or Ctrl-C."""

from __future__ import annotations

import errno
import json
import secrets
import threading
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from lcdata.errors import CalibrationError, LcdataError
from lcdata.pick.session import Session

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page.html")

LARGEST_BODY = 1 << 20
"""A thousand matches are 100 kB."""

POLICY = (
    "default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'"
)
"""The page loads nothing from elsewhere, and sends nothing there."""


class PickServer:
    """Serves the page of a session; use it as a context manager.

    Args:
        session: What the page shows.
        port: Where to listen; 0 for any free port.

    Attributes:
        url: The page's address with its token.

    Raises:
        CalibrationError: The port is taken, or must not be used.
    """

    def __init__(self, session: Session, port: int = 0) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(16)
        try:
            self._http = ThreadingHTTPServer((HOST, port), _handler(self))
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            taken = error.errno == errno.EADDRINUSE
            why = "is in use, by another `lcdata pick`?" if taken else "must not be used"
            raise CalibrationError(
                f"port {port} {why}", "end that one, or leave --port out for a free one"
            ) from error
        self.port = int(self._http.server_address[1])
        self.url = f"http://{HOST}:{self.port}/{self.token}/"

    def serve(self) -> None:
        """Answer until the page says Done, or Ctrl-C."""
        self._http.daemon_threads = True
        with suppress(KeyboardInterrupt):
            self._http.serve_forever(poll_interval=0.1)

    def stop(self) -> None:
        """End `serve`, from another thread than its own."""
        threading.Thread(target=self._http.shutdown, daemon=True).start()

    def close(self) -> None:
        """Free the port."""
        self._http.server_close()

    def __enter__(self) -> PickServer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _handler(server: PickServer) -> type[BaseHTTPRequestHandler]:
    session = server.session
    pages: dict[str, tuple[str, Callable[[], bytes]]] = {
        "": ("text/html; charset=utf-8", PAGE.read_bytes),
        "state": ("application/json", lambda: _json(session.state())),
        "image.jpg": ("image/jpeg", session.image),
        "intensity.png": ("image/png", session.intensity),
        "range.png": ("image/png", session.range),
    }

    def done(_: Any) -> dict[str, Any]:
        server.stop()
        return {}

    actions: dict[str, Callable[[Any], dict[str, Any]]] = {
        "point": lambda content: session.point(float(content[0]), float(content[1])),
        "solve": session.solve,
        "save": session.save,
        "done": done,
    }

    class Handler(BaseHTTPRequestHandler):
        server_version = "lcdata"
        sys_version = ""
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            name = self._name()
            if name is None:
                return
            if name not in pages:
                self._answer(404, "text/plain", b"not found")
                return
            kind, content = pages[name]
            self._answer(200, kind, content())

        def do_POST(self) -> None:
            name = self._name()
            if name is None:
                return
            length = int(self.headers.get("Content-Length") or 0)
            if name not in actions or not 0 < length <= LARGEST_BODY:
                self.close_connection = True
                self._answer(404, "text/plain", b"not found")
                return
            body = self.rfile.read(length)
            try:
                answer = actions[name](json.loads(body))
            except LcdataError as error:
                answer = {"error": str(error)}
            except (ValueError, TypeError, LookupError):
                self._answer(400, "text/plain", b"not what the page sends")
                return
            self._answer(200, "application/json", _json(answer))

        def _name(self) -> str | None:
            """What is asked for; None, and an answer, where it is not our page that asks."""
            ours = {f"{host}:{server.port}" for host in (HOST, "localhost")}
            origin = self.headers.get("Origin")
            if self.headers.get("Host") not in ours or (
                origin is not None and origin.removeprefix("http://") not in ours
            ):
                self.close_connection = True
                self._answer(403, "text/plain", b"only from this machine's own page")
                return None
            _, token, *rest = [*self.path.partition("?")[0].split("/"), ""]
            if not secrets.compare_digest(token.encode(), server.token.encode()):
                self.close_connection = True
                self._answer(404, "text/plain", b"not found")
                return None
            return rest[0]

        def _answer(self, status: int, kind: str, content: bytes) -> None:
            self.send_response(status)
            for name, value in {
                "Content-Type": kind,
                "Content-Length": str(len(content)),
                "Cache-Control": "no-store",
                "Content-Security-Policy": POLICY,
                "X-Content-Type-Options": "nosniff",
                "Referrer-Policy": "no-referrer",
            }.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """A terminal has better things to show than requests."""

    return Handler


def _json(content: Any) -> bytes:
    return json.dumps(content, allow_nan=False).encode()
