from __future__ import annotations

import logging

import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_participant.errors import ServiceFailed
from rwt_participant.messages import Message


@pytest.mark.parametrize(
    ("method", "ros_2", "ros_1"),
    [("debug", 10, 1), ("info", 20, 2), ("warn", 30, 4), ("error", 40, 8), ("fatal", 50, 16)],
)
def test_a_line_goes_to_rosout_and_to_pythons_log(
    graph: MemoryGraph,
    noetic: MemoryGraph,
    caplog: pytest.LogCaptureFixture,
    method: str,
    ros_2: int,
    ros_1: int,
) -> None:
    for made, level, name in ((graph, ros_2, "robot.talker"), (noetic, ros_1, "/robot/talker")):
        node = Node(made, "talker", "/robot")
        lines: list[Message] = []
        node.subscribe("/rosout", lines.append)
        with caplog.at_level(logging.DEBUG, "ros"):
            getattr(node.log, method)("100 % ready")
        (line,) = lines
        assert (line.level, line.name, line.msg) == (level, name, "100 % ready")
        assert (line.file, line.function) == (__file__, "test_a_line_goes_to_rosout_and_to_pythons_log")
        stamp = line.stamp if made is graph else line.header.stamp
        assert getattr(stamp, made.distro.time_fields[0]) == 1
        assert ("ros.robot.talker", ros_2, "100 % ready") in caplog.record_tuples


def test_a_late_console_sees_the_last_ten_seconds(graph: MemoryGraph, clock: SimulatedClock) -> None:
    node = Node(graph, "talker")
    node.log.info("old")
    clock.advance(8)
    node.log.warning("new")
    clock.advance(8)
    lines: list[Message] = []
    node.subscribe("/rosout", lines.append)
    assert [line.msg for line in lines] == ["new"]


@pytest.mark.anyio
async def test_a_node_of_ros_1_has_a_logger_whose_level_is_set_over_the_graph(noetic: MemoryGraph) -> None:
    async with noetic:
        node, other = Node(noetic, "talker"), Node(noetic, "other")
        lines: list[str] = []
        node.subscribe("/rosout", lambda line: lines.append(line.msg))
        listed = await other.call("/talker/get_loggers")
        assert [(each.name, each.level) for each in listed.loggers] == [("rosout", "debug")]
        await other.call("/talker/set_logger_level", {"logger": "rosout", "level": "Warn"})
        node.log.info("quiet")
        node.log.warning("loud")
        assert lines == ["loud"]
        (logger,) = (await other.call("/talker/get_loggers")).loggers
        assert logger.level == "warn"
        with pytest.raises(ServiceFailed, match="its levels are debug, info, warn, error, fatal"):
            await other.call("/talker/set_logger_level", {"logger": "rosout", "level": "loud"})


def test_a_node_of_ros_2_has_none(graph: MemoryGraph) -> None:
    Node(graph, "talker")
    assert graph.service("/talker/get_loggers") is None
