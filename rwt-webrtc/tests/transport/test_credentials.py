"""STUN and TURN servers: where they come from, how long a credential is used, and what cannot be one."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from threading import Thread

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_webrtc.transport.credentials import IceServers, IceSource, NoIceServers, read_credential
from rwt_webrtc.transport.ice_servers import BadIceServer, IceServer, check_ice_url

STUN, TURN = "stun:stun.example.org", "turn:turn.example.org:3478?transport=udp"
CREDENTIAL = {"username": "17:robot", "password": "secret", "ttl": 600}


class Hours:
    """A clock of the test's own."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@contextmanager
def answering(body: bytes, status: int = 200) -> Iterator[tuple[str, list[str]]]:
    """A web server on loopback that answers every request the same; its URL, and the paths asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(status)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """No-op: messages are not logged."""

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/turn", asked
        server.shutdown()
        thread.join()


@pytest.mark.anyio
async def test_what_the_settings_name() -> None:
    assert await IceServers(IceSource((STUN, TURN), "robot", "secret")).find() == (
        IceServer(STUN), IceServer(TURN, "robot", "secret"),
    )  # fmt: skip
    assert await IceServers(IceSource()).find() == ()


@pytest.mark.anyio
async def test_a_command_is_asked_again_when_half_of_its_time_is_over(tmp_path: Path) -> None:
    count = tmp_path / "count"
    program = (
        f"import json, pathlib; path = pathlib.Path({str(count)!r});"
        " n = path.stat().st_size if path.exists() else 0; path.write_text('x' * (n + 1));"
        " print(json.dumps({'username': str(n), 'password': 'p', 'ttl': 600}))"
    )
    clock = Hours()
    servers = IceServers(IceSource((TURN,), command=(sys.executable, "-c", program)), clock)
    first = await servers.find()
    assert first == (IceServer(TURN, "0", "p"),)
    clock.now = 299.0
    assert await servers.find() == first
    clock.now = 300.0
    assert await servers.find() == (IceServer(TURN, "1", "p"),)


@pytest.mark.anyio
async def test_a_url_is_asked() -> None:
    with answering(json.dumps({**CREDENTIAL, "uris": [TURN]}).encode()) as (url, asked):
        found = await IceServers(IceSource((STUN,), url=url)).find()
    assert found == (IceServer(STUN), IceServer(TURN, "17:robot", "secret"))
    assert asked == ["/turn"]


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("command", "why"),
    [
        (("/no/such/program",), "/no/such/program cannot be run"),
        ((sys.executable, "-c", "raise SystemExit(3)"), "it ended with 3"),
        ((sys.executable, "-c", "print('hello')"), "a TURN credential is JSON"),
    ],
)
async def test_a_command_that_gives_none(command: tuple[str, ...], why: str) -> None:
    with pytest.raises(NoIceServers, match=why):
        await IceServers(IceSource((TURN,), command=command)).find()


@pytest.mark.anyio
async def test_a_url_that_gives_none() -> None:
    with answering(b"", 500) as (url, _), pytest.raises(NoIceServers, match="500"):
        await IceServers(IceSource((TURN,), url=url)).find()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"username": 5}, "no `username` and `password`"),
        ({"ttl": 0}, "`ttl` 0"),
        ({"ttl": True}, "`ttl` True"),
        ({"uris": "turn:x"}, "`uris` that are no list"),
        ({"uris": ["http://x"]}, "no STUN or TURN server"),
    ],
)
def test_what_is_no_credential(change: dict[str, object], why: str) -> None:
    with pytest.raises(NoIceServers, match=why):
        read_credential(json.dumps({**CREDENTIAL, **change}).encode(), ())


@given(st.binary(max_size=100) | st.from_regex(r'\{"(username|ttl|uris)": *[\[\{0-9"e]+', fullmatch=True))
def test_no_text_raises_anything_else(text: str | bytes) -> None:
    try:
        read_credential(text if isinstance(text, bytes) else text.encode(), ())
    except NoIceServers as error:
        assert str(error).isprintable()


@pytest.mark.parametrize("url", ["http://x", "stun:", "turn", "stuns:stun.example.org"])
def test_urls_that_cannot_be_used(url: str) -> None:
    with pytest.raises(BadIceServer):
        check_ice_url(url)
