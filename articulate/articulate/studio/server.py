"""HTTP server of the page, on the loopback interface, for the holder of a token."""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any

from articulate.errors import ArticulateError, UsageError, quote
from articulate.studio.candidates import snap
from articulate.studio.edits import parse_edit
from articulate.studio.session import Session
from articulate.untrusted import parse_json_object

HOST = "127.0.0.1"
MAX_BODY = 16_000_000
"""Largest body of a request [bytes]."""
MAX_BODY_DEPTH = 6
READ_S = 20.0
"""Longest wait for a request [s]."""
SNAP_MODES = ("edge", "face", "axle")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "media-src 'self'; connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
TRACE_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; media-src data:; "
    "frame-ancestors 'self'"
)
OWN = resources.files("articulate.studio").joinpath("assets")
VIEWER = resources.files("articulate.asset_page").joinpath("assets")
FILES = {
    "": (OWN, "studio.html", "text/html; charset=utf-8"),
    "studio.css": (OWN, "studio.css", "text/css; charset=utf-8"),
    "view.js": (OWN, "view.js", "text/javascript; charset=utf-8"),
    "studio.js": (OWN, "studio.js", "text/javascript; charset=utf-8"),
    "three.min.js": (VIEWER, "three.min.js", "text/javascript; charset=utf-8"),
}


class StudioServer(ThreadingHTTPServer):
    """Serves one session.

    Args:
        session: Object and its history.
        port: Port; 0 chooses a free one.

    Raises:
        UsageError: The port is in use or not permitted.
    """

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, session: Session, port: int = 0) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(18)
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise UsageError(
                f"port {port}: {error.strerror}; choose another --port, or 0 for a free one"
            ) from None

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    def start(self) -> threading.Thread:
        """Serve in a thread; for tests and scripts."""
        thread = threading.Thread(target=self.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        return thread

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore connections that the browser has closed."""


class _RequestError(Exception):
    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


class _Handler(BaseHTTPRequestHandler):
    server: StudioServer
    protocol_version = "HTTP/1.1"
    server_version = "articulate"
    sys_version = ""
    timeout = READ_S

    def do_GET(self) -> None:
        self._handle(self._get)

    def do_POST(self) -> None:
        self._handle(self._post)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: the address holds the token."""

    def _handle(self, method: Callable[[str], None]) -> None:
        try:
            method(self._checked_path())
        except _RequestError as error:
            self.close_connection = True
            self._send_json({"error": str(error)}, error.status)
        except UsageError as error:
            self._send_json({"error": str(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
        except ArticulateError as error:
            self._send_json({"error": str(error)}, HTTPStatus.INTERNAL_SERVER_ERROR)

    def _checked_path(self) -> str:
        """Return the path below the token.

        Raises:
            _RequestError: The host, origin or token is wrong.
        """
        port = self.server.server_port
        hosts = {f"{HOST}:{port}", f"localhost:{port}"}
        if self.headers.get("Host", "") not in hosts:
            raise _RequestError(HTTPStatus.FORBIDDEN, "this host name is not served")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            raise _RequestError(HTTPStatus.FORBIDDEN, "requests of other pages are not served")
        _, _, rest = self.path.partition("/")
        token, slash, path = rest.partition("/")
        received = token.encode("utf-8", errors="replace")
        if not slash or not hmac.compare_digest(received, self.server.token.encode()):
            raise _RequestError(HTTPStatus.FORBIDDEN, "the token is wrong; use the printed address")
        return path

    def _get(self, path: str) -> None:
        session = self.server.session
        if path in FILES:
            folder, name, mime = FILES[path]
            self._send(folder.joinpath(name).read_bytes(), mime, POLICY)
        elif path == "state":
            self._send_json(session.state())
        elif path == "check":
            self._send_json(session.check_state())
        elif path == "geometry":
            self._send_json(session.geometry())
        elif path == "trace" and session.source.trace is not None:
            self._send(session.source.trace, "text/html; charset=utf-8", TRACE_POLICY)
        elif path.startswith("input/") and path[6:] in map(str, range(len(session.source.inputs))):
            self._send_media(session.source.inputs[int(path[6:])])
        else:
            raise _RequestError(HTTPStatus.NOT_FOUND, f"no page {quote(path)}")

    def _post(self, path: str) -> None:
        body = self._body()
        session = self.server.session
        actions: dict[str, Callable[[], object]] = {
            "undo": session.undo,
            "redo": session.redo,
            "export": session.export,
        }
        if path == "edit":
            session.apply(parse_edit(body))
        elif path == "snap":
            self._send_json(self._snap(body))
            return
        elif path in actions:
            actions[path]()
        else:
            raise _RequestError(HTTPStatus.NOT_FOUND, f"no action {quote(path)}")
        self._send_json(session.state())

    def _snap(self, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the axis at a clicked point; the fields are validated like those of an edit."""
        mode = body.get("mode")
        if mode not in SNAP_MODES or set(body) - {"mode", "part", "point", "normal"}:
            raise UsageError(f"snap mode {quote(mode)}; accepted: {', '.join(SNAP_MODES)}")
        fields = {"type": "set_joint", "part": body.get("part"), "pivot_o": body.get("point")}
        if mode != "edge":
            fields["axis_o"] = body.get("normal")
        edit: Any = parse_edit(fields)
        if edit.pivot_o is None:
            raise UsageError("snap: point is missing")
        link = self.server.session.model.link(edit.part)
        found = snap(link, edit.pivot_o, mode, edit.axis_o)
        return {"axis": list(found.axis_o), "pivot": list(found.pivot_o)}

    def _body(self) -> dict[str, Any]:
        if self.headers.get_content_type() != "application/json":
            raise _RequestError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "JSON is needed")
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdigit() or len(length) > 12:
            raise _RequestError(HTTPStatus.LENGTH_REQUIRED, "the length is missing")
        if int(length) > MAX_BODY:
            raise _RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"more than {MAX_BODY} bytes")
        content = self.rfile.read(int(length))
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError:
            raise _RequestError(HTTPStatus.BAD_REQUEST, "not text in UTF-8") from None
        return parse_json_object(text, "request", max_depth=MAX_BODY_DEPTH)

    def _send_media(self, entry: Any) -> None:
        """Send an input, or the range of it that a video player requests."""
        content, total = entry.content, len(entry.content)
        start, _, end = self.headers.get("Range", "").removeprefix("bytes=").partition("-")
        if not (start.isdigit() and start.isascii() and len(start) < 12 and int(start) < total):
            self._send(content, entry.mime, POLICY, {"Accept-Ranges": "bytes"})
            return
        last = int(end) if end.isdigit() and end.isascii() and len(end) < 12 else total - 1
        last = max(min(last, total - 1), int(start))
        span = {"Content-Range": f"bytes {start}-{last}/{total}", "Accept-Ranges": "bytes"}
        part = content[int(start) : last + 1]
        self._send(part, entry.mime, POLICY, span, HTTPStatus.PARTIAL_CONTENT)

    def _send_json(self, content: Any, status: HTTPStatus = HTTPStatus.OK) -> None:
        text = json.dumps(content, allow_nan=False, separators=(",", ":"))
        self._send(text.encode(), "application/json", POLICY, status=status)

    def _send(
        self,
        content: bytes,
        mime: str,
        policy: str,
        more: Mapping[str, str] | None = None,
        status: HTTPStatus = HTTPStatus.OK,
    ) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": mime,
            "Content-Length": str(len(content)),
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            **(more or {}),
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)
