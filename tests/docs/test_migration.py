"""Every row of the page for those who come from roslibpy: both sides run against the demo robot."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from rwt.settings.errors import known_settings
from rwt_client.blocking import connect
from tests.docs.blocks import ROOT
from tests.processes import free_port, running

PAGE = ROOT / "docs" / "how-to" / "from-roslibpy.md"
_CODE = re.compile(r"`([^`]+)`")


@dataclass(frozen=True, slots=True)
class Row:
    """Task, and the statements of either side."""

    wanted: str
    theirs: tuple[str, ...]
    ours: tuple[str, ...]


def rows() -> list[Row]:
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| ") and len(cells) == 3 and cells[0] != "To":
            found.append(Row(cells[0], tuple(_CODE.findall(cells[1])), tuple(_CODE.findall(cells[2]))))
    return found


def answer(request: Any) -> dict[str, object]:
    return {"success": True}


def theirs_answer(request: Any, response: Any) -> bool:
    response["success"] = True
    return True


class Side:
    """Runs the statements of one side, which see what the rows above them have made."""

    def __init__(self, names: dict[str, Any], port: int) -> None:
        self.names = names
        self._port = str(port)

    def run(self, statements: tuple[str, ...]) -> object:
        """Run them; gives the value of the last if it is an expression."""
        *before, last = (each.replace("9090", self._port) for each in statements)
        for statement in before:
            exec(statement, self.names)
        if re.match(r"\w+ = ", last):
            exec(last, self.names)
            return None
        return eval(last, self.names)


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    chosen = free_port()
    with running("serve", "--demo", f"ws://127.0.0.1:{chosen}", stderr=subprocess.DEVNULL):
        yield chosen


@pytest.fixture(scope="module")
def ours(port: int) -> Side:
    names = {"connect": connect, "callback": _take, "done": _take, "handler": answer}
    return Side(names, port)


def _take(*anything: object) -> None:
    """A callback that is content with everything."""


_ROSLIBPY = """
import sys, threading
import roslibpy
from tests.docs.test_migration import Side, rows, theirs_answer, _take
names = {"roslibpy": roslibpy, "threading": threading, "handle": theirs_answer}
names.update(callback=_take, done=_take)
side = Side(names, int(sys.argv[1]))
for row in rows():
    print(row.wanted, "->", repr(side.run(row.theirs)), flush=True)
"""


def test_there_are_rows() -> None:
    found = rows()
    assert len(found) >= 35
    assert all(row.theirs and row.ours for row in found)


def test_roslibpys_side_is_as_the_page_says(port: int) -> None:
    """In a process of its own: its reactor cannot be started twice."""
    command = [sys.executable, "-c", _ROSLIBPY, str(port)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    assert [line.partition(" -> ")[0] for line in done.stdout.splitlines()] == [row.wanted for row in rows()]
    said = dict(line.split(" -> ", 1) for line in done.stdout.splitlines())
    assert (said["call a service"], said["get the type of a topic"]) == ("3", "'nav_msgs/msg/Odometry'")


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.wanted)
def test_our_side_does_it(row: Row, ours: Side) -> None:
    value = ours.run(row.ours)
    expected = EXPECTED.get(row.wanted)
    if expected is not None:
        assert expected(value), value


EXPECTED: dict[str, Any] = {
    "check the connection": lambda value: value is True,
    "wait for one message": lambda value: value.info.width > 0,
    "call a service": lambda value: value == 3,
    "wait for its result": lambda value: value.succeeded and value.result.sequence == [0, 1, 1, 2],
    "read a parameter": lambda value: isinstance(value, float),
    "list parameters": lambda value: "/demo_robot:max_speed" in value,
    "look up a transform": lambda value: len(value) == 3,
    "list topics": lambda value: "/odom" in value,
    "get the type of a topic": lambda value: value == "nav_msgs/msg/Odometry",
    "find topics by type": lambda value: value == ("/odom",),
    "list services": lambda value: "/add_two_ints" in value,
    "get the type of a service": lambda value: value == "example_interfaces/srv/AddTwoInts",
    "find services by type": lambda value: value == ("/add_two_ints",),
    "list nodes": lambda value: "/demo_robot" in value,
    "get the details of a node": lambda value: "/odom" in value.publishing,
    "get the definition of a message type": lambda value: value[0].name == "nav_msgs/Odometry",
    "list actions": lambda value: "/fibonacci" in value,
    "get the time": lambda value: value > 1_600_000_000 * 10**9,
}


def test_what_is_expected_is_on_the_page() -> None:
    assert EXPECTED.keys() <= {row.wanted for row in rows()}
    assert threading.active_count() < 20


def test_the_counterparts_of_launch_arguments_are_settings() -> None:
    page = (ROOT / "docs" / "how-to" / "replace-rosbridge.md").read_text(encoding="utf-8")
    known = {".".join(key) for key, _ in known_settings()} | {"auth.tokens"}
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| `")]
    named = [name for _, here, *_ in rows for name in _CODE.findall(here) if re.fullmatch(r"\w+\.\w+", name)]
    assert len(named) >= 7
    assert [name for name in named if name not in known] == []
