"""Every difference between distributions is a field of `Distro`; nothing is asked for its version instead."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from rwt_interfaces import JAZZY, KILTED, NOETIC, Distro
from rwt_interfaces.distro import closest_distro

SRC = Path(__file__).parents[3] / "src"

REPORTS = {
    "rwt/composition/graphs.py": "chooses the distribution of a bridged graph",
    "rwt/composition/pages.py": "the index page names it",
    "rwt/extensions/recording/commands/recording.py": "`rwt bag info` prints it",
    "rwt/extensions/http/gateway.py": "`/version` and the page of the API name it",
    "rwt_client/blocking.py": "rosapi's question",
    "rwt_client/connection.py": "what a program knows of its robot beforehand",
    "rwt_client/robot.py": "finds the distribution from rosapi's answer",
    "rwt_client/rosapi.py": "rosapi's question",
    "rwt_interfaces/distro.py": "the field",
    "rwt/extensions/recording/mcap_files.py": "reads the note of a recording",
    "rwt/extensions/recording/writer.py": "writes the note of a recording",
    "rwt/rosapi/graph_services.py": "rosapi's answer",
    "rwt/extensions/ros2/backend.py": "rejects a distribution of ROS 1",
}
"""Where the version may stand: where it is told to somebody, or learned."""

VERSION_TEST = re.compile(r"\bros_version\b|\bdistro\.name [=!]=|\bdistro (is|==|!=) (not )?(JAZZY|NOETIC)")


def test_nothing_asks_for_the_version() -> None:
    found = {
        str(file.relative_to(SRC))
        for file in SRC.rglob("*.py")
        if VERSION_TEST.search(file.read_text(encoding="utf-8"))
    }
    assert found == set(REPORTS)


@pytest.mark.parametrize("field", [field.name for field in fields(Distro)])
def test_each_field_is_a_difference(field: str) -> None:
    assert getattr(JAZZY, field) != getattr(NOETIC, field)


@pytest.mark.parametrize("field", [field.name for field in fields(Distro) if field.name != "ros_version"])
def test_each_field_is_asked_for(field: str) -> None:
    asked = re.compile(rf"\.{field}\b")
    assert any(asked.search(file.read_text(encoding="utf-8")) for file in SRC.rglob("*.py"))


def test_a_name_finds_its_distribution_and_an_unknown_one_that_of_its_version() -> None:
    assert closest_distro("noetic", 2) is NOETIC
    assert closest_distro("melodic", 1) is NOETIC
    assert closest_distro("kilted", 2) is KILTED
    assert closest_distro("iron", 2) is JAZZY
