"""The reference pages leave nothing out."""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
import subprocess
import sys

import pytest

import rwt
import rwt_graph
from rwt.cli import parser_for
from rwt.cli.parser import actions_of, commands_of
from rwt.rosapi import Rosapi
from rwt_graph import MemoryGraph, Node
from rwt_participant import errors, goals, qos
from rwt_protocol.codecs import SELECTABLE
from rwt_transports.schemes import url_forms
from tests.docs.blocks import ROOT

_REFERENCE = ROOT / "docs" / "reference"


def _page(name: str) -> str:
    return (_REFERENCE / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("command", "known"),
    [("serve", "--demo"), ("hub", "--token-file"), ("bag record", "--split"), ("bag play", "--loop")],
)
def test_every_option_of_a_command_is_listed(command: str, known: str) -> None:
    parser: argparse.ArgumentParser = parser_for("*")
    for name in command.split():
        parser = commands_of(parser)[name]
    options = [option for action in actions_of(parser) for option in action.option_strings]
    assert known in options
    (section,) = re.findall(rf"^#+ rwt {command}\n(.*?)(?=^##|\Z)", _page("commands.md"), re.S | re.M)
    assert [option for option in options if f"`{option}" not in section] == ["-h", "--help"]


@pytest.mark.parametrize("page", ["reference/command-line.md", "how-to/transports.md"])
def test_every_scheme_is_listed(page: str) -> None:
    text = (_REFERENCE.parent / page).read_text()
    assert [form for form in url_forms().split(", ") if f"`{form}" not in text] == []


def test_every_public_name_of_the_graph_is_listed() -> None:
    page = _page("graph.md")
    shared = [name for module in (errors, goals, qos) for name in rwt.__all__ if hasattr(module, name)]
    assert {"CallFailed", "GoalStatus", "QoS"} <= set(shared)
    names = [*rwt_graph.__all__, *shared]
    assert [name for name in names if f"`{name}" not in page and f"## {name}" not in page] == []


def test_every_method_of_a_node_is_listed() -> None:
    page = _page("graph.md")
    members = inspect.getmembers(
        Node, lambda member: inspect.isfunction(member) or isinstance(member, property)
    )
    public = [name for name, _ in members if not name.startswith("_")]
    assert "advertise" in public
    assert [name for name in public if f"`{name}" not in page and f" {name}(" not in page] == []


def test_every_service_of_rosapi_is_listed() -> None:
    graph = MemoryGraph()
    with Rosapi(graph):
        offered = [service.name for service in graph.services() if service.name.startswith("/rosapi/")]
    own = [name.removeprefix("/rosapi/") for name in offered if "parameter" not in name]
    assert len(own) > 20
    page = _page("protocol.md")
    assert [name for name in own if f"`{name}`" not in page] == []


@pytest.mark.parametrize("name", ["commands", "rules", "settings", "tools"])
def test_a_page_that_is_made_is_up_to_date(name: str) -> None:
    tool = importlib.import_module(f"tools.generate_{name}")
    assert tool.TARGET.read_text(encoding="utf-8") == tool.page(), f"run python tools/generate_{name}.py"


@pytest.mark.parametrize("name", ["api", "protocol_reference"])
def test_pages_of_a_tool_that_checks_them_are_up_to_date(name: str) -> None:
    command = [sys.executable, str(ROOT / "tools" / f"generate_{name}.py"), "--check"]
    checked = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_every_encoding_is_listed_by_precedence() -> None:
    page = _page("encodings.md")
    rows = re.findall(r"^\| `([\w-]+)` \| [^|]+ \| (text|binary) \|", page, re.MULTILINE)
    assert rows == [(encoding.name, "binary" if encoding.binary else "text") for encoding in SELECTABLE]
    (order,) = re.findall(r"the first of ([^(]+) applies \(SUB-08\)", page)
    strongest = sorted(SELECTABLE, key=lambda encoding: -encoding.precedence)
    assert re.findall(r"`([\w-]+)`", order) == [encoding.name for encoding in strongest]


def test_costs_in_the_readme_are_those_of_the_linked_pages() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    costs = re.findall(r"\[([\d.,]+) (?:µs|s)\]\((docs/[\w/.-]+)", readme)
    assert len(costs) == 6
    for figure, page in costs:
        assert f"| {figure} |" in (ROOT / page).read_text(encoding="utf-8"), (figure, page)
