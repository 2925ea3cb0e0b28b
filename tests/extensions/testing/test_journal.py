"""Entries of the journal, by sender."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt import Server
from rwt.extensions.testing import ObservedGraph
from rwt.extensions.testing.journal import Journal, Kind, Received
from rwt_client import connect
from rwt_graph import MemoryGraph
from rwt_graph.api import Graph
from rwt_interfaces import Payload, Registry

_STRING = Registry().message("std_msgs/String")


def _entry(name: str, text: str) -> Received:
    return Received(Kind.MESSAGE, name, Payload.from_value(_STRING, {"data": text}), "/app", 0)


def test_all_together_stay_within_the_budget_and_the_largest_gives_way() -> None:
    journal = Journal(kept=100, kept_bytes=50_000)
    journal.add(_entry("/command", "go"))
    for number in range(200):
        journal.add(_entry("/picture", f"{number}" + "x" * 9_000))
        assert journal.bytes <= 50_000
    pictures = [entry.message.data for entry in journal.of(Kind.MESSAGE, "/picture")]
    assert [text.partition("x")[0] for text in pictures] == ["195", "196", "197", "198", "199"]
    assert [entry.message.data for entry in journal.of(Kind.MESSAGE, "/command")] == ["go"]


def test_one_message_beyond_the_budget_is_not_kept() -> None:
    journal = Journal(kept_bytes=50_000)
    journal.add(_entry("/command", "go"))
    journal.add(_entry("/picture", "x" * 60_000))
    assert journal.of(Kind.MESSAGE, "/picture") == ()
    assert len(journal.of(Kind.MESSAGE, "/command")) == 1


def test_what_is_forgotten_makes_room() -> None:
    journal = Journal()
    for name in ("/a", "/b"):
        journal.add(_entry(name, "x" * 1000))
    both = journal.bytes
    journal.clear(lambda entry: entry.name == "/a")
    assert journal.bytes == both // 2
    journal.clear()
    assert journal.bytes == 0


@pytest.mark.anyio
async def test_only_chosen_nodes_are_noted() -> None:
    graph = ObservedGraph(only=("/app",))
    async with graph:
        for name in ("app", "camera"):
            graph.node(name).advertise(f"/{name}", "std_msgs/String").publish({"data": "x"})
    assert {entry.node for kept in graph.journal.everything(Kind.MESSAGE).values() for entry in kept} == {
        "/app"
    }
    assert "/app" in graph.journal.everything(Kind.MESSAGE)


@pytest.mark.anyio
async def test_of_a_server_with_a_script_nothing_of_the_robots_own_is_kept(tmp_path: Path) -> None:
    script = tmp_path / "robot.toml"
    script.write_text('[services."/beep"]\ntype = "std_srvs/Trigger"\nreturns = {}\n')

    class Camera:
        """A node of the robot's own."""

        def __init__(self, graph: Graph) -> None:
            assert isinstance(graph, MemoryGraph)
            self.node = graph.node("camera")
            self.picture = self.node.advertise("/picture", "std_msgs/String")

        def close(self) -> None:
            self.node.close()

    cameras: list[Camera] = []

    def camera(graph: Graph) -> Camera:
        cameras.append(Camera(graph))
        return cameras[0]

    server = Server("ws://127.0.0.1:0", script=script, extra_nodes=[camera])
    async with server, connect(server.urls[0]) as client:
        for _ in range(100):
            cameras[0].picture.publish({"data": "x" * 10_000})
        client.publish("/command", {"data": "go"}, "std_msgs/String")
        await client.call("/beep")
        assert isinstance(server.graph, ObservedGraph)
        noted = server.graph.journal.everything(Kind.MESSAGE)
        assert "/command" in noted and "/picture" not in noted
        assert server.graph.journal.bytes < 20_000
