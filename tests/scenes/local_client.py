# SPDX-License-Identifier: Apache-2.0
"""A browser that may lie: requests to a server of this machine, header by header."""

import http.client
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from cotton3dg.io.local_server import HERE, JSON, LocalServer

ANSWER_S = 600
"""A busy machine must not fail what works."""


@contextmanager
def serving(server: LocalServer) -> Iterator[LocalServer]:
    """The server at work in a thread."""
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:  # else a test that fails would leave the thread, and pytest would never end
            server.shutdown()
            thread.join()


def ask(
    server: LocalServer, path: str, method: str = "GET", body: bytes | None = None, **headers: str | None
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and content of an answer; a header that is None is left out."""
    own = f"{HERE}:{server.server_port}"
    usual = {"Host": own} | ({"Origin": f"http://{own}", "Content-Type": JSON} if method == "POST" else {})
    given = usual | {name.replace("_", "-"): value for name, value in headers.items()}
    connection = http.client.HTTPConnection(HERE, server.server_port, timeout=ANSWER_S)
    connection.putrequest(method, path, skip_host=True)
    if body is not None and "Content-Length" not in given:
        given["Content-Length"] = str(len(body))
    for name, value in given.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders(body)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found
