# SPDX-License-Identifier: Apache-2.0
"""Who may ask the server of this machine, and what: all else is refused before its caller hears of it."""

import io
import json
import socket
from collections.abc import Iterator
from http import HTTPStatus

import pytest
from scenes.local_client import ask, serving

from cotton3dg.errors import BadInput, BadUsage
from cotton3dg.io import local_server
from cotton3dg.io.local_server import BYTES, GUARDED, HERE, JSON, Answer, LocalServer, Refused, Request, as_json

MOST = 1000


@pytest.fixture
def heard() -> list[Request]:
    return []


@pytest.fixture
def server(heard: list[Request]) -> Iterator[LocalServer]:
    def answer(request: Request) -> Answer:
        heard.append(request)
        if request.parts == ("ours",):
            raise BadInput("it is bad; mend it")
        if request.parts == ("fault",):
            raise ZeroDivisionError
        return as_json(
            {"parts": request.parts, "message": request.read().decode() if request.parts != ("unread",) else ""}
        )

    with serving(LocalServer(0, answer, lambda parts: MOST)) as server:
        yield server


def test_a_page_of_its_own_is_answered(server: LocalServer) -> None:
    status, headers, content = ask(server, f"/{server.token}/pl%C3%A4nt%201/report.html?x=1")
    assert (status, json.loads(content)["parts"]) == (200, ["plänt 1", "report.html"])
    assert GUARDED.items() <= headers.items() and "Access-Control-Allow-Origin" not in headers
    assert json.loads(ask(server, f"/{server.token}/")[2])["parts"] == []
    status, _, content = ask(server, f"/{server.token}/a", "POST", b'{"x": 1}')
    assert (status, json.loads(content)["message"]) == (200, '{"x": 1}')
    by_name = f"localhost:{server.server_port}"
    assert ask(server, f"/{server.token}/a", "POST", b"{}", Host=by_name, Origin=f"http://{by_name}")[0] == 200


@pytest.mark.parametrize(
    "path",
    ["/", "/wrong/a", "/wrong/", "/{}x/a", "/%C3%A9/", "/%FF/", "/a/{}/", "*", "http://127.0.0.1/{}/a", "http://[/{}/"],
)
def test_without_the_token_nothing_is_answered(server: LocalServer, heard: list[Request], path: str) -> None:
    assert ask(server, path.format(server.token))[0] == HTTPStatus.FORBIDDEN
    assert heard == []


@pytest.mark.parametrize("host", [None, "", "evil.example", "evil.example:{}", "127.0.0.1", "127.0.0.1:1", "[::1]:{}"])
def test_another_name_of_the_host_is_refused(server: LocalServer, heard: list[Request], host: str | None) -> None:
    """As a browser sends it when a page of another site lets its own name point here."""
    named = host and host.format(server.server_port)
    for method in ("GET", "POST"):
        assert ask(server, f"/{server.token}/a", method, b"{}", Host=named)[0] == HTTPStatus.FORBIDDEN
    assert heard == []


@pytest.mark.parametrize("origin", ["", "null", "http://evil.example", "https://127.0.0.1:{}", "http://127.0.0.1:1"])
def test_another_origin_is_refused(server: LocalServer, heard: list[Request], origin: str) -> None:
    for method in ("GET", "POST"):
        status = ask(server, f"/{server.token}/a", method, b"{}", Origin=origin.format(server.server_port))[0]
        assert status == HTTPStatus.FORBIDDEN
    localhost = f"http://localhost:{server.server_port}"
    assert ask(server, f"/{server.token}/a", Origin=localhost)[0] == HTTPStatus.FORBIDDEN
    assert ask(server, f"/{server.token}/a", "POST", b"{}", Origin=None)[0] == HTTPStatus.FORBIDDEN
    assert heard == []


@pytest.mark.parametrize(
    "path",
    ["..", "../a", "a/../b", "a/..", "./a", "a//b", "a/", "%2e%2e/a", "a%2fb", "..%2f..%2fetc", "a%5c..%5cb", "a%00b",
     "/etc/passwd", "%2fetc%2fpasswd"],
)  # fmt: skip
def test_no_path_leads_upwards(server: LocalServer, heard: list[Request], path: str) -> None:
    assert ask(server, f"/{server.token}/{path}")[0] == HTTPStatus.NOT_FOUND
    assert ask(server, f"/{server.token}/{path}", "POST", b"{}")[0] == HTTPStatus.NOT_FOUND
    assert heard == []


def test_a_content_that_is_too_large_or_of_unknown_length_is_refused(server: LocalServer, heard: list[Request]) -> None:
    path = f"/{server.token}/a"
    assert ask(server, path, "POST", b"x" * MOST)[0] == 200
    heard.clear()
    for length, status in ((str(MOST + 1), 413), ("9" * 5000, 413), ("-1", 411), ("1e3", 411), ("²", 411), (None, 411)):
        assert ask(server, path, "POST", b"", **{"Content-Length": length})[0] == status, length
    assert heard == []
    assert ask(server, path, "POST", None, **{"Transfer-Encoding": "chunked"})[0] == 411
    for kind in (None, "text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert ask(server, path, "POST", b"{}", **{"Content-Type": kind})[0] == 415
    assert heard == []
    assert ask(server, path, "POST", b"\0\1", **{"Content-Type": BYTES})[0] == 200


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "TRACE", "CONNECT", "PROPFIND"])
def test_other_methods_are_refused(server: LocalServer, heard: list[Request], method: str) -> None:
    assert ask(server, f"/{server.token}/a", method)[0] == HTTPStatus.NOT_IMPLEMENTED
    assert heard == []


def test_it_listens_at_this_machine_alone(server: LocalServer) -> None:
    assert server.server_address[0] == HERE == "127.0.0.1"
    assert server.address == f"http://127.0.0.1:{server.server_port}/{server.token}/"
    assert len(server.token) >= 32
    with pytest.raises(BadUsage, match=rf"--port {server.server_port} cannot be had"):
        LocalServer(server.server_port, server.answer, server.most_bytes)
    with socket.socket() as other, pytest.raises(OSError):
        other.settimeout(5)
        other.connect(("127.0.0.2", server.server_port))


def test_errors_are_told_and_faults_are_not(server: LocalServer, caplog: pytest.LogCaptureFixture) -> None:
    status, _, content = ask(server, f"/{server.token}/ours")
    assert (status, json.loads(content)) == (409, {"message": "it is bad; mend it"})
    status, _, content = ask(server, f"/{server.token}/fault")
    assert status == 500 and b"ZeroDivision" not in content and "ZeroDivisionError" in caplog.text


def test_an_answer_comes_though_the_content_was_not_read_and_a_torn_one_ends(
    server: LocalServer, heard: list[Request], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ask(server, f"/{server.token}/unread", "POST", b"x" * MOST)[0] == 200
    monkeypatch.setattr(local_server, "PART_BYTES", 10)
    assert json.loads(ask(server, f"/{server.token}/a", "POST", b"x" * 35)[2])["message"] == "x" * 35
    with socket.create_connection((HERE, server.server_port), timeout=30) as torn:
        own = f"{HERE}:{server.server_port}"
        torn.sendall(
            f"POST /{server.token}/a HTTP/1.0\r\nHost: {own}\r\nOrigin: http://{own}\r\nContent-Type: {JSON}\r\n"
            "Content-Length: 100\r\n\r\n{}".encode()
        )
        torn.shutdown(socket.SHUT_WR)
        assert torn.makefile("rb").read() == b""
    with pytest.raises(Refused, match="ended too early"):
        Request(True, (), io.BytesIO(b"{}"), 100).read()
