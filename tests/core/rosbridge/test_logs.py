"""The bridge's log: every line has the client and the op as fields, and no handler can break the server."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from tests.core.rosbridge.recording_client import Client


class FullDisk(logging.Handler):
    """A handler that does not catch what its disk says."""

    def emit(self, record: logging.LogRecord) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.fixture
def full_disk() -> Iterator[None]:
    logger = logging.getLogger("rwt.bridge")
    handler = FullDisk()
    logger.addHandler(handler)
    level = logger.level
    logger.setLevel(logging.DEBUG)
    yield
    logger.setLevel(level)
    logger.removeHandler(handler)


def test_every_line_of_a_clients_life_has_its_name(
    client: Client, bridge: Bridge, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "rwt.bridge")
    second = Client(bridge)
    second.say("unsubscribe", topic="/x", id="u:1")
    second.say("call_service", service="/x", id=7)
    second.say_raw("no JSON")
    second.leave()
    fields = [(record.__dict__["client"], record.__dict__["op_id"]) for record in caplog.records]
    name = "rosbridge:2"
    assert fields == [(name, None), (name, "u:1"), (name, 7), (name, None), (name, None)]
    assert all(record.funcName != "write" for record in caplog.records)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_takes_nothing_down(bridge: Bridge) -> None:
    client = Client(bridge)
    client.say("set_level", level="error")
    client.say("unadvertise", topic="/x")
    client.say("nonsense")
    client.say("call_service", service="/x", id="c")
    assert [message["op"] for message in client.heard()] == ["status", "service_response"]
    client.leave()
    assert bridge.client_count == 0 and bridge.access.audit.dropped_lines == 5


def test_a_client_cannot_fill_the_log(
    clock: SimulatedClock, bridge: Bridge, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "rwt.bridge")
    client = Client(bridge)
    caplog.clear()
    for _ in range(200):
        client.say("nonsense")
    assert len(caplog.records) == 50
    clock.advance(1.0)
    client.say("unadvertise", topic="/x")
    client.say("nonsense")
    assert len(caplog.records) == 51
    assert caplog.messages[-1].endswith("(150 lines like it were left out)")
    assert "/x" in caplog.messages[-1]
    client.leave()
    assert caplog.messages[-1].endswith("(1 lines about it were left out)")
