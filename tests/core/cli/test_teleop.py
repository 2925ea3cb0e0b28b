"""`rwt teleop` in a terminal: it drives while a key is held, and whatever ends it, the robot stands."""

from __future__ import annotations

import json
import os
import pty
import queue
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from rwt import Server
from rwt.cli.commands.teleop import HeldKey
from tests.core.cli.conftest import process

_UP = b"\x1b[A"
_LIMIT = 20.0


def test_a_key_is_held_from_its_first_press_until_its_repeats_end() -> None:
    held = HeldKey()
    assert held.at(0.0) is None
    held.press("up", 1.0)
    assert (held.at(1.6), held.at(1.75)) == ("up", None)
    for repeat in (1.5, 1.53, 1.56):
        held.press("up", repeat)
    assert (held.at(1.7), held.at(1.8)) == ("up", None)
    held.press("left", 1.6)
    assert (held.at(1.65), held.at(2.25)) == ("left", "left")


class Driven:
    """A robot, and `rwt teleop` in a terminal of its own."""

    def __init__(self, url: str, commands: queue.SimpleQueue[tuple[float, float]]) -> None:
        self._commands = commands
        self.terminal, inner = pty.openpty()
        self.process = process("teleop", "--json", url=url, terminal=inner)
        os.close(inner)
        assert self.process.stderr is not None
        assert "hold an arrow key" in self.process.stderr.readline()

    def press(self, keys: bytes) -> None:
        """Type into the terminal."""
        os.write(self.terminal, keys)

    def hang_up(self) -> None:
        """Close the terminal."""
        os.close(self.terminal)
        self.terminal = -1

    def wait_for(self, *wanted: float) -> None:
        """Wait until the robot was given this command."""
        while self._commands.get(timeout=_LIMIT) != wanted:
            pass

    def ended(self) -> tuple[int, str, str]:
        """Exit code, output and errors, once it has ended."""
        out, err = self.process.communicate(timeout=_LIMIT)
        return self.process.returncode, out, err

    def close(self) -> None:
        """End it, if it has not ended."""
        self.process.kill()
        self.process.communicate()
        if self.terminal >= 0:
            os.close(self.terminal)


@contextmanager
def _driven(type: str) -> Iterator[Driven]:
    commands: queue.SimpleQueue[tuple[float, float]] = queue.SimpleQueue()

    def note(message: Any) -> None:
        twist = getattr(message, "twist", message)
        commands.put((twist.linear.x, twist.angular.z))

    with Server("ws://127.0.0.1:0") as robot:
        robot.subscribe("/cmd_vel", note, type=type)
        driven = Driven(robot.server.urls[0], commands)
        try:
            yield driven
        finally:
            driven.close()


@pytest.mark.parametrize("type", ["geometry_msgs/Twist", "geometry_msgs/TwistStamped"])
def test_it_drives_while_a_key_is_held(type: str) -> None:
    with _driven(type) as driven:
        for key, command in ((_UP, (0.3, 0.0)), (b"\x1b[B", (-0.3, 0.0)), (b"\x1b[D\x1b[D", (0.0, 1.0))):
            driven.press(key)
            driven.wait_for(*command)
        driven.wait_for(0.0, 0.0)  # Nothing more was pressed.
        driven.press(_UP)
        driven.wait_for(0.3, 0.0)
        driven.press(b" ")
        driven.wait_for(0.0, 0.0)
        driven.press(b"q")
        code, out, err = driven.ended()
    assert (code, err) == (0, "")
    assert {"linear": 0.3, "angular": 0.0} in [json.loads(line) for line in out.splitlines()]


_ENDINGS: dict[str, Callable[[Driven], None]] = {
    "q": lambda driven: driven.press(b"q"),
    "Ctrl-C": lambda driven: driven.press(b"\x03"),
    "SIGTERM": lambda driven: driven.process.send_signal(signal.SIGTERM),
    "SIGHUP": Driven.hang_up,
}


@pytest.mark.parametrize("ending", _ENDINGS)
def test_whatever_ends_it_the_robot_stands(ending: str) -> None:
    with _driven("geometry_msgs/Twist") as driven:
        driven.press(_UP)
        driven.wait_for(0.3, 0.0)
        _ENDINGS[ending](driven)
        driven.wait_for(0.0, 0.0)
        assert driven.ended()[0] == 0
