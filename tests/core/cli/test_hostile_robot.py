"""Robots that put terminal commands and line breaks into every text of every answer, or answer with wrong
types, sizes and depths: each command reports it in one line, and nothing commands the terminal."""

from __future__ import annotations

import io
import json
import random
import re
import sys
from collections.abc import Callable, Iterator
from typing import Any, Final

import pytest
from websockets.sync.server import ServerConnection

from rwt.cli import main
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from tests.core.cli.conftest import response, served

EVIL: Final = "evil\x1b]0;x\x07\x1b[2J\x9b31m\u202e\u200b\u061c\x7f\r\nforged"
"""Sets the title, clears, turns the direction, and begins a line of its own."""

_REGISTRY: Final = Registry(JAZZY)
_OWN: Final = re.compile(r"\x1b\[(?:36|32|33|31|2|1|0)m")
_HARMFUL: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u202a-\u202e\u2066-\u2069]")
_WRONG: Final[tuple[object, ...]] = (
    None, True, -1, 2**63, 1e308, "x", "", [], {}, [None], [1], [["x"]], {"x": {"x": 1}}, ["x"] * 3, [{}],
    "9" * 5000, {"values": 1}, [[[]]], "/x", ["/x", 1, None],
)  # fmt: skip

Answer = Callable[[dict[str, Any], str], str]
"""Writes a message of the robot, given it and the name of its content."""


def _evil(value: object, text: str = EVIL) -> object:
    """The value with `text` for each string, and one element in each empty array."""
    if isinstance(value, dict):
        return {name: _evil(each, text) for name, each in value.items()}
    if isinstance(value, list):
        return [_evil(each, text) for each in value]
    return text if isinstance(value, str) else value


def _values(service: str, text: str) -> dict[str, Any]:
    """The response of that service in which every string is `text`."""
    short = service.rpartition("/")[2]
    kind = "".join(part.title() for part in short.split("_"))
    for package in ("rosapi_msgs", "rcl_interfaces"):
        try:
            type: MessageType = _REGISTRY.service(f"{package}/{kind}").response
        except LookupError:
            continue
        answer: dict[str, Any] = json.loads(type.json.encode(type.struct()))
        for slot in type.slots:
            if answer[slot.name] == []:
                name = str(slot.type)
                answer[slot.name] = [text] if name.startswith("string") else [0] if "int" in name else []
        return {name: _evil(value, text) for name, value in answer.items()}
    return {}


class HostileRobot:
    """Robot that answers everything, as its function `answer` writes it."""

    def __init__(self) -> None:
        self.answer: Answer = _as_it_is
        self.text = EVIL

    def serve(self, wire: ServerConnection) -> None:
        """Answer a client until it leaves."""
        for text in wire:
            asked = json.loads(text)
            for message, key in self._messages(asked):
                wire.send(self.answer(message, key))

    def _messages(self, asked: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
        id_ = asked.get("id")
        match asked["op"]:
            case "call_service":
                fails = asked["service"].endswith("/fails")
                values: object = self.text if fails else _values(asked["service"], self.text)
                yield response(asked, values, not fails), "values"
            case "subscribe":
                for _ in range(3):
                    yield {"op": "publish", "topic": asked["topic"], "msg": {"data": self.text}}, "msg"
                yield {"op": "status", "level": "error", "msg": self.text, "id": id_}, "msg"
            case "send_action_goal":
                of_goal = {"action": asked["action"], "id": id_}
                yield {"op": "action_feedback", **of_goal, "values": {}}, "values"
                yield (
                    {"op": "action_result", **of_goal, "values": self.text, "status": 6, "result": False},
                    "values",
                )


def _as_it_is(message: dict[str, Any], key: str) -> str:
    return json.dumps(message)


def _mutated_by(chance: random.Random) -> Answer:
    """Return a writer of messages that are plausible, but for what is replaced at random."""

    def mutated(value: object, depth: int = 0) -> object:
        if chance.random() < (0.4 if depth else 0.15):
            return chance.choice(_WRONG)
        if isinstance(value, dict):
            return {name: mutated(each, depth + 1) for name, each in value.items()}
        if isinstance(value, list):
            return [mutated(each, depth + 1) for each in value]
        return value

    def answer(message: dict[str, Any], key: str) -> str:
        content = message[key]
        if isinstance(content, dict) and "typedefs_full_text" in content:
            content["typedefs_full_text"] = ["string data\n"]
        for name in {"type", "types"} & (content.keys() if isinstance(content, dict) else set()):
            type = "std_msgs/msg/String"
            content[name] = [type] if isinstance(content[name], list) else type
        message = {**message, key: mutated(content)}
        # The id must fit, or the answer belongs to nothing.
        for name in ("result", "op", "service", "topic", "status", "type"):
            if name in message and chance.random() < 0.05:
                message[name] = chance.choice(_WRONG)
        return json.dumps(message)

    return answer


@pytest.fixture(scope="module")
def robot() -> HostileRobot:
    return HostileRobot()


@pytest.fixture(scope="module")
def url(robot: HostileRobot) -> Iterator[str]:
    """Where the robot is."""
    with served(robot.serve) as url:
        yield url


class Terminal(io.StringIO):
    """A terminal that keeps what is written."""

    def isatty(self) -> bool:
        return True


COMMANDS: Final = (
    "topic list", "topic list --show-types", "topic list -v", "topic info /x", "topic info -v /x",
    "topic type /x", "topic find std_msgs/msg/String", "topic echo /x std_msgs/String --once",
    "topic echo /x std_msgs/String --once --csv", "topic echo /x std_msgs/String --once --field data",
    "topic echo /x --once", "topic pub --once /x std_msgs/msg/String {data:\u00a0x}", "service list",
    "service list --show-types", "service type /x", "service info /x", "service find std_srvs/srv/Trigger",
    "service call /x/fails std_srvs/Trigger {}", "service call /x", "action list", "action list --show-types",
    "action info /x", "action info -t /x", "action type /x",
    "action find example_interfaces/action/Fibonacci",
    "action send_goal /x example_interfaces/Fibonacci {order:\u00a01}", "node list", "node info /x",
    "param list", "param list /x", "param get /x b", "param describe /x b", "param dump /x",
    "param set /x b 1", "param delete /x b", "interface list", "interface show std_msgs/msg/Evil",
    "interface show std_msgs/msg/String", "interface package evil", "interface packages",
    "tf tree --wait 0.1", "tf echo a b --once", "stop", "approve", "doctor",
)  # fmt: skip


def _run(line: str, *options: str, url: str, monkeypatch: pytest.MonkeyPatch) -> tuple[int, str, str]:
    """Run a command in a terminal; return its exit code, and what it printed to stdout and stderr."""
    out, err = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    words = [word.replace("\u00a0", " ") for word in line.split(" ")]
    code = main([*words, "--url", url, *options])
    return code, out.getvalue(), err.getvalue()


@pytest.mark.parametrize("options", [(), ("--json",)], ids=["people", "json"])
@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_that_it_says_is_a_command_to_the_terminal(
    command: str, options: tuple[str, ...], robot: HostileRobot, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.text, robot.answer = EVIL, _as_it_is
    _, *texts = _run(command, "--timeout", "5", *options, url=url, monkeypatch=monkeypatch)
    for text in texts:
        assert not _HARMFUL.search(_OWN.sub("", text)), repr(text)
        assert not any(line.lstrip('" ').startswith("forged") for line in text.splitlines()), repr(text)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
class TestWrongAnswers:
    """The loop of a command that failed ends before its transport is closed: hence the filter."""

    @pytest.mark.parametrize("command", [*COMMANDS, "topic list --json", "doctor --json"])
    def test_mutated_answers_are_reported_in_a_line(
        self, command: str, robot: HostileRobot, url: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for seed in range(8):
            robot.text, robot.answer = "/x", _mutated_by(random.Random(seed))
            self._check(f"{command} (seed {seed})", command, url, monkeypatch)

    @pytest.mark.parametrize(
        "raw",
        ["[" * 100_000, "[" * 5000 + "]" * 5000, '{"data":' * 3000 + "1" + "}" * 3000],
        ids=("cut", "lists", "maps"),
    )
    @pytest.mark.parametrize("command", COMMANDS)
    def test_deep_answers_are_reported_in_a_line(
        self, command: str, raw: str, robot: HostileRobot, url: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        robot.answer = lambda message, key: json.dumps({**message, key: "HERE"}).replace('"HERE"', raw)
        self._check(command, command, url, monkeypatch)

    def _check(self, name: str, command: str, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
        code, _, errors = _run(command, "--timeout", "0.2", url=url, monkeypatch=monkeypatch)
        assert code in (0, 1, 2, 3, 4), (name, code)
        assert "Traceback" not in errors and "usage:" not in errors, (name, errors)
        assert all(len(each) < 3000 for each in errors.splitlines()), (name, errors[:2000])
