"""The demo robot in a process of its own, and the command line against it."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.server import ServerConnection, serve

from rwt.cli import main
from tests.processes import ended, running, start

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True, slots=True)
class Ended:
    """A command that has ended."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Its output as one JSON value."""
        return json.loads(self.out)

    @property
    def records(self) -> list[Any]:
        """Its output as JSON lines."""
        return [json.loads(line) for line in self.out.splitlines()]


Rwt = Callable[..., Ended]


def candidates(url: str, line: str, **environment: str) -> list[str]:
    """Return the completions of the last word of a line, with a robot at some URL."""
    asked = {"RWT_URL": url, "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE": "1"}
    asked |= {"_ARGCOMPLETE_STDOUT_FILENAME": "/dev/stdout", "_ARGCOMPLETE_SUPPRESS_SPACE": "1"}
    answer = ended(environment={**os.environ, **asked, **environment})
    assert answer.stderr == ""
    return sorted(answer.stdout.split("\v")) if answer.stdout else []


@contextmanager
def served(handle: Callable[[ServerConnection], None]) -> Iterator[str]:
    """The URL of a robot that is a function of each connection."""
    with serve(handle, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        finally:
            server.shutdown()
            thread.join()


def response(asked: Any, values: object, result: bool = True) -> dict[str, Any]:
    """The answer to a call."""
    answer = {"op": "service_response", "service": asked["service"], "id": asked.get("id")}
    return {**answer, "values": values, "result": result}


@contextmanager
def demo_server(*options: str, url: str = "ws://127.0.0.1:0") -> Iterator[str]:
    """The demo robot in another process, by its URL."""
    with running("serve", "--demo", url, *options, stderr=subprocess.DEVNULL) as (_, listening):
        yield listening


@pytest.fixture(scope="session")
def demo() -> Iterator[str]:
    """The URL of a demo robot that all tests share: leave it as it was."""
    with demo_server() as url:
        yield url


@pytest.fixture
def rwt(demo: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Rwt:
    """Runs `rwt …` against the demo robot, in this process."""
    monkeypatch.setenv("RWT_URL", demo)
    monkeypatch.delenv("RWT_TOKEN", raising=False)

    def run(*words: str) -> Ended:
        capsys.readouterr()
        try:
            code = main(words)
        except SystemExit as ended:
            code = int(ended.code or 0)
        captured = capsys.readouterr()
        return Ended(code, captured.out, captured.err)

    return run


_TRANSCRIPTS = Path(__file__).parent / "transcripts"


def transcript(name: str) -> pytest.MarkDecorator:
    """A case for each command of a file in the folder `transcripts`: its line, and what it prints."""
    text = (_TRANSCRIPTS / name).read_text(encoding="utf-8")
    cases = [block.partition("\n")[::2] for block in text.split("\n$ rwt ")[1:]]
    return pytest.mark.parametrize(("line", "printed"), cases, ids=[line for line, _ in cases])


def check_transcript(rwt: Rwt, line: str, printed: str) -> None:
    """Run a command of a transcript, and compare what it prints, with its exit code."""
    ended = rwt(*shlex.split(line))
    errors = "".join(f"! {each}" for each in ended.err.splitlines(keepends=True))
    code = f"\n[{ended.code}]" if ended.code else ""
    found = f"{ended.out}{errors}".strip("\n") + code
    wanted = ".*".join(map(re.escape, printed.strip("\n").split("…")))
    assert re.fullmatch(wanted, found, re.DOTALL), found


def impatient(rwt: Rwt, *words: str, seconds: float = 0.2) -> tuple[Ended, str]:
    """Run a command that waits for what never comes, and how long it waited, as its errors say it.

    Its patience is for connecting, too, which a busy machine may need all of: then it gets ten times as much.
    """
    while (ended := rwt(*words, "--timeout", f"{seconds:g}")).code == 3 and seconds < 60:
        seconds *= 10
    return ended, f"{seconds:g} s"


def process(*words: str, url: str, **options: Any) -> subprocess.Popen[str]:
    """Start `rwt …` in a process of its own, with the options of :func:`tests.processes.start`."""
    environment = {**os.environ, "RWT_URL": url, "PYTHONUNBUFFERED": "1"}
    return start(*words, environment=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)
