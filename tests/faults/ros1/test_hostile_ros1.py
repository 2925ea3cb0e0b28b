"""Hostile ROS 1 masters, publishers, subscribers and callers, each in a process of its own.

Whatever they do, `rwt serve` is held for 50 ms at most, answers its clients, keeps within its memory, and
exchanges messages with honest ROS 1 programs afterwards. Nothing of ROS is needed.

`python -m tests.faults.ros1.test_hostile_ros1 [ATTACK…]` prints what each attack did.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

import pytest

from tests.core.transports.rfc6455.frames import PING, PONG, frame
from tests.faults.attacks.attacked import Damage, attacked_server, measured
from tests.faults.blocking_client import BlockingClient
from tests.faults.ros1.hostile import ATTACKS, MASTERS
from tests.processes import ROOT, free_port

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="memory and open files are read from /proc"),
    pytest.mark.timeout(180),
]

HELD: Final = 0.05
"""Seconds for which the event loop is held at a time, at most."""

GROWN: Final = 300
"""MiB by which the server may grow, and by which it grows more where large messages are being received."""
GROWN_BY_FRAMES: Final = 700

LOGGED: Final = 100_000
"""Bytes."""

TRIES: Final = 3
"""Runs of which the best counts: chance only adds to what an attack does."""

TOPICS: Final = {
    "/still": "std_msgs/String",
    "/one": "std_msgs/String",
    "/two": "std_msgs/String",
    "/joints": "sensor_msgs/JointState",
    "/values": "diagnostic_msgs/DiagnosticArray",
    **{f"/empty_{number}": "std_msgs/Empty" for number in range(10)},
}
"""Topics of which the server has subscribers."""


@contextmanager
def hostile(attack: str, port: int) -> Iterator[subprocess.Popen[str]]:
    """The program that attacks."""
    with subprocess.Popen(
        [sys.executable, "-m", "tests.faults.ros1.hostile", attack, str(port)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def talk(client: BlockingClient) -> None:
    """Publish large messages, and read what comes, until the connection is closed."""
    with suppress(OSError):
        while True:
            client.say("publish", topic="/large", msg={"data": "x" * 300_000})
            threading.Event().wait(0.05)


def suffered(attack: str) -> Damage:
    """Let a server suffer, and check that honest programs are heard afterwards."""
    port = free_port()
    scheme = "ros1" if attack in MASTERS else "ros1-master"
    with (
        hostile(attack, port) as program,
        attacked_server("noetic", "admin", f"graph={scheme}://127.0.0.1:{port}") as server,
        BlockingClient(server.port) as client,
        BlockingClient(server.port) as talker,
    ):
        _subscribe(client)
        talker.say("advertise", topic="/large", type="std_msgs/String")
        threading.Thread(target=talk, args=(talker,), daemon=True).start()
        heard = threading.Event()
        threading.Thread(target=_read_until_still, args=(client, heard), daemon=True).start()
        server.waits()
        with measured(server) as found:
            assert program.stdin is not None and program.stdout is not None
            program.stdin.write("\n")
            program.stdin.flush()
            assert program.stdout.readline() == "done\n"
            assert heard.wait(60), "no honest publisher is heard"
            program.kill()
        return found[0]


def _subscribe(client: BlockingClient) -> None:
    for topic, type in TOPICS.items():
        client.say("subscribe", topic=topic, type=type)


def _read_until_still(client: BlockingClient, heard: threading.Event) -> None:
    # Most of what comes before is large, so it is not parsed.
    opcode, payload = client.next_frame()
    while b'"still here"' not in payload:
        if opcode == PING:
            client.socket.sendall(frame(PONG, payload))
        opcode, payload = client.next_frame()
    heard.set()


@pytest.mark.parametrize("attack", [*ATTACKS, *MASTERS])
def test_a_hostile_program_hurts_nobody_else(attack: str) -> None:
    for _ in range(TRIES):
        damage = suffered(attack)
        if damage.held <= HELD:
            break
    assert damage.held <= HELD, damage
    assert damage.ran <= 2 * HELD, damage
    limit = GROWN_BY_FRAMES if attack == "unfinished_frames" else GROWN
    assert damage.grown <= limit, damage
    assert damage.logged <= LOGGED, damage


if __name__ == "__main__":
    for name in sys.argv[1:] or [*ATTACKS, *MASTERS]:
        try:
            row = str(suffered(name))
        except Exception as error:
            row = f"{type(error).__name__}: {error}"
        sys.stdout.write(f"{name:22} {row}\n")
        sys.stdout.flush()
