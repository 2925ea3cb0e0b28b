"""The reference of the robots for tests leaves nothing out."""

from __future__ import annotations

import inspect

import pytest
from pydantic import BaseModel

import rwt.extensions.testing.pytest_plugin
from rwt.extensions.testing import Faults, ScriptedAction, ScriptedRobot, ScriptedService, ScriptedTopic
from rwt.extensions.testing.pytest_plugin.environment import RobotServer
from rwt.extensions.testing.script import file as script_file
from rwt.extensions.testing.virtual_time import VirtualTime
from rwt_graph import Node
from tests.docs.blocks import ROOT

PAGE = (ROOT / "docs" / "reference" / "testing.md").read_text(encoding="utf-8")

#: What the classes call each other, and no test does.
BETWEEN_OURSELVES = {
    ScriptedRobot: {"close"},
    ScriptedTopic: {"check"},
    ScriptedService: {"check", "handle", "later"},
    ScriptedAction: {"accept", "execute"},
    Faults: {"remove", "action_for", "refusal", "read_rate"},
}


@pytest.mark.parametrize(
    "kind", [ScriptedRobot, ScriptedTopic, ScriptedService, ScriptedAction, Faults, RobotServer, VirtualTime]
)
def test_every_method_is_listed(kind: type) -> None:
    members = inspect.getmembers(
        kind, lambda member: inspect.isfunction(member) or isinstance(member, property)
    )
    inherited = dir(Node) if issubclass(kind, Node) else dir(object)
    names = {name for name, _ in members if not name.startswith("_") and name not in inherited}
    names -= BETWEEN_OURSELVES.get(kind, set())
    assert names
    assert [name for name in sorted(names) if f"`{name}" not in PAGE and f" {name}(" not in PAGE] == []


def test_every_fixture_and_every_argument_of_the_marker_is_listed() -> None:
    fixtures = [name for name in vars(rwt.extensions.testing.pytest_plugin) if name.startswith("rwt_")]
    assert "rwt_server" in fixtures
    wanted = [*fixtures, "distro", "demo", "interfaces", "settings"]
    assert [name for name in wanted if f"| `{name}` |" not in PAGE] == []


TABLES = [
    kind
    for kind in vars(script_file).values()
    if isinstance(kind, type) and issubclass(kind, script_file.ScriptTable)
]


@pytest.mark.parametrize("model", TABLES)
def test_every_key_of_a_script_is_listed(model: type[BaseModel]) -> None:
    example = PAGE.partition("### TOML")[2].partition("### Python")[0]
    assert [key for key in model.model_fields if key not in example] == []
