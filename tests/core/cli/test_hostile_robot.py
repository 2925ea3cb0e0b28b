"""A robot that puts terminal commands and line breaks into every text of every answer."""

from __future__ import annotations

import io
import json
import re
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from websockets.sync.server import ServerConnection, serve

from rwt.cli import main
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType

EVIL = "evil\x1b]0;x\x07\x1b[2J\x9b31m\u202e\x7f\r\nforged"
"""Sets the title, clears, turns the direction, and begins a line of its own."""

_REGISTRY = Registry(JAZZY)
_OWN = re.compile(r"\x1b\[(?:36|32|33|31|2|1|0)m")
_HARMFUL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def _evil(value: object) -> object:
    """The value with `EVIL` for each text, and one element in each empty array."""
    if isinstance(value, dict):
        return {name: _evil(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_evil(each) for each in value]
    return EVIL if isinstance(value, str) else value


def hostile_response(service: str) -> dict[str, Any]:
    """An answer of that service in which every text is evil."""
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
                text = str(slot.type)
                answer[slot.name] = [EVIL] if text.startswith("string") else [0] if "int" in text else []
        return {name: _evil(value) for name, value in answer.items()}
    return {}


def _serve(wire: ServerConnection) -> None:
    for text in wire:
        asked = json.loads(text)
        match asked["op"]:
            case "call_service":
                name = asked["service"]
                fails = name.endswith("/fails")
                values: object = EVIL if fails else hostile_response(name)
                reply = {"op": "service_response", "service": name, "values": values, "result": not fails}
                wire.send(json.dumps({**reply, "id": asked.get("id")}))
            case "subscribe":
                message = {"op": "publish", "topic": asked["topic"], "msg": {"data": EVIL}}
                wire.send(json.dumps(message))
                wire.send(json.dumps({"op": "status", "level": "error", "msg": EVIL, "id": asked.get("id")}))
            case "send_action_goal":
                result = {"op": "action_result", "action": asked["action"], "id": asked["id"], "values": EVIL}
                wire.send(json.dumps({**result, "status": 6, "result": False}))
            case _:
                pass


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """Where the robot is."""
    with serve(_serve, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()
        thread.join()


class Terminal(io.StringIO):
    """A terminal that keeps what is written."""

    def isatty(self) -> bool:
        return True


COMMANDS = (
    "topic list", "topic list --show-types", "topic list -v", "topic info /a", "topic info -v /a",
    "topic type /a", "topic find std_msgs/msg/String", "topic echo /a std_msgs/String --once",
    "topic echo /a std_msgs/String --once --csv", "topic echo /a std_msgs/String --once --field data",
    "topic echo /a --once", "service list", "service list --show-types", "service type /a", "service info /a",
    "service find std_srvs/srv/Trigger", "service call /a/fails std_srvs/Trigger {}", "service call /a",
    "action list", "action list --show-types", "action info /a", "action info -t /a", "action type /a",
    "action find example_interfaces/action/Fibonacci",
    "action send_goal /a example_interfaces/Fibonacci {order: 1}",
    "node list", "node info /a", "param list", "param get /a b", "param describe /a b", "param dump /a",
    "param set /a b 1", "param delete /a b", "interface list", "interface show std_msgs/msg/Evil",
    "interface package evil", "interface packages", "doctor",
)  # fmt: skip


@pytest.mark.parametrize("as_json", [False, True], ids=["people", "json"])
@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_that_it_says_is_a_command_to_the_terminal(
    command: str, as_json: bool, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, err = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    words = [*command.split(" ", 3)] if "{" in command else command.split(" ")
    main([*words, "--url", url, "--timeout", "5", *(["--json"] if as_json else [])])
    for text in (out.getvalue(), err.getvalue()):
        assert not _HARMFUL.search(_OWN.sub("", text)), repr(text)
        assert not any(line.lstrip('" ').startswith("forged") for line in text.splitlines()), repr(text)
