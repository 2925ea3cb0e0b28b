from __future__ import annotations

import json
from typing import Any

import anyio.to_thread
import pytest

from rwt.cli import main
from rwt.extensions.ros1 import Ros1Graph
from rwt.extensions.ros1.diagnosis import NodeReport, examine_nodes
from rwt.extensions.ros1.wire import rpc
from tests.processes import free_port

pytestmark = pytest.mark.anyio

UNRESOLVED = "http://robot-of-nobody.invalid:4567/"


async def test_nodes_that_cannot_be_reached_are_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    gone = f"http://127.0.0.1:{free_port()}/"
    async with Ros1Graph(master=f"ros1-master://127.0.0.1:{free_port()}") as graph:
        for name, uri in (("/desktop", UNRESOLVED), ("/crashed", gone)):
            await rpc.call(graph.master, "registerPublisher", name, "/chatter", "std_msgs/String", uri)
        reports = {each.name: each for each in await examine_nodes(graph.master)}
        assert reports["/desktop"] == NodeReport("/desktop", UNRESOLVED, "unresolved")
        assert reports["/crashed"] == NodeReport("/crashed", gone, "silent")
        url = graph.master.replace("http:", "ros1:")
        code = await anyio.to_thread.run_sync(main, ["doctor", url, "--json"])
    record: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert code == 1
    problems = [each["text"] for each in record["findings"] if each["verdict"] == "problem"]
    assert len(problems) == 2
    assert "robot-of-nobody.invalid does not resolve here" in problems[1]
