"""A server with a script, as a test in any language meets it: over a socket."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rwt import Server
from rwt_client.blocking import BlockingRobot, connect
from rwt_participant.errors import CallFailed, TimedOut
from tests.waiting import wait_until

LAB = """
name = "lab"

[parameters]
max_speed = 0.5

[topics."/map_name"]
type = "std_msgs/String"
latched = { data = "lab" }

[topics."/count"]
type = "std_msgs/Int32"
messages = [{ data = 1 }, { data = 2 }]
rate = 50

[topics."/battery"]
type = "std_msgs/Float32"
messages = [{ data = 0.9 }, { data = 0.1 }]

[topics."/drive"]
type = "std_msgs/Int32"
file = "drive.jsonl"
repeat = true

[topics."/cmd_vel"]
type = "geometry_msgs/Twist"

[services."/add"]
type = "example_interfaces/AddTwoInts"
returns = [{ sum = 0 }, { sum = 1 }]

[[services."/add".when]]
request = { a = 2, b = 3 }
returns = { sum = 5 }

[[services."/add".when]]
request = { a = 2 }
fails = "two and what?"

[[services."/add".when]]
request = { a = 99 }
never_answers = true

[actions."/fib"]
type = "example_interfaces/Fibonacci"
feedback = [{ sequence = [0] }, { sequence = [0, 1] }]
every = 0.01
succeeds = { sequence = [0, 1, 1] }

[[faults]]
drop = "/secret"
op = "publish"
"""


@contextmanager
def served(folder: Path, name: str, text: str) -> Iterator[str]:
    (folder / name).write_text(text, encoding="utf-8")
    with Server("ws://127.0.0.1:0", script=folder / name) as robot:
        yield robot.server.urls[0]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("lab")
    (folder / "drive.jsonl").write_text('{"at": 0, "msg": {"data": 7}}\n{"at": 0.05, "msg": {"data": 8}}\n')
    with served(folder, "lab.toml", LAB) as url:
        yield url


@pytest.fixture
def app(lab: str) -> Iterator[BlockingRobot]:
    with connect(lab) as robot:
        robot.call("/rwt_script/reset")
        yield robot


def received(app: BlockingRobot) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(app.call("/rwt_script/received").message)
    return answer


def test_topics(app: BlockingRobot) -> None:
    assert app.once("/map_name").data == "lab"
    assert app.once("/count").data in (1, 2)
    assert app.once("/drive").data in (7, 8)


def test_answers(app: BlockingRobot) -> None:
    assert [app.call("/add", {"a": 1}).sum for _ in range(3)] == [0, 1, 1]
    assert app.call("/add", {"a": 2, "b": 3}).sum == 5
    with pytest.raises(CallFailed, match="two and what"):
        app.call("/add", {"a": 2, "b": 4})
    with pytest.raises(TimedOut):
        app.call("/add", {"a": 99}, timeout=0.2)
    assert [call["a"] for call in received(app)["called"]["/add"]] == [1, 1, 1, 2, 2, 99]


def test_a_goal(app: BlockingRobot) -> None:
    goal = app.send_goal("/fib", {"order": 3})
    assert [list(message.sequence) for message in goal] == [[0], [0, 1]]
    assert list(goal.result(timeout=10).result.sequence) == [0, 1, 1]
    assert received(app)["goals"] == {"/fib": [{"order": 3}]}


def test_parameters_and_reset(app: BlockingRobot) -> None:
    app.params.set("/lab:max_speed", 2.0)
    app.publish("/cmd_vel", {"linear": {"x": 0.5}}, "geometry_msgs/Twist")
    wait_until(lambda: "/cmd_vel" in received(app)["published"])
    assert received(app)["published"]["/cmd_vel"][0]["linear"]["x"] == 0.5
    assert app.call("/rwt_script/reset").success
    assert received(app) == {"published": {}, "called": {}, "goals": {}, "clients": 1}
    assert app.params.get("/lab:max_speed") == 0.5


def test_a_topic_that_waits_to_be_told(app: BlockingRobot) -> None:
    answers = [app.call("/rwt_script/next/battery") for _ in range(3)]
    assert [answer.success for answer in answers] == [True, True, False]
    assert answers[0].message == "/battery: message 1 of 2"
    assert "call /rwt_script/reset" in answers[2].message
    app.call("/rwt_script/reset")
    assert app.call("/rwt_script/next/battery").success


def test_faults_are_switched_off_and_on(app: BlockingRobot) -> None:
    def secrets() -> int:
        app.publish("/secret", {"data": 1}, "std_msgs/Int32")
        return len(received(app)["published"].get("/secret", ()))

    assert secrets() == 0
    assert app.call("/rwt_script/faults", {"data": False}).message == "0 faults"
    assert secrets() == 1
    assert app.call("/rwt_script/faults", {"data": True}).message == "1 faults"
    assert secrets() == 1


def test_disconnect_hangs_up_on_everybody(lab: str, app: BlockingRobot) -> None:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect as connect_socket

    with connect_socket(lab) as socket:
        socket.send(json.dumps({"op": "call_service", "service": "/rwt_script/disconnect"}))
        assert json.loads(socket.recv(timeout=60))["result"] is True
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=60)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1011


PROGRAM = """
import anyio
from beside import LIMIT

def robot(robot):
    robot.on_service("/limit", "std_srvs/Trigger").returns({"message": LIMIT})
    stop = robot.publishes("/stopped", "std_msgs/Bool", latch=True)

    def judge(twist):
        stop.publish({"data": twist.linear.x == 0})

    robot.subscribe("/cmd_vel", judge, "geometry_msgs/Twist")
"""


def test_a_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "beside.py").write_text("LIMIT = 'half'")
    with served(tmp_path, "robot.py", PROGRAM) as url, connect(url) as app:
        for _ in range(2):
            assert app.call("/limit").message == "half"
            app.publish("/cmd_vel", {}, "geometry_msgs/Twist")
            assert app.once("/stopped", timeout=60).data is True
            app.call("/rwt_script/reset")
