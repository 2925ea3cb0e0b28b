"""Diagnostics of a robot."""

from __future__ import annotations

import logging
from typing import Any

import anyio
import pytest

from rwt import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater
from rwt_client import ConnectionEvent, NotConnected
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces import NOETIC, Registry
from tests.core.client.worlds import scripted
from tests.waiting import until


class Report:
    """A node, and what is heard on `/diagnostics`."""

    def __init__(self, graph: MemoryGraph, topic: str = "/diagnostics") -> None:
        self.node = Node(graph, "base")
        self.heard: list[Any] = []
        self.node.subscribe(topic, self.heard.append, "diagnostic_msgs/DiagnosticArray")


@pytest.mark.parametrize("registry", [Registry(), Registry(NOETIC)])
def test_an_array_of_all_checks_every_period(registry: Registry) -> None:
    clock = SimulatedClock(start_ns=7_000_000_000)
    report = Report(MemoryGraph(registry, clock))
    updater = DiagnosticUpdater(report.node, "base", hardware_id="chassis 7", period=0.5)
    updater.add("motors", lambda: DiagnosticStatus(message="standing"))
    updater.add("battery", lambda: DiagnosticStatus(DiagnosticLevel.WARN, "low", {"charge": 0.12}))
    clock.advance(1.2)
    assert len(report.heard) == 2
    array = report.heard[0]
    assert clock.time_ns() == 8_200_000_000
    stamp = array.header.stamp
    assert (getattr(stamp, "sec", None) or stamp.secs) == 7
    motors, battery = array.status
    assert (motors.level, motors.name, motors.message) == (0, "base: motors", "standing")
    assert (battery.level, battery.hardware_id) == (1, "chassis 7")
    assert [(each.key, each.value) for each in battery.values] == [("charge", "0.12")]


def test_now_and_no_more() -> None:
    clock = SimulatedClock()
    report = Report(MemoryGraph(clock=clock), "/health")
    updater = DiagnosticUpdater(report.node, "base", topic="/health")
    clock.advance(3.0)
    assert report.heard == []  # There is nothing to report yet.
    updater.add("motors", DiagnosticStatus)
    updater.update()
    updater.remove("motors")
    updater.remove("motors")
    updater.add("arm", DiagnosticStatus)
    clock.advance(1.0)
    updater.close()
    updater.close()
    clock.advance(3.0)
    assert [[each.name for each in array.status] for array in report.heard] == [
        ["base: motors"],
        ["base: arm"],
    ]


def test_a_check_that_fails_is_an_error_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    clock = SimulatedClock()
    report = Report(MemoryGraph(clock=clock))
    broken = True

    def check() -> DiagnosticStatus:
        if broken:
            raise OSError("the bus is off")
        return DiagnosticStatus()

    DiagnosticUpdater(report.node, "base").add("motors", check)
    with caplog.at_level(logging.ERROR):
        clock.advance(3.0)
        broken = False
        clock.advance(1.0)
        broken = True
        clock.advance(1.0)
    found = [(array.status[0].level, array.status[0].message) for array in report.heard]
    failed = (2, "the check failed: the bus is off")
    assert found == [failed, failed, failed, (0, ""), failed]
    assert caplog.text.count("the diagnostic check motors of base failed") == 2


@pytest.mark.parametrize("check", [None, anyio.sleep_forever])
def test_a_check_is_a_plain_function(check: object) -> None:
    updater = DiagnosticUpdater(Node(MemoryGraph(), "base"), "base")
    with pytest.raises(TypeError, match="motors: a check is a plain function that gives a status, got"):
        updater.add("motors", check)  # type: ignore[arg-type]  # the mistake under test


@pytest.mark.anyio
async def test_a_client_reports_again_when_it_is_connected_again() -> None:
    async with scripted() as (server, robot):
        updater = DiagnosticUpdater(robot, "arm", period=0.001)
        updater.add("gripper", DiagnosticStatus)
        refused: list[int] = []

        def look(event: ConnectionEvent) -> None:
            if event.kind == "lost":
                with pytest.raises(NotConnected):
                    updater.update()
                refused.append(len(server.ops("publish")))

        robot.on_event(look)
        await server.hears("publish")
        server.hang_up()
        await until(lambda: refused)
        heard = await server.hears("publish", refused[0] + 1)
        assert heard["msg"]["status"][0]["name"] == "arm: gripper"
