"""Foxglove's own client from npm, with its own readers and writers of messages: every operation it has."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.clients.conftest import Program

pytestmark = pytest.mark.clients

ENCODINGS = {
    "jazzy": ["cdr", "ros2msg", "nav_msgs/msg/Odometry"],
    "noetic": ["ros1", "ros1msg", "nav_msgs/Odometry"],
}


@pytest.fixture
def viewer(distro: str, program_of: Callable[[str, str], Program]) -> Program:
    return program_of("foxglove", distro)


def test_it_hears_what_the_server_is(viewer: Program, distro: str) -> None:
    info = viewer.observe("info")
    assert info["capabilities"] == [
        "clientPublish", "parameters", "parametersSubscribe", "services", "connectionGraph", "assets",
    ]  # fmt: skip
    assert info["supportedEncodings"] == [ENCODINGS[distro][0], "json"]
    assert info["metadata"] == {"ROS_DISTRO": distro}


def test_it_reads_messages_by_their_schemas(viewer: Program, distro: str) -> None:
    heard = viewer.observe("messages")
    assert heard.pop("tf")
    fields, is_whole = heard.pop("cloud")
    assert fields[:3] == ["x", "y", "z"] and is_whole
    width, height, encoding, is_whole = heard.pop("image")
    assert width > 100 and height > 100 and encoding and is_whole
    assert heard == {
        "odom": ["odom", "base_link", 36],
        "description": '<?xml version="1.0"?>\n<robot n',
        "stamped": True,
        "encodings": ENCODINGS[distro],
    }


def test_what_it_publishes_is_heard(viewer: Program) -> None:
    observed = viewer.observe("publish")
    assert observed["heard"] == ["serialised", "text"]
    assert observed["refused"] == [True, "message data: this client advertises no channel 1"]


def test_it_calls_services(viewer: Program) -> None:
    observed = viewer.observe("call")
    assert observed.pop("type").endswith("AddTwoInts")
    assert observed == {
        "json": {"sum": 3},
        "serialised": "42",
        "failure": [3, "there is no service 4000000000"],
    }


def test_it_reads_sets_and_watches_parameters(viewer: Program) -> None:
    observed = viewer.observe("parameters")
    name = observed["name"]
    assert observed["many"] is True
    changed = {"name": name, "value": 25, "type": "float64"}
    assert (observed["set"], observed["told"]) == ([changed], changed)
    assert observed["one"] == [{"name": name, "value": 30, "type": "float64"}]


def test_it_sees_who_takes_part_in_what(viewer: Program) -> None:
    assert viewer.observe("graph") == [["/demo_robot"], True, 1]


def test_it_fetches_the_meshes_of_the_description(viewer: Program) -> None:
    assert viewer.observe("assets") == {"mesh": True, "none": [1, True]}
