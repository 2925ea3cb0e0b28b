"""`rwt serve --graph zenoh`: two processes, one graph."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import pytest
from websockets.sync.client import ClientConnection, connect

from rwt.cli import main
from tests.processes import running
from tests.zenoh_links import free_endpoint

_LONGEST = 20.0


@contextmanager
def _server(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with running("serve", "ws://127.0.0.1:0", "--graph", "zenoh", *arguments) as found:
        yield found


def _ask(wire: ClientConnection, op: Mapping[str, object]) -> dict[str, object]:
    wire.send(json.dumps(op))
    answer: dict[str, object] = json.loads(wire.recv(timeout=_LONGEST))
    return answer


def test_a_client_of_one_server_finds_the_robot_of_the_other() -> None:
    endpoint = free_endpoint()
    with (
        _server("--demo", "--zenoh-listen", endpoint) as (robot, _),
        _server("--zenoh-connect", endpoint, "--domain", "0") as (gateway, url),
    ):
        with connect(url, max_size=None) as wire:
            call = {"op": "call_service", "id": "1", "service": "/add_two_ints", "args": {"a": 20, "b": 22}}
            assert _ask(wire, call)["values"] == {"sum": 42}
            kept = _ask(wire, {"op": "subscribe", "id": "2", "topic": "/map"})
            assert (kept["op"], kept["topic"]) == ("publish", "/map")
        for process in (gateway, robot):
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=_LONGEST)
            assert process.returncode == 0
            assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["--zenoh-connect", "tcp/127.0.0.1:1"], 2, "give --graph zenoh too"),
        (["--graph", "zenoh", "--distro", "noetic"], 1, "a graph of noetic cannot be joined over Zenoh"),
        (["--graph", "zenoh", "--zenoh-listen", "here"], 1, "Zenoh does not take"),
        (["--graph", "zenoh", "--zenoh-config", "/nowhere.json5"], 1, "cannot be used: it is not there"),
        (["--graph", "zenoh", "--domain", "-1"], 2, "`zenoh.domain`"),
    ],
)
def test_what_cannot_be_joined(
    arguments: list[str], code: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "ws://127.0.0.1:0", *arguments]) == code
    assert text in capsys.readouterr().err


def test_without_the_extra_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rwt.extensions.zenoh", None)
    assert main(["serve", "--graph", "zenoh"]) == 2
    assert "pip install 'robot-web-tools[zenoh]'" in capsys.readouterr().err


def test_a_server_without_it_does_not_load_it() -> None:
    program = (
        "import sys, rwt.cli.commands.serve, rwt.composition.graphs\n"
        "print([name for name in sys.modules if name.split('.')[0] in ('zenoh', 'xxhash')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=_LONGEST, check=True
    )
    assert done.stdout.strip() == "[]"
