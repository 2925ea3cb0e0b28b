"""A guarded parameter is not set through its parents or children, by any service or route."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rwt.access.disclosure import affected_parameters
from rwt.access.gate import gate
from rwt.rosapi import Rosapi
from tests.core.access.gated_robot import GatedRobot, HttpClient, call
from tests.core.rosbridge.recording_client import Client

GUARDED = "/robot/max_speed"
CHANGES = (
    (GUARDED, "9.0"),
    ("/robot", '{"max_speed": 9.0}'),
    ("/robot", "{}"),
    ("/robot", "1"),
    ("/", '{"robot": {"max_speed": 9.0}}'),
    ("/", "{}"),
    ("robot", '{"max_speed": 9.0}'),
    ("//robot/", '{"max_speed": 9.0}'),
    ("/robot/max_speed/x", "9.0"),
    ("/robot", None),
    (GUARDED, None),
    ("/", None),
)
"""Names with new values; None deletes."""
HARMLESS = (("/robot/other", "2.0"), ("/rob", "1"), ("/other", '{"max_speed": 9.0}'), ("/robot/other", None))


class TreeRobot(GatedRobot):
    """A robot of ROS 1 that is stopped, with a parameter that is guarded meanwhile."""

    def __init__(self, glob: str = GUARDED) -> None:
        rules = {"speed": {"parameters": [glob], "emergency": True}}
        super().__init__(rules, "noetic", emergency={"at_start": True})
        Rosapi(self.graph)
        self.graph.parameters.set(GUARDED, 1.0)
        self.graph.parameters.set("/robot/other", 1.0)

    @property
    def tree(self) -> Any:
        """All parameters."""
        return self.graph.parameters.get("/")


def _change(client: Client, name: str, value: str | None) -> str:
    service = "delete_param" if value is None else "set_param"
    args = {"name": name} if value is None else {"name": name, "value": value}
    client.say("call_service", service=f"/rosapi/{service}", args=args)
    return str(client.heard())


@pytest.mark.parametrize("glob", [GUARDED, "*max_speed", "/robot/m*"])
@pytest.mark.parametrize(("name", "value"), CHANGES)
def test_by_rosapi(name: str, value: str | None, glob: str) -> None:
    robot = TreeRobot(glob)
    before = robot.tree
    answer = _change(robot.client("admin"), name, value)
    assert robot.tree == before
    assert "gate.rules.speed.emergency" in answer or "not a valid name" in answer


@pytest.mark.parametrize(("name", "value"), HARMLESS)
def test_others_are_not_guarded(name: str, value: str | None) -> None:
    robot = TreeRobot()
    before = robot.tree
    assert "gate.rules" not in _change(robot.client("admin"), name, value)
    assert robot.tree != before


def test_reading_is_not_guarded() -> None:
    client = TreeRobot().client()
    assert (
        call(client, "/rosapi/get_param", name="/robot", default="")["value"]
        == '{"max_speed": 1.0, "other": 1.0}'
    )
    assert call(client, "/rosapi/has_param", name=GUARDED)["exists"]


@pytest.mark.parametrize(("name", "value"), CHANGES)
def test_by_http(name: str, value: str | None) -> None:
    robot = TreeRobot()
    before = robot.tree
    client, path = HttpClient(robot), f"/api/parameters/{name.lstrip('/')}"
    if value is None:
        answer = client.request("DELETE", path, b"", "admin")
    else:
        answer = client.request("PUT", path, value.encode(), "admin")
    assert answer.status in (403, 404)
    assert robot.tree == before


def test_a_branch_with_very_many_parameters_is_not_set_at_once() -> None:
    robot = TreeRobot()
    robot.graph.parameters.set("/many", {str(number): 1 for number in range(2000)})
    assert "more than 1000 parameters below it" in _change(robot.client("admin"), "/many", "{}")


def test_a_name_of_very_many_parts_is_not_split_into_all_names_above_it() -> None:
    robot = TreeRobot()
    assert "a name that is too long" in _change(robot.client("admin"), "/a" * 5000, "1")
    assert affected_parameters(robot.graph.parameters, "/a" * 5000, "1", 10_000) is None
    deep: object = 1
    for _ in range(300):
        deep = {"k" * 500: deep}
    assert affected_parameters(robot.graph.parameters, "/x", json.dumps(deep), 1000) is None
    assert affected_parameters(robot.graph.parameters, "/x", json.dumps({"k": "y" * 400_000}), 1000) is None
    assert affected_parameters(robot.graph.parameters, "/x", json.dumps("y" * 400_000), 1000) == ["/x"]


def test_the_numbers_of_a_table_are_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    texts: list[str] = []

    def note(text: str) -> bool:
        texts.append(text)
        return True

    monkeypatch.setattr(gate, "has_finite_numbers", note)
    table = json.dumps({str(number): "y" * 100 for number in range(500)})
    robot = GatedRobot({"tuned": {"parameters": ["*"]}}, "noetic")
    Rosapi(robot.graph)
    _change(robot.client("admin"), "/robot", table)
    assert texts == [table]
