"""`rwt hub` and `rwt serve --dial` as their users meet them: two processes, and clients of the hub."""

from __future__ import annotations

import json
import re
import signal
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.processes import ended, running

_TOKEN = "0123456789abcdef"


@contextmanager
def _client(url: str) -> Iterator[ClientConnection]:
    """A client of a robot that may still be dialling in."""
    for _ in range(100):
        try:
            wire = connect(url)
        except InvalidStatus as refused:
            assert refused.response.status_code == 404
            time.sleep(0.05)
            continue
        with wire:
            yield wire
        return
    raise AssertionError("the robot did not dial in")


def _add(wire: ClientConnection, a: int, b: int) -> object:
    call = {"op": "call_service", "id": "1", "service": "/add_two_ints", "args": {"a": a, "b": b}}
    wire.send(json.dumps(call))
    return json.loads(wire.recv(timeout=10))["values"]["sum"]


def test_a_robot_behind_a_hub() -> None:
    with running("hub", "ws://127.0.0.1:0", "--token", _TOKEN) as (hub, url):
        robot_url = f"{url}/robots/rosie"
        robot = running(
            *("serve", "--demo", "--dial", robot_url),
            ready="dialing",
            environment={"RWT_DIAL__TOKEN": _TOKEN},
        )
        with robot as (process, said):
            assert said == robot_url
            with _client(f"{url}/rosie") as one, _client(f"{url}/rosie") as two:
                assert (_add(one, 1, 2), _add(two, 30, 4)) == (3, 34)
                with urllib.request.urlopen(f"{url.replace('ws', 'http', 1)}/robots", timeout=10) as answer:
                    assert json.load(answer)["robots"] == [{"name": "rosie", "path": "/rosie", "clients": 2}]
                process.send_signal(signal.SIGTERM)
                for wire in (one, two):
                    with pytest.raises(ConnectionClosed) as closed:
                        wire.recv(timeout=10)
                    assert closed.value.rcvd is not None and closed.value.rcvd.code == 1001
            assert process.wait(timeout=10) == 0
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{url.replace('ws', 'http', 1)}/rosie", timeout=10)
        assert hub.poll() is None


def test_a_robot_may_listen_as_well() -> None:
    with (
        running("hub", "ws://127.0.0.1:0") as (_, hub),
        running(
            *("serve", "ws://127.0.0.1:0", "--demo", "--dial", f"{hub}/robots/rosie"), ready="listening on"
        ) as (_, near),
        _client(f"{hub}/rosie") as through,
        connect(near) as direct,
    ):
        assert (_add(through, 1, 1), _add(direct, 2, 2)) == (2, 4)
        with urllib.request.urlopen(f"{near.replace('ws', 'http', 1)}/metrics", timeout=10) as answer:
            assert f'rwt_dial_clients{{hub="{hub}/robots/rosie"}} 1\n' in answer.read().decode()


def _fails(*arguments: str) -> tuple[int, str]:
    done = ended(*arguments)
    assert re.fullmatch(r"rwt: [^\n]+\n", done.stderr), done.stderr
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["hub", "tcp://127.0.0.1:0"], 2, "expected ws:// or wss://"),
        (["hub", "ws://0.0.0.0:0"], 2, "needs a token"),
        (["hub", "ws://127.0.0.1:0", "--token", "short"], 2, "16 to 256"),
        (["hub", "ws://127.0.0.1:0", "--token-file", "/no/such/file"], 2, "/no/such/file"),
        (["hub", "wss://127.0.0.1:0"], 1, "needs a certificate"),
        (["hub", "wss://127.0.0.1:0", "--certfile", "x.pem"], 2, "--keyfile together"),
        (["hub", "ws://127.0.0.1:99999"], 1, "port"),
        (["serve", "--dial", "wss://hub.example/rosie"], 1, "its path must be /robots/NAME"),
        (["serve", "--dial", "hub.example"], 1, "wss://hub.example/robots/my_robot"),
        (["serve", "--dial", "wss://h/robots/a", "--set", "dial.token=x"], 2, "dial.token"),
        (["serve", "--dial", "wss://h/robots/a", "--set", "dial.cafile=/no/ca.pem"], 2, "/no/ca.pem"),
        (["serve", "--set", "listen=[]"], 2, "at least one URL"),
    ],
)
def test_what_cannot_be_done_is_one_line(arguments: list[str], code: int, says: str) -> None:
    exit_code, error = _fails(*arguments)
    assert says in error
    assert exit_code == code
    assert "short" not in error


def test_tokens_from_a_file(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(f"{_TOKEN}\nanother-long-token\n")
    with running("hub", "ws://127.0.0.1:0", "--token-file", str(tokens)) as (_, url):
        for headers, status in (({}, 401), ({"Authorization": "Bearer another-long-tokem"}, 401)):
            with pytest.raises(InvalidStatus) as refused:
                connect(f"{url}/robots/rosie", additional_headers=headers)
            assert refused.value.response.status_code == status
        with connect(f"{url}/robots/r", additional_headers={"Authorization": f"Bearer {_TOKEN}"}) as wire:
            assert wire.protocol.state.name == "OPEN"


def test_the_dial_token_is_not_shown() -> None:
    done = ended("config", "show", "--set", f"dial.token={_TOKEN}")
    assert _TOKEN not in done.stdout
