"""Clients that are killed, stopped, or gone in the midst of a call: the others hear what they must, soon."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tests.docs.blocks import ROOT
from tests.faults.blocking_client import BlockingClient
from tests.faults.conftest import Robot
from tests.waiting import PATIENCE


@contextmanager
def program(robot: Robot, what: str) -> Iterator[int]:
    """A client in a process of its own; gives its id, and ends it."""
    path = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.faults.program", str(robot.ports[0]), what],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    with process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "ready\n"
            yield process.pid
        finally:
            process.kill()


def talk(client: BlockingClient, words: str) -> None:
    """Publish to oneself."""
    client.say("publish", topic="/talk", type="std_msgs/String", msg={"data": words})
    assert client.hear("publish", topic="/talk")["msg"] == {"data": words}


def test_a_client_killed_in_the_midst_of_a_frame(robot: Robot) -> None:
    with robot.connect() as other:
        other.say("subscribe", topic="/talk", type="std_msgs/String")
        with program(robot, "half a frame") as pid:
            talk(other, "before")
            os.kill(pid, signal.SIGKILL)
            robot.wait_for_clients(1)
        talk(other, "after")
        other.say("call_service", service="/doomed", id="c", args={"data": True})
        reply = other.hear("service_response", id="c")
        assert not reply["result"] and "does not exist" in str(reply["values"])


def test_a_stopped_client_is_counted_as_gone(robot: Robot) -> None:
    """Its kernel acknowledges, it does not answer: what a half-open connection looks like from here."""
    with robot.connect() as other, program(robot, "be stopped") as pid:
        other.say("subscribe", topic="/talk", type="std_msgs/String")
        os.kill(pid, signal.SIGSTOP)
        other.say("call_service", service="/doomed", id="c", timeout=0, args={"data": True})
        talk(other, "meanwhile")
        reply = other.hear("service_response", id="c")
        assert not reply["result"]
        robot.wait_for_clients(1)


def test_a_stopped_client_that_is_talked_to_is_counted_as_gone(robot: Robot) -> None:
    """The network takes some of what it is sent, which is no sign of life for ever."""
    with robot.connect() as other, program(robot, "be stopped") as pid:
        other.say("advertise", topic="/talk", type="std_msgs/String")
        os.kill(pid, signal.SIGSTOP)
        deadline = time.monotonic() + PATIENCE
        while robot.clients > 1:
            assert time.monotonic() < deadline, "it still counts as alive"
            other.say("publish", topic="/talk", msg={"data": "x" * 100_000})
            time.sleep(0.01)
        other.ask_something()


def test_a_provider_gone_in_the_midst_of_a_call(robot: Robot) -> None:
    with robot.connect() as caller, contextlib.ExitStack() as stack:
        provider = stack.enter_context(robot.connect())
        provider.say("advertise_service", service="/slow", type="std_srvs/SetBool")
        provider.ask_something()
        caller.say("call_service", service="/slow", id="c", timeout=0, args={"data": True})
        provider.hear("call_service", service="/slow")
        provider.reset()
        reply = caller.hear("service_response", id="c")
        assert not reply["result"] and reply["values"]
        caller.ask_something()


def test_a_provider_gone_in_the_midst_of_a_goal(robot: Robot) -> None:
    fibonacci = {"action": "/slow", "action_type": "example_interfaces/Fibonacci"}
    with robot.connect() as sender, robot.connect() as provider:
        provider.say("advertise_action", action="/slow", type="example_interfaces/Fibonacci")
        provider.ask_something()
        sender.say("send_action_goal", **fibonacci, id="g", feedback=True, args={"order": 3})
        goal = provider.hear("send_action_goal", action="/slow")
        provider.say("action_feedback", action="/slow", id=goal["id"], values={"sequence": [0]})
        sender.hear("action_feedback", action="/slow", id="g")
        provider.reset()
        result = sender.hear("action_result", action="/slow", id="g")
        assert not result["result"]
        sender.ask_something()


def test_a_caller_gone_in_the_midst_of_its_call(robot: Robot) -> None:
    with robot.connect() as provider, robot.connect() as caller:
        provider.say("advertise_service", service="/slow", type="std_srvs/SetBool")
        provider.ask_something()
        caller.say("call_service", service="/slow", id="c", timeout=0, args={"data": True})
        call = provider.hear("call_service", service="/slow")
        caller.reset()
        robot.wait_for_clients(1)
        provider.say(
            "service_response", service="/slow", id=call["id"], result=True, values={"success": True}
        )
        provider.ask_something()
