"""End of a robot's program: clean-up, exit code, and output."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.sync.client import ClientConnection, connect

from rwt import BlockingNode, Server
from rwt.server import Loop

ROOT = Path(__file__).parents[3]

_IMPORTS = """
import asyncio, sys, threading, time
import anyio
from rwt import Server

def refuse(*_):
    raise NotImplementedError  # As event loops do on Windows.

asyncio.AbstractEventLoop.add_signal_handler = refuse
asyncio.SelectorEventLoop.add_signal_handler = refuse

def fail(request):
    raise KeyError("a bug")

def leave(request):
    sys.exit(3)

class Lost(BaseException):
    pass

def lose(request):
    try:
        asyncio.get_running_loop().stop()
    except RuntimeError:
        raise Lost("the loop") from None  # On trio.

def serve(node):
    node.advertise_service("/fail", "std_srvs/Trigger", fail)
    node.advertise_service("/leave", "std_srvs/Trigger", leave)
    node.advertise_service("/lose", "std_srvs/Trigger", lose)
    return node.advertise("/cmd_vel", "geometry_msgs/Twist")
"""

COROUTINE = """
async def main(server):
    motors = serve(server.node("my_robot"))
    try:
        print("ready", flush=True)
        await anyio.sleep_forever()
    finally:
        motors.publish({{}})
        with anyio.move_on_after(2, shield=True):
            await anyio.sleep(0.001)
            print("motors off", flush=True)

sys.exit(Server("ws://127.0.0.1:0", loop={loop!r}).run(main))
"""

_BODY = """
def main(robot):
    motors = serve(robot)
    try:
        print("ready", flush=True)
        WAIT
    finally:
        motors.publish({{}})
        print("motors off", flush=True)
"""
_RUN = 'sys.exit(Server("ws://127.0.0.1:0", loop={loop!r}).run(main))'
_ENTER = 'with Server("ws://127.0.0.1:0", loop={loop!r}) as robot: main(robot)'

PROGRAMS = {
    "coroutine": COROUTINE,
    "function": _BODY.replace("WAIT", "while True: time.sleep(0.05)") + _RUN,
    # Without a last message: the loop may be lost.
    "spins": _BODY.replace("WAIT", "robot.spin()").replace("motors.publish({{}})", "pass") + _ENTER,
    "waits": _BODY.replace("WAIT", "robot.server.announce(); threading.Event().wait()") + _ENTER,
}


@contextmanager
def running(
    program: str, loop: Loop = "asyncio", stderr: int = subprocess.PIPE
) -> Iterator[tuple[subprocess.Popen[str], ClientConnection]]:
    """The program, and a client of it."""
    process = subprocess.Popen(
        [sys.executable, "-c", _IMPORTS + program.format(loop=loop)],
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        start_new_session=stderr != subprocess.PIPE,
    )
    try:
        assert process.stdout is not None
        lines = {process.stdout.readline() for _ in range(2)}
        (line,) = lines - {"ready\n"}
        with connect(line.removeprefix("listening on ").strip()) as client:
            yield process, client
    finally:
        process.kill()
        process.communicate()


def ended(process: subprocess.Popen[str], client: ClientConnection) -> tuple[int, str, str]:
    """Exit code, output and errors of a program that ends; its client is closed properly."""
    for _ in client:
        pass
    assert client.close_code == 1001
    out, errors = process.communicate(timeout=60)
    return process.returncode, out, errors


_BOTH = (signal.SIGINT, signal.SIGTERM)
_SIGNALS = [(name, number) for name in ("coroutine", "function", "spins") for number in _BOTH]


@pytest.mark.parametrize(("name", "number"), [*_SIGNALS, ("waits", signal.SIGTERM)])
def test_a_signal_ends_a_robot(name: str, number: signal.Signals, loop: Loop) -> None:
    with running(PROGRAMS[name], loop) as (process, client):
        process.send_signal(number)
        assert ended(process, client) == (0, "motors off\n", "")


@pytest.mark.parametrize("name", PROGRAMS)
def test_an_exception_in_a_handler_ends_nothing(name: str, loop: Loop) -> None:
    with running(PROGRAMS[name], loop) as (process, client):
        for number in range(2):
            client.send(json.dumps({"op": "call_service", "id": str(number), "service": "/fail"}))
            answer = json.loads(client.recv(timeout=60))
            assert (answer["result"], answer["values"]) == (False, "'a bug'")
        process.send_signal(signal.SIGTERM)
        code, out, errors = ended(process, client)
    assert (code, out) == (0, "motors off\n")
    assert errors.count("service /fail failed") == 2


@pytest.mark.parametrize("loop", ["asyncio", "trio"], indirect=True)  # uvloop logs it, and goes on.
@pytest.mark.parametrize("name", ["coroutine", "spins"])
def test_a_handler_that_exits_ends_the_program_with_its_code(name: str, loop: Loop) -> None:
    with running(PROGRAMS[name], loop) as (process, client):
        client.send(json.dumps({"op": "call_service", "service": "/leave"}))
        out, _ = process.communicate(timeout=60)
    assert (process.returncode, out) == (3, "motors off\n")


def test_a_loop_that_is_lost_is_reported_by_what_waits(loop: Loop) -> None:
    with running(PROGRAMS["spins"], loop) as (process, client):
        client.send(json.dumps({"op": "call_service", "service": "/lose"}))
        out, errors = process.communicate(timeout=60)
    assert (process.returncode, out) == (1, "motors off\n")
    assert errors.splitlines()[-1].startswith(
        "rwt.errors.ServerError: the event loop of the server was lost: "
    )


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="there is no SIGHUP here")
@pytest.mark.parametrize("name", PROGRAMS)
def test_a_hangup_ends_nothing_unless_the_terminal_is_gone(name: str, loop: Loop) -> None:
    terminal, end = pty.openpty()
    with running(PROGRAMS[name], loop, stderr=end) as (process, client):
        os.close(end)
        process.send_signal(signal.SIGHUP)
        client.send(json.dumps({"op": "call_service", "id": "1", "service": "/fail"}))
        assert json.loads(client.recv(timeout=60))["id"] == "1"
        os.close(terminal)
        process.send_signal(signal.SIGHUP)
        code, out, _ = ended(process, client)
    assert (code, out) == (0, "motors off\n")


def test_an_exception_of_the_program_is_raised_by_run(loop: Loop) -> None:
    closed = []

    async def main(server: Server) -> None:
        try:
            raise ValueError("no motor")
        finally:
            closed.append(server.running)

    def function(robot: object) -> None:
        raise ValueError("no motor")

    for program in (main, function):
        with pytest.raises(ValueError, match="no motor"):
            Server("ws://127.0.0.1:0", loop=loop).run(program)
    assert closed == [True]


def test_a_program_that_returns_has_ended(loop: Loop, capsys: pytest.CaptureFixture[str]) -> None:
    done: list[bool] = []

    async def main(server: Server) -> None:
        done.append(server.running)

    def function(robot: BlockingNode) -> None:
        done.append(robot.server.running)

    assert Server("ws://127.0.0.1:0", loop=loop).run(main) == 0
    assert Server("ws://127.0.0.1:0", loop=loop).run(function) == 0
    assert done == [True, True]
    said = capsys.readouterr().out.splitlines()
    assert [line.rpartition(":")[0] for line in said] == ["listening on ws://127.0.0.1"] * 2


@pytest.mark.parametrize("missing", ["open_signal_receiver", "add_signal_handler"])
def test_nothing_asks_an_event_loop_for_signals(missing: str) -> None:
    """Windows has neither: `rwt.signals` is for every system."""
    sources = [*(ROOT / "src").rglob("*.py"), *(ROOT / "examples").rglob("*.py")]
    assert len(sources) > 300
    assert [path for path in sources if missing in path.read_text(encoding="utf-8")] == []


_THREADS = """
{imports}
stop = threading.Event()
told = []

def function(node):
    motors = serve(node)
    try:
        node.call("/rosapi/get_time")
        stop.wait()
    finally:
        motors.publish({{}})
        told.append("function cleaned up")

async def coroutine(server):
    motors = serve(server.node("my_robot"))
    try:
        await anyio.to_thread.run_sync(stop.wait, abandon_on_cancel=True)
    finally:
        motors.publish({{}})
        told.append("coroutine cleaned up")

def block():
    with Server("ws://127.0.0.1:0", loop="{loop}") as node:
        motors = serve(node)
        stop.wait()
        motors.publish({{}})
    told.append("block cleaned up")

def run(main):
    code = Server("ws://127.0.0.1:0", loop="{loop}").run(main)
    told.append(f"{{main.__name__}} ended with {{code}}")

threads = [threading.Thread(target=run, args=(main,)) for main in (function, coroutine)]
threads.append(threading.Thread(target=block))
for thread in threads:
    thread.start()
stop.set()
for thread in threads:
    thread.join()
print("\\n" + "\\n".join(sorted(told)))
"""


def test_threads_of_a_program_without_a_loop_have_robots_of_their_own(loop: Loop) -> None:
    code = _THREADS.format(imports=_IMPORTS, loop=loop)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, "")
    cleaned = [f"{name} cleaned up" for name in ("block", "coroutine", "function")]
    ended = [f"{name} ended with 0" for name in ("coroutine", "function")]
    assert done.stdout.splitlines()[-5:] == sorted([*cleaned, *ended])
