"""Requests to the server of the page: results, and one error for each wrong request."""

from __future__ import annotations

import http.client
import json

import pytest
from tests.articulate.studio.objects import write_cupboard

from articulate.errors import UsageError
from articulate.studio.checker import Checker
from articulate.studio.server import MAX_BODY, StudioServer
from articulate.studio.session import Session
from articulate.studio.source import read_studio_source

EDIT = {"type": "set_joint", "part": "door", "upper": 1.0}


class NoChecker(Checker):
    """Checks nothing."""

    def start(self, model, revision):
        """Do nothing."""


@pytest.fixture
def server(tmp_path):
    source = read_studio_source(write_cupboard(tmp_path / "in"))
    checker = NoChecker(tmp_path / "cache", 60.0, dict(source.licence))
    session = Session(source=source, out=tmp_path / "out", checker=checker)
    with StudioServer(session) as served:
        served.start()
        yield served
        served.shutdown()
    session.close()


def request(server, method, path, body=None, *, token=None, headers=None):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    text = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    extra = {"Content-Type": "application/json"} if body is not None else {}
    connection.request(
        method, f"/{token or server.token}/{path}", text, {**extra, **(headers or {})}
    )
    response = connection.getresponse()
    content = response.read()
    connection.close()
    return response, content


def test_the_page_loads_nothing_from_elsewhere(server):
    for path in ("", "studio.js", "view.js", "studio.css", "three.min.js"):
        response, content = request(server, "GET", path)
        assert response.status == 200
        assert content
        assert "default-src 'none'" in response.headers["Content-Security-Policy"]
        if path != "three.min.js":
            assert b"http://" not in content
            assert b"https://" not in content


def test_an_edit_changes_the_state_and_can_be_undone(server):
    response, content = request(server, "POST", "edit", EDIT)
    assert response.status == 200
    state = json.loads(content)
    assert state["parts"][1]["joint"]["upper"] == 1.0
    assert state["history"] == ["set joint door: upper 1"]
    assert server.session.autosave.is_file()
    state = json.loads(request(server, "POST", "undo", {})[1])
    assert state["parts"][1]["joint"]["upper"] == 1.5
    assert state["can_redo"]
    state = json.loads(request(server, "POST", "redo", {})[1])
    assert state["parts"][1]["joint"]["upper"] == 1.0
    geometry = json.loads(request(server, "GET", "geometry")[1])
    assert set(geometry) == {key for part in state["parts"] for key in part["pieces"]}


def test_an_interrupted_session_continues(server):
    request(server, "POST", "edit", EDIT)
    old = server.session
    again = Session(source=old.source, out=old.out, checker=old.checker)
    assert again.model.joint("door").upper == 1.0


def test_a_click_is_answered_with_an_axis(server):
    body = {"part": "door", "mode": "edge", "point": [-0.2, 0.3, 0.5]}
    assert json.loads(request(server, "POST", "snap", body)[1])["pivot"][1] == pytest.approx(0.3)
    for wrong in ({"mode": "edge"}, {**body, "mode": "x"}, {**body, "point": None}):
        assert request(server, "POST", "snap", wrong)[0].status == 422


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"token": "x"}, 403),
        ({"headers": {"Host": "example.org"}}, 403),
        ({"headers": {"Origin": "http://example.org"}}, 403),
        ({"headers": {"Content-Type": "text/plain"}}, 415),
        ({"headers": {"Content-Length": str(MAX_BODY + 1)}}, 413),
        ({"body": b"\xff"}, 400),
        ({"body": b"[1]"}, 422),
        ({"body": b'{"type": "set_joint", "part": "door", "upper": NaN}'}, 422),
        ({"body": {"type": "set_joint", "part": "window"}}, 422),
        ({"path": "../../etc/passwd"}, 404),
    ],
)
def test_a_wrong_request_changes_nothing(server, change, status):
    options = {"path": "edit", "body": EDIT, **change}
    path, body = options.pop("path"), options.pop("body")
    response, content = request(server, "POST", path, body, **options)
    assert response.status == status
    assert "\n" not in json.loads(content)["error"]
    assert server.session.edits == ()


def test_files_outside_are_not_served(server):
    for path in ("../studio.py", "input/0", "input/-1", "trace", "%2e%2e/x", "assets/studio.js"):
        assert request(server, "GET", path)[0].status == 404


def test_a_port_in_use_is_one_line(server):
    with pytest.raises(UsageError, match="choose another --port"):
        StudioServer(server.session, server.server_port)
