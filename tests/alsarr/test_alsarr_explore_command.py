"""`alsarr explore`: ports, what is missing, and how it ends."""

import http.client
import os
import re
import signal
import socket
import sys
import threading
from contextlib import closing

import pytest

from alsarr import explore
from alsarr.cli import main
from alsarr.explore import _serve, _workbench


class Bench:
    """In the place of textures, a frame and compiled figures."""

    closed = False

    def close(self):
        self.closed = True


@pytest.fixture
def bench(monkeypatch):
    made = Bench()
    monkeypatch.setattr(_workbench, "workbench", lambda progress: made)
    return made


@pytest.fixture
def taken():
    """A port of the loopback that something listens on."""
    with closing(socket.create_server(("127.0.0.1", 0))) as listening:
        yield listening.getsockname()[1]


def sentence(capsys):
    return capsys.readouterr().err.strip()


def test_a_port_in_use_is_a_sentence(bench, taken, capsys):
    assert main(["explore", "--no-browser", "--port", str(taken)]) == 1
    said = f"alsarr: `--port` must be free (0 takes one that is), got {taken}."
    assert sentence(capsys) == said
    assert not bench.closed


@pytest.mark.parametrize("port", ["-1", "65536", "five"])
def test_a_port_that_is_none_is_a_wrong_command_line(port, capsys):
    assert main(["explore", "--port", port]) == 2
    assert "--port" in sentence(capsys)


@pytest.mark.parametrize("port", [-1, 65536])
def test_the_library_checks_the_port_too(port):
    with pytest.raises(ValueError, match=f"`port` must be .* 65535, got {port}.$"):
        explore.serve(port=port)


@pytest.mark.parametrize("module", ["bokeh", "PIL"])
def test_a_missing_extra_is_a_sentence(module, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["explore", "--no-browser", "--port", "0"]) == 1
    said = f"`alsarr[explore]` is not installed: the explorer needs its {module}."
    assert sentence(capsys) == f"alsarr: {said}"


def interrupted_once_ready(monkeypatch, seen):
    """Interrupt this process as Ctrl-C does, when the server says it is there."""
    show = _serve.show

    async def watched(bench, listening, ready):
        def then(address):
            ready(address)
            seen.append((address, listening.getsockname()[0]))
            # From outside the loop, and not before it goes on.
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()

        await show(bench, listening, then)

    monkeypatch.setattr(_serve, "show", watched)


def test_it_says_where_it_is_and_ends_with_an_interruption(bench, monkeypatch, capsys):
    seen, opened = [], []
    interrupted_once_ready(monkeypatch, seen)
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert main(["explore", "--no-browser", "--port", "0"]) == 130
    ((address, host),) = seen
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", address)
    assert host == "127.0.0.1"
    printed = capsys.readouterr()
    assert printed.out == f"explorer at {address}, Ctrl-C ends it\n"
    assert "Traceback" not in printed.err
    assert bench.closed and opened == []
    # Nothing listens there any more.
    port = int(address.rsplit(":", 1)[1].strip("/"))
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=5).close()


def test_a_browser_is_opened_unless_told_not_to(bench, monkeypatch):
    seen, opened = [], threading.Event()
    interrupted_once_ready(monkeypatch, seen)
    monkeypatch.setattr("webbrowser.open", lambda address: opened.set())
    assert main(["explore", "--port", "0"]) == 130
    assert opened.wait(10)


def status(address, path, **headers):
    host, port = re.fullmatch(r"http://(.*):(\d+)/", address).groups()
    with closing(http.client.HTTPConnection(host, int(port), timeout=20)) as asked:
        asked.request("GET", path, headers=headers)
        return asked.getresponse().status


UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
}


EVIL = "evil.example"

# A path, what is sent with it, where {} is the port, and what is answered.
ASKED = {
    "page": ("/metadata", {}, 200),
    "by its other name": ("/metadata", {"Host": "localhost:{}"}, 200),
    "part of a page": ("/static/js/bokeh.min.js", {}, 200),
    "connection": ("/ws", {**UPGRADE, "Origin": "http://127.0.0.1:{}"}, 101),
    "no page": ("/ws", UPGRADE, 101),
    "other page": ("/ws", {**UPGRADE, "Origin": "http://example.org"}, 403),
    "page of a file": ("/ws", {**UPGRADE, "Origin": "null"}, 403),
    "other port": ("/ws", {**UPGRADE, "Origin": "http://127.0.0.1:1"}, 403),
    "other scheme": ("/ws", {**UPGRADE, "Origin": "https://127.0.0.1:{}"}, 403),
    # A name of somebody else's that leads to this machine.
    "other name": (
        "/ws",
        {**UPGRADE, "Host": EVIL + ":{}", "Origin": f"http://{EVIL}:{{}}"},
        403,
    ),
    "page by another name": ("/", {"Host": EVIL + ":{}"}, 403),
    "data by another name": ("/metadata", {"Host": EVIL + ":{}"}, 403),
    "part by another name": ("/static/js/bokeh.min.js", {"Host": EVIL}, 403),
    "name without a port": ("/metadata", {"Host": "localhost"}, 403),
    "data for another page": ("/metadata", {"Origin": f"http://{EVIL}"}, 403),
}


@pytest.mark.parametrize("environment", [{}, {"BOKEH_ALLOW_WS_ORIGIN": "*"}])
def test_pages_of_other_origins_get_no_connection(bench, monkeypatch, environment):
    for variable, value in environment.items():
        monkeypatch.setenv(variable, value)
    found, show = {}, _serve.show

    async def asked(bench, listening, ready):
        port = listening.getsockname()[1]

        def then(address):
            def ask():
                for name, (path, headers, _) in ASKED.items():
                    sent = {key: text.format(port) for key, text in headers.items()}
                    found[name] = status(address, path, **sent)
                os.kill(os.getpid(), signal.SIGINT)

            threading.Thread(target=ask).start()

        await show(bench, listening, then)

    monkeypatch.setattr(_serve, "show", asked)
    with pytest.raises(KeyboardInterrupt):
        explore.serve(port=0)
    assert found == {name: answer for name, (*_, answer) in ASKED.items()}
