"""Every command against a robot whose answers have the wrong types, sizes, and depths: one line of error."""

from __future__ import annotations

import io
import json
import random
import sys
import threading
from collections.abc import Iterator
from typing import Any, Final

import pytest
from websockets.sync.server import ServerConnection, serve

from rwt.cli import main
from tests.core.cli.test_hostile_robot import hostile_response

pytestmark = pytest.mark.filterwarnings(
    # The loop of a command that failed ends before its transport is closed.
    "ignore::pytest.PytestUnraisableExceptionWarning"
)

DEEP: Final = "[" * 100_000
DEEP_CLOSED: Final = "[" * 5000 + "]" * 5000
_WRONG: Final[tuple[object, ...]] = (
    None, True, -1, 2**63, 1e308, "x", "", [], {}, [None], [1], [["x"]], {"x": {"x": 1}}, ["x"] * 3, [{}],
    "9" * 5000, {"values": 1}, [[[]]], "/x", ["/x", 1, None],
)  # fmt: skip


class HostileRobot:
    """Robot whose answers are mutated at random, by a seed."""

    def __init__(self) -> None:
        self.random = random.Random(0)
        self.raw: str | None = None

    def _mutated(self, value: object, depth: int = 0) -> object:
        if self.random.random() < (0.4 if depth else 0.15):
            return self.random.choice(_WRONG)
        if isinstance(value, dict):
            return {name: self._mutated(each, depth + 1) for name, each in value.items()}
        if isinstance(value, list):
            return [self._mutated(each, depth + 1) for each in value]
        return value

    def _send(self, wire: ServerConnection, reply: dict[str, Any], key: str) -> None:
        if self.raw is not None:
            text = json.dumps({**reply, key: "HERE"}).replace('"HERE"', self.raw)
        else:
            reply = {**reply, key: self._mutated(reply[key])}
            # The id must fit, or the answer belongs to nothing.
            for name in ("result", "op", "service", "topic", "status", "type"):
                if name in reply and self.random.random() < 0.05:
                    reply[name] = self.random.choice(_WRONG)
            text = json.dumps(reply)
        wire.send(text)

    def serve(self, wire: ServerConnection) -> None:
        """Answer a client until it leaves."""
        for text in wire:
            asked = json.loads(text)
            id_ = asked.get("id")
            match asked["op"]:
                case "call_service":
                    name = asked["service"]
                    reply = {"op": "service_response", "service": name, "result": True, "id": id_}
                    self._send(wire, {**reply, "values": _plausible(name)}, "values")
                case "subscribe":
                    message = {"op": "publish", "topic": asked["topic"], "msg": {"data": "x"}}
                    for _ in range(3):
                        self._send(wire, message, "msg")
                case "send_action_goal":
                    result = {"op": "action_result", "action": asked["action"], "id": id_, "values": {}}
                    feedback = {"op": "action_feedback", "action": asked["action"], "id": id_, "values": {}}
                    self._send(wire, feedback, "values")
                    self._send(wire, {**result, "status": 4, "result": True}, "values")
                case _:
                    pass


def _plausible(service: str) -> dict[str, Any]:
    """Return an answer with names, so that the commands ask further."""
    answer = json.loads(json.dumps(hostile_response(service)).replace(json.dumps(_evil_text())[1:-1], "/x"))
    for name, value in answer.items():
        if name in ("type", "types"):
            answer[name] = ["std_msgs/msg/String"] if isinstance(value, list) else "std_msgs/msg/String"
    if service.endswith("topics_and_raw_types"):
        answer["typedefs_full_text"] = ["string data\n"]
    return dict(answer)


def _evil_text() -> str:
    from tests.core.cli.test_hostile_robot import EVIL

    return EVIL


@pytest.fixture(scope="module")
def robot() -> HostileRobot:
    return HostileRobot()


@pytest.fixture(scope="module")
def url(robot: HostileRobot) -> Iterator[str]:
    with serve(robot.serve, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()
        thread.join()


VERBS: Final = (
    "topic list", "topic list -v", "topic list -t", "topic list --json", "topic info /x", "topic info -v /x",
    "topic type /x", "topic find std_msgs/msg/String", "topic echo --once /x",
    "topic echo --once /x std_msgs/msg/String", "topic echo --once --json /x",
    "topic pub --once /x std_msgs/msg/String {data:\u00a0x}", "service list", "service list -t",
    "service info /x", "service type /x", "service find std_srvs/srv/Empty",
    "service call /x std_srvs/srv/Empty", "action list", "action list -t", "action info /x", "action type /x",
    "action find nav2_msgs/action/NavigateToPose",
    "action send_goal /x example_interfaces/action/Fibonacci {order:\u00a01}", "param list", "param list /x",
    "param get /x y", "param set /x y 1", "param describe /x y", "param delete /x y", "param dump /x",
    "node list", "node info /x", "interface list", "interface show std_msgs/msg/String",
    "tf tree --timeout 0.3", "tf echo a b --once", "stop --status", "approve --list", "approve",
    "doctor", "doctor --json",
)  # fmt: skip


def _run(line: str, url: str, monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Run a command; return its exit code and what it printed to stderr."""
    output, errors = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", output)
    monkeypatch.setattr(sys, "stderr", errors)
    words = [word.replace("\u00a0", " ") for word in line.split(" ")]
    options = ["--url", url] if "--timeout" in words else ["--url", url, "--timeout", "0.2"]
    try:
        code = main([*words, *options])
    except SystemExit as ended:
        code = int(ended.code or 0)
    return code, errors.getvalue()


def _check(line: str, code: int, errors: str) -> None:
    assert code in (0, 1, 2, 3, 4), (line, code)
    assert "Traceback" not in errors and "usage:" not in errors, (line, errors)
    assert all(len(each) < 3000 for each in errors.splitlines()), (line, errors[:2000])


@pytest.mark.parametrize("verb", VERBS)
def test_mutated_answers_are_reported_in_a_line(
    verb: str, robot: HostileRobot, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.raw = None
    for seed in range(8):
        robot.random.seed(seed)
        _check(f"{verb} (seed {seed})", *_run(verb, url, monkeypatch))


@pytest.mark.parametrize(
    "raw", [DEEP, DEEP_CLOSED, '{"data":' * 3000 + "1" + "}" * 3000], ids=("cut", "lists", "maps")
)
@pytest.mark.parametrize("verb", VERBS)
def test_deep_answers_are_reported_in_a_line(
    verb: str, raw: str, robot: HostileRobot, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.raw = raw
    _check(verb, *_run(verb, url, monkeypatch))
