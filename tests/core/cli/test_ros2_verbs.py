"""The table of ROS 2's verbs: it is whole, it is what the parsers say, and each line that works does."""

from __future__ import annotations

import re
import shlex
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rwt import Server
from rwt.cli import main, parser_for
from rwt.cli.parser import Parser, actions_of
from rwt_client.blocking import connect
from tests.core.cli.conftest import ROOT

_PAGE = ROOT / "docs" / "reference" / "ros2-verbs.md"
_ROW = re.compile(r"^\| `(\w+) (\w+)` \| (works|no) \| (.*) \|$", re.MULTILINE)

#: The verbs of ROS 2's command line up to Kilted.
_ROS2 = {
    "topic": "bw delay echo find hz info list pub type",
    "service": "call echo find info list type",
    "action": "echo find info list send_goal type",
    "param": "delete describe dump get list load set",
    "node": "info list",
    "interface": "list package packages proto show",
    "bag": "burst convert info list play record reindex",
}
_ROWS = _ROW.findall(_PAGE.read_text(encoding="utf-8"))
_WORKING = [(f"{family} {verb}", line.strip("`")) for family, verb, here, line in _ROWS if here == "works"]


def test_the_table_has_every_verb() -> None:
    listed: dict[str, list[str]] = {}
    for family, verb, _, _ in _ROWS:
        listed.setdefault(family, []).append(verb)
    assert {family: " ".join(verbs) for family, verbs in listed.items()} == _ROS2


def test_the_table_is_what_the_parsers_say() -> None:
    families = _choices(parser_for("*"))
    for family, verb, here, text in _ROWS:
        parser = _choices(families[family])[verb]
        if here == "works":
            assert not parser.unavailable
            assert text.startswith(f"`rwt {family} {verb} ") or text == f"`rwt {family} {verb}`"
        else:
            assert text == parser.unavailable


def _choices(parser: Parser) -> dict[str, Parser]:
    (found,) = (action.choices for action in actions_of(parser) if isinstance(action.choices, dict))
    return found


@pytest.fixture(scope="module")
def robot() -> Iterator[str]:
    """The demo robot, with events of its calls and a parameter that can be deleted."""
    server = Server("ws://127.0.0.1:0", demo=True, introspection=True)
    scratch = server.node("lab").parameters
    scratch.declare("scratch", None)
    scratch.set("scratch", 1)
    with server:
        yield server.urls[0]


@pytest.fixture(scope="module")
def folder(robot: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the lines are typed; with the files that some of them read."""
    made = tmp_path_factory.mktemp("lines")
    assert (
        main(["bag", "record", "--url", robot, "-o", str(made / "run.mcap"), "--max-seconds", "1", "/odom"])
        == 0
    )
    assert main(["param", "dump", "/demo_robot", "-o", str(made / "demo_robot.yaml"), "--url", robot]) == 0
    return made


@contextmanager
def _called_again_and_again(url: str) -> Iterator[None]:
    ended = threading.Event()

    def call() -> None:
        with connect(url) as robot:
            while not ended.wait(0.05):
                robot.call("/add_two_ints", {"a": 1, "b": 2})

    caller = threading.Thread(target=call)
    caller.start()
    yield
    ended.set()
    caller.join()


@pytest.mark.parametrize(("verb", "line"), _WORKING, ids=[verb.replace(" ", "_") for verb, _ in _WORKING])
def test_a_line_that_works(
    verb: str,
    line: str,
    robot: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("RWT_URL", robot)
    words = shlex.split(line)[1:]
    if verb == "bag record":
        words.append("--overwrite")
    if verb == "service echo":
        with _called_again_and_again(robot):
            assert main(words) == 0
    else:
        assert main(words) == 0
    captured = capsys.readouterr()
    assert captured.out or (verb.startswith("bag ") and captured.err)
