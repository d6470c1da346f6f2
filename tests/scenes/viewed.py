# SPDX-License-Identifier: Apache-2.0
"""A folder as `cotton3dg view` serves it, and a browser that has its address."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from pathlib import Path
from typing import Any

from cotton3dg.batch import save_tables
from cotton3dg.commands.view import Desk
from cotton3dg.io.local_server import LocalServer
from scenes.local_client import ask, serving


class Page:
    """Requests with the right token."""

    def __init__(self, server: LocalServer):
        self.server = server

    def gets(self, path: str) -> tuple[int, dict[str, str], bytes]:
        return ask(self.server, f"/{self.server.token}/{path}")

    def json(self, path: str) -> Any:
        status, _, content = self.gets(path)
        assert status == HTTPStatus.OK, content
        return json.loads(content)

    def posts(self, path: str, content: Any = None, **headers: str) -> tuple[int, Any]:
        body = content if isinstance(content, bytes) else json.dumps(content or {}).encode()
        status, _, answer = ask(self.server, f"/{self.server.token}/{path}", "POST", body, **headers)
        return status, json.loads(answer)


@contextmanager
def viewed(folder: Path) -> Iterator[Page]:
    """The folder while it is served."""
    desk = Desk(folder, save_tables)
    try:
        with serving(LocalServer(0, desk.answer, desk.most_bytes)) as server:
            yield Page(server)
    finally:
        desk.close()
