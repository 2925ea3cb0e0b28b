"""Ctrl-C and SIGTERM, sent to programs in processes of their own when they say that they spin."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

#: How long a process may take to start or to end, in seconds: only one that hangs takes so long.
PATIENCE = 60

SPINS = """
import rclpy
from rclpy.executors import {executor}

rclpy.init()
node = rclpy.create_node("talker")
executor = {executor}()
executor.add_node(node)
said = []

def tell():
    if not said:
        said.append(True)
        print("spinning", flush=True)

node.create_timer(0.01, tell)
try:
    executor.spin()
except BaseException as error:
    print(type(error).__name__, flush=True)
print("ok", rclpy.ok(), flush=True)
rclpy.try_shutdown()
print("end", flush=True)
"""

HOLDS_ITS_OWN = """
import rclpy
from rclpy.signals import SignalHandlerOptions

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("talker")
try:
    print("spinning", flush=True)
    rclpy.spin(node)
except KeyboardInterrupt:
    print("interrupted, ok", rclpy.ok(), flush=True)
rclpy.shutdown()
print("end", flush=True)
"""


INTERRUPTED_WITHIN = """
import signal
import rclpy
from rclpy.executors import {executor}

rclpy.init()
node = rclpy.create_node("talker")
executor = {executor}()
executor.add_node(node)
owner, name = executor{path}, {name!r}
original = getattr(owner, name)

def interrupted(*arguments):
    signal.raise_signal(signal.SIGINT)
    print("goes on", flush=True)
    return original(*arguments)

timer = node.create_timer(0.01, lambda: None)
print("spinning", flush=True)
setattr(owner, name, interrupted)
try:
    executor.spin()
except KeyboardInterrupt:
    print("interrupted", flush=True)
setattr(owner, name, original)
executor.shutdown(wait_for_threads=True) if {pool} else executor.shutdown()
print("end", flush=True)
"""


#: Nobody answers: each of these waits until a signal comes.
BLOCKING = """
import threading
import rclpy
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String

def begin(at_wait):
    rclpy.init(args=["--ros-args", "--log-level", "fatal"])
    node = rclpy.create_node("asks")

    def spin():
        try:
            rclpy.spin(node, rclpy.executors.SingleThreadedExecutor())
        except rclpy.executors.ExternalShutdownException:
            pass
        finally:
            node.destroy_node()

    keeper = node.context._rwt_link.timekeeper

    def wait(condition, deadline):
        if threading.current_thread() is not spinner:
            at_wait()
        type(keeper).wait(keeper, condition, deadline)

    keeper.wait = wait
    spinner = threading.Thread(target=spin)
    spinner.start()
    client, goals = node.create_client(AddTwoInts, "nobody"), ActionClient(node, Fibonacci, "nobody")
    return spinner, {
        "call": lambda: client.call(AddTwoInts.Request()),
        "send_goal": lambda: goals.send_goal(Fibonacci.Goal()),
        "rate.sleep": node.create_rate(0.001).sleep,
        "sleep_for": lambda: node.get_clock().sleep_for(Duration(seconds=1000)),
        "wait_for_message": lambda: wait_for_message(String, node, "/silence"),
        "wait_for_service": client.wait_for_service,
    }

def outcome(name, wait):
    try:
        said = wait()
    except BaseException as error:
        said = type(error).__name__
    print(f"{name} {said}\\n", end="", flush=True)
"""

IN_THREADS = (
    BLOCKING
    + """
import time

waiting = set()
spinner, waits = begin(lambda: waiting.add(threading.current_thread()))
threads = [threading.Thread(target=outcome, args=item) for item in waits.items()]
for thread in threads:
    thread.start()
while len(waiting) < len(threads):
    time.sleep(0.02)
print("spinning", flush=True)
while spinner.is_alive() or any(thread.is_alive() for thread in threads):
    time.sleep(0.02)
print("end", flush=True)
"""
)

#: Python notices it as late as one that comes right before the main thread waits: when that runs again.
TOLD_TO_ANOTHER_THREAD = """
import signal
import threading
import rclpy

rclpy.init()
node = rclpy.create_node("talker")
keeper = node.context._rwt_link.timekeeper

def send():
    with begun:
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)

def wait(condition, deadline):
    global begun
    if threading.current_thread() is threading.main_thread():
        del keeper.wait
        begun = condition  # held until the main thread waits
        threading.Thread(target=send).start()
    type(keeper).wait(keeper, condition, deadline)

keeper.wait = wait
print("spinning", flush=True)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    print("interrupted", flush=True)
rclpy.try_shutdown()
print("end", flush=True)
"""

#: Raised where each of them waits.
IN_THE_MAIN_THREAD = (
    BLOCKING
    + """
import signal

print("spinning", flush=True)
for name in ("call", "send_goal", "rate.sleep", "sleep_for", "wait_for_message", "wait_for_service"):
    spinner, waits = begin(lambda: signal.raise_signal(signal.SIGINT))
    outcome(name, waits[name])
    spinner.join()  # Else the signal may end the next context, too.
    rclpy.try_shutdown()
"""
)


def run(tmp_path: Path, program: str, number: signal.Signals | None) -> tuple[list[str], int]:
    """Return the output of a program after it spins and receives a signal, if any, and its exit code."""
    file = tmp_path / "program.py"
    file.write_text(program)
    with subprocess.Popen(
        [sys.executable, "-m", "rwt_rclpy", str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "RWT_RCLPY_GRAPH": "memory"},
        # A shell's background ignores Ctrl-C, and what it starts inherits that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        assert process.stdout is not None
        too_long = threading.Timer(PATIENCE, process.kill)
        too_long.start()
        try:
            assert process.stdout.readline() == "spinning\n"
            if number is not None:
                process.send_signal(number)
            said = process.stdout.read()
            process.wait()
        finally:
            too_long.cancel()
            process.kill()
    return said.splitlines(), process.returncode


@pytest.mark.parametrize("executor", ["SingleThreadedExecutor", "MultiThreadedExecutor"])
def test_sigterm_ends_the_context_and_the_spin(tmp_path: Path, executor: str) -> None:
    said, code = run(tmp_path, SPINS.format(executor=executor), signal.SIGTERM)
    assert "KeyboardInterrupt" not in said and said[-2:] == ["ok False", "end"] and code == 0
    # A spin that is between two callbacks just ends, as in rclpy; one that waits raises.
    assert said[:-2] in ([], ["ExternalShutdownException"])


@pytest.mark.parametrize("executor", ["SingleThreadedExecutor", "MultiThreadedExecutor"])
def test_ctrl_c_ends_the_context_and_interrupts_the_main_thread(tmp_path: Path, executor: str) -> None:
    said, code = run(tmp_path, SPINS.format(executor=executor), signal.SIGINT)
    # The executor is woken, and Python raises KeyboardInterrupt: which comes first is a race on ROS too.
    assert said[0] in ("KeyboardInterrupt", "ExternalShutdownException", "ok False")
    assert said[-1] == "end" and code == 0


def test_without_handlers_ctrl_c_leaves_the_context_alone(tmp_path: Path) -> None:
    said, code = run(tmp_path, HOLDS_ITS_OWN, signal.SIGINT)
    assert said == ["interrupted, ok True", "end"] and code == 0


@pytest.mark.parametrize(
    "executor, path, name",
    [
        ("SingleThreadedExecutor", "._keeper", "wait"),
        ("MultiThreadedExecutor", "._keeper", "wait"),
        ("MultiThreadedExecutor", "._pool", "submit"),
    ],
)
def test_ctrl_c_cuts_nothing_in_two_that_takes_locks_or_starts_threads(
    tmp_path: Path, executor: str, path: str, name: str
) -> None:
    pool = executor == "MultiThreadedExecutor"
    program = INTERRUPTED_WITHIN.format(executor=executor, path=path, name=name, pool=pool)
    said, code = run(tmp_path, program, None)
    assert said == ["goes on", "interrupted", "end"] and code == 0


def test_what_waits_ends_with_sigterm(tmp_path: Path) -> None:
    said, code = run(tmp_path, IN_THREADS, signal.SIGTERM)
    assert (sorted(said[:-1]), said[-1], code) == (
        [
            "call ExternalShutdownException",
            "rate.sleep ROSInterruptException",
            "send_goal ExternalShutdownException",
            "sleep_for False",
            "wait_for_message (False, None)",
            "wait_for_service False",
        ],
        "end",
        0,
    )


def test_ctrl_c_interrupts_what_waits_in_the_main_thread(tmp_path: Path) -> None:
    said, code = run(tmp_path, IN_THE_MAIN_THREAD, None)
    waits = ("call", "send_goal", "rate.sleep", "sleep_for", "wait_for_message", "wait_for_service")
    assert (said, code) == ([f"{name} KeyboardInterrupt" for name in waits], 0)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals are sent to processes here")
def test_a_signal_that_ends_no_wait_is_answered_soon(tmp_path: Path) -> None:
    said, code = run(tmp_path, TOLD_TO_ANOTHER_THREAD, None)
    assert said == ["interrupted", "end"] and code == 0


def test_who_interrupts_twice_does_not_wait() -> None:
    from rwt_rclpy.execution.interruption import Uninterrupted

    part, done = Uninterrupted(), []
    with part:
        with part:
            part.interrupt(lambda: done.append("first"))
        assert not done
        part.interrupt(lambda: done.append("second"))
        assert done == ["second"]
        part.interrupt(lambda: done.append("third"))
    assert done == ["second", "third"]
    part.interrupt(lambda: done.append("at once"))
    assert done[-1] == "at once"
