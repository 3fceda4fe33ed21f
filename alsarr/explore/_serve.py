"""A server on this machine alone that shows the explorer to its browsers."""

import asyncio
import errno
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from camojab._extras import needed


if TYPE_CHECKING:
    from bokeh.document import Document

    from ._workbench import Workbench


HOST = "127.0.0.1"
"""The loopback: no other machine reaches the server."""

# A file of the largest size in base 64, and what comes with it.
_MOST_MESSAGE = 24 * 2**20


def serve(
    *,
    port: int = 5006,
    ready: Callable[[str], None] = lambda address: None,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> None:
    """Show the explorer to browsers on this machine, until interrupted.

    What it needs is read and compiled first, which takes some ten seconds. Requests by
    another name than 127.0.0.1 or localhost, and of pages from elsewhere, are refused.

    **Arguments:**

    - `port`: to listen on at 127.0.0.1; 0 for any that is free. From 0 to 65535.
    - `ready`: called with the address once a browser may open it.
    - `progress`: called before with a stage's name, the steps done and their number.

    **Raises:** `ValueError` for a port that is out of range, in use or not allowed;
    `MissingExtra` without the extra `explore`; `KeyboardInterrupt` when interrupted,
    with everything closed.
    """
    for module in ("bokeh", "PIL"):
        needed("explore", module, "the explorer")
    from ._workbench import workbench

    with bound(port) as listening:
        bench = workbench(progress)
        try:
            asyncio.run(show(bench, listening, ready))
        finally:
            bench.close()


@contextmanager
def bound(port: int) -> Iterator[socket.socket]:
    """A socket that listens on a port of the loopback, closed in the end.

    **Raises:** `ValueError` for a port that cannot be had.
    """
    if not 0 <= port <= 65535:
        raise ValueError(f"`port` must be from 0 to 65535, got {port}.")
    try:
        listening = socket.create_server((HOST, port))
    except OSError as error:
        reasons = {
            errno.EADDRINUSE: "must be free (0 takes one that is)",
            errno.EACCES: "must be one that this user may listen on",
        }
        if error.errno not in reasons:
            raise
        raise ValueError(f"`port` {reasons[error.errno]}, got {port}.") from error
    with listening:
        listening.setblocking(False)
        yield listening


async def show(
    bench: "Workbench", listening: socket.socket, ready: Callable[[str], None]
) -> None:
    """Serve until cancelled. `ready`: called with the address, within the loop."""
    from bokeh.server.server import BaseServer
    from bokeh.server.tornado import BokehTornado
    from tornado.httpserver import HTTPServer
    from tornado.ioloop import IOLoop

    from ._origins import own_pages_alone
    from ._session import Session

    def new_page(document: "Document") -> None:
        Session(document, bench)

    port = listening.getsockname()[1]
    hosts = [f"{HOST}:{port}", f"localhost:{port}"]
    pages = BokehTornado(
        {"/": new_page},
        extra_websocket_origins=hosts,
        websocket_max_message_size_bytes=_MOST_MESSAGE,
    )
    http = HTTPServer(own_pages_alone(pages, hosts))
    http.add_socket(listening)
    server = BaseServer(IOLoop.current(), pages, http)
    server.start()
    try:
        ready(f"http://{HOST}:{port}/")
        await asyncio.Event().wait()
    finally:
        server.stop()
        await http.close_all_connections()
