# SPDX-License-Identifier: Apache-2.0
"""A server for the browser of this machine alone. It guards the door; what lies behind it is its caller's.

The standard library's http.server does: one person asks for a few files of some MB. A framework would bring routes,
templates and speed that nobody needs here, and a dependency that has to be kept up to date.

Four checks stand before each answer. The address holds a random token. The name of the host has to be this machine's,
as a page of another site can let its own name point here (DNS rebinding). What changes something has to come from a
page of this server. No name in an address leads upwards or begins anew at the root.
"""

from __future__ import annotations

import json
import logging
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedIOBase
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from ..errors import BadUsage, Cotton3dgError
from .saving import PART_BYTES, explained

HERE: Final = "127.0.0.1"
"""The only address that it listens at; no other machine reaches it."""
NAMES: Final = (HERE, "localhost")
SILENT_S: Final = 60
"""How long a browser may be silent in the middle of a request."""
HTML: Final = "text/html; charset=utf-8"
JSON: Final = "application/json"
BYTES: Final = "application/octet-stream"
SENT: Final = (JSON, BYTES)
"""Kinds of content that it takes. A page of another origin has to ask before it sends them, and gets no leave."""
GUARDED: Final = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of each answer: its address, which holds the token, stays in this tab, and no other page shows it."""
log = logging.getLogger("cotton3dg")


@dataclass(frozen=True)
class Answer:
    """What the browser gets."""

    content: bytes
    kind: str = JSON
    status: HTTPStatus = HTTPStatus.OK
    headers: Mapping[str, str] = field(default_factory=dict)


class Refused(Exception):
    """A request that gets no answer but why."""

    def __init__(self, status: HTTPStatus, words: str):
        super().__init__(words)
        self.status = status


@dataclass
class Request:
    """A request that has passed the checks."""

    posts: bool
    """Whether it may change something (POST); else it only asks (GET)."""
    parts: tuple[str, ...]
    """The names in its path, behind the token."""
    source: BufferedIOBase
    left: int
    """Bytes of its content that are not read yet."""

    def chunks(self) -> Iterator[bytes]:
        """Its content, part by part.

        Raises:
            Refused: the browser has sent less than it announced.
        """
        while self.left:
            chunk = self.source.read(min(self.left, PART_BYTES))
            if not chunk:
                raise Refused(HTTPStatus.BAD_REQUEST, "the content has ended too early; send it again")
            self.left -= len(chunk)
            yield chunk

    def read(self) -> bytes:
        return b"".join(self.chunks())


def as_json(value: Any, status: HTTPStatus = HTTPStatus.OK) -> Answer:
    return Answer(json.dumps(value).encode(), JSON, status)


class LocalServer(ThreadingHTTPServer):
    """Listens at a port of this machine.

    Args:
        port: 0 = any that is free.
        answer: gives the answer to a request, in a thread of its own; the browser gets the text of a Cotton3dgError.
        most_bytes: the largest content that a request with these names in its path may have.
    Raises:
        BadUsage: the port cannot be had.
    """

    def __init__(self, port: int, answer: Callable[[Request], Answer], most_bytes: Callable[[tuple[str, ...]], int]):
        self.token = secrets.token_urlsafe(24)
        self.answer, self.most_bytes = answer, most_bytes
        try:
            super().__init__((HERE, port), _Guard)
        except (OSError, OverflowError) as error:
            raise BadUsage(f"--port {port} cannot be had ({error}); leave it out, or give another one") from error

    @property
    def address(self) -> str:
        return f"http://{HERE}:{self.server_port}/{self.token}/"


class _Guard(BaseHTTPRequestHandler):
    """Lets through what comes from the person at this machine, and tells the browser no more than it needs."""

    server: LocalServer
    server_version, sys_version = "cotton3dg", ""
    timeout = SILENT_S

    def do_GET(self) -> None:
        self._serve(posts=False)

    def do_POST(self) -> None:
        self._serve(posts=True)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the address holds the token, and nobody watches the terminal."""

    def _serve(self, *, posts: bool) -> None:
        request = None
        try:
            request = Request(posts, self._admit(posts), self.rfile, 0)
            request.left = self._announced(request.parts) if posts else 0
            answer = self.server.answer(request)
        except Refused as refused:
            answer = as_json({"message": str(refused)}, refused.status)
        except Cotton3dgError as error:
            answer = as_json({"message": str(error)}, HTTPStatus.CONFLICT)
        except (ConnectionError, TimeoutError):
            return  # the browser has left
        except OSError as error:
            answer = as_json({"message": str(explained(error, Path("the folder")))}, HTTPStatus.CONFLICT)
        except Exception:
            log.exception("an answer to the browser")
            answer = as_json({"message": "a fault of the program; the terminal has the details"}, HTTPStatus(500))
        try:
            if request:
                for _ in request.chunks():  # a browser reads no answer before it has sent all
                    pass
            self._send(answer)
        except (ConnectionError, TimeoutError, Refused):
            pass

    def _admit(self, posts: bool) -> tuple[str, ...]:
        """The names in the path behind the token.

        Raises:
            Refused: a check fails.
        """
        host = self.headers.get("Host", "")
        if host not in [f"{name}:{self.server.server_port}" for name in NAMES]:
            raise Refused(HTTPStatus.FORBIDDEN, "another host")
        origin = self.headers.get("Origin", "" if posts else None)
        if origin not in (None, f"http://{host}"):
            raise Refused(HTTPStatus.FORBIDDEN, "another origin")
        path = self.path.partition("?")[0].partition("/")[2]
        token, *parts = map(unquote, path.split("/"))
        if not secrets.compare_digest(token.encode(errors="replace"), self.server.token.encode()):
            raise Refused(HTTPStatus.FORBIDDEN, "another address; open the one that the terminal shows")
        if parts == [""]:
            return ()
        if not parts or any(part in ("", ".", "..") or set(part) & set("/\\\0") for part in parts):
            raise Refused(HTTPStatus.NOT_FOUND, "there is no such page")
        return tuple(parts)

    def _announced(self, parts: tuple[str, ...]) -> int:
        """Bytes of the content.

        Raises:
            Refused: its length is missing or too large, or any page could send content of its kind.
        """
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal()):
            raise Refused(HTTPStatus.LENGTH_REQUIRED, "the length is missing")
        if self.headers.get("Content-Type") not in SENT:
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "another kind of content")
        if len(length) > 18 or int(length) > self.server.most_bytes(parts):
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "this is too large")
        return int(length)

    def _send(self, answer: Answer) -> None:
        self.send_response(answer.status)
        for name, value in (GUARDED | dict(answer.headers)).items():
            self.send_header(name, value)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.content)))
        self.end_headers()
        self.wfile.write(answer.content)
