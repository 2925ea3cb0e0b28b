"""`rwt teleop`: drive a robot while an arrow key is held."""

from __future__ import annotations

import math
from contextlib import aclosing, suppress
from typing import TYPE_CHECKING, Final

import anyio

from rwt.cli.console.key_presses import Key, can_press_keys, key_presses
from rwt.cli.console.output import Output, note
from rwt.cli.entities import TOPIC, absolute_name
from rwt.cli.errors import CALLED_WRONGLY, FAILED, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_verb, argument, arguments, hertz, number_within
from rwt.signals import HANGUP, STOP_SIGNALS, on_signals

if TYPE_CHECKING:
    from rwt_client import RemotePublisher, Robot

_TWISTS: Final = ("geometry_msgs/Twist", "geometry_msgs/TwistStamped")
_DIRECTIONS: Final[dict[Key, tuple[float, float]]] = {
    "up": (1.0, 0.0), "down": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0),
}  # fmt: skip
"""Fractions of linear and angular speed by key; forwards and left are positive."""

_FIRST_REPEAT_SECONDS: Final = 0.7
"""Terminals repeat a held key after up to two thirds of a second, and then about 30 times a second."""
_NEXT_REPEAT_SECONDS: Final = 0.2

_FAREWELL_SECONDS: Final = 2.0
_SPEED: Final = number_within("a speed", 0, 1000)


def add_teleop_command(commands: Commands) -> None:
    """Add `teleop` to the command line."""
    add_verb(commands, _TELEOP)


class HeldKey:
    """Held key, derived from the repetitions of the terminal, which does not report releases."""

    def __init__(self) -> None:
        self._key: Key | None = None
        self._until = -math.inf

    def press(self, key: Key, now: float) -> None:
        """Note that a key was pressed or repeated at `now`, in seconds."""
        repeated = key == self.at(now)
        self._key = key
        self._until = now + (_NEXT_REPEAT_SECONDS if repeated else _FIRST_REPEAT_SECONDS)

    def at(self, now: float) -> Key | None:
        """Return the key that is held at `now`; None if there is none."""
        return self._key if now < self._until else None


async def _teleop(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Drive while an arrow key is held; the robot stops on release and on exit.

    example:
      rwt teleop
      rwt teleop /turtle1/cmd_vel --speed 2 --turn 2

    --json prints:
      one line for each command: {"linear": 0.3, "angular": 0.0}; metres and radians a second
    """
    if not can_press_keys():
        raise CommandError("teleop requires a terminal; use `rwt topic pub` in programs", CALLED_WRONGLY)
    topic = absolute_name(arguments.topic)
    kind = await TOPIC.known(robot, topic)
    publisher = await robot.advertise(topic, kind)
    if publisher.type.name not in _TWISTS:
        raise CommandError(f"{topic} is of {kind}; teleop publishes {' or '.join(_TWISTS)}", FAILED)
    note("hold an arrow key to drive; space stops, q and Ctrl-C quit")
    held = HeldKey()
    try:
        async with anyio.create_task_group() as tasks:
            # Handled here, so that the robot is stopped before the program ends.
            ends = STOP_SIGNALS if HANGUP is None else (*STOP_SIGNALS, HANGUP)
            with on_signals(dict.fromkeys(ends, tasks.cancel_scope.cancel)):
                tasks.start_soon(_drive, publisher, held, arguments, output)
                async with aclosing(key_presses()) as pressed:
                    async for key in pressed:
                        if key == "q":
                            break
                        held.press(key, anyio.current_time())
                tasks.cancel_scope.cancel()
    finally:
        with anyio.CancelScope(shield=True), anyio.move_on_after(_FAREWELL_SECONDS):
            await _stop(robot, publisher)


async def _drive(publisher: RemotePublisher, held: HeldKey, arguments: Arguments, output: Output) -> None:
    drives = False
    while True:
        key = held.at(anyio.current_time())
        forwards, left = _DIRECTIONS.get(key, (0.0, 0.0)) if key is not None else (0.0, 0.0)
        moves = (forwards, left) != (0.0, 0.0)
        if moves or drives:
            _publish(publisher, forwards * arguments.speed, left * arguments.turn)
            _print(forwards * arguments.speed, left * arguments.turn, output)
        drives = moves
        await anyio.sleep(1 / arguments.rate)


def _publish(publisher: RemotePublisher, speed: float, turn: float) -> None:
    twist = {"linear": {"x": speed}, "angular": {"z": turn}}
    publisher.publish({"twist": twist} if publisher.type.name == _TWISTS[1] else twist)


def _print(speed: float, turn: float, output: Output) -> None:
    if output.json:
        output.record({"linear": speed, "angular": turn})
    elif output.people:
        output.live([f"{speed:+.2f} m/s, {turn:+.2f} rad/s"])


async def _stop(robot: Robot, publisher: RemotePublisher) -> None:
    from rwt_client import ConnectionLost

    with suppress(ConnectionLost):
        _publish(publisher, 0.0, 0.0)
        await robot.drain()


_TELEOP = Verb(
    "teleop",
    _teleop,
    arguments(
        argument(
            "topic",
            metavar="TOPIC",
            nargs="?",
            default="/cmd_vel",
            help="topic of type Twist or TwistStamped (default /cmd_vel)",
        ),
        argument("--speed", type=_SPEED, default=0.3, metavar="M/S", help="linear speed (default 0.3)"),
        argument("--turn", type=_SPEED, default=1.0, metavar="RAD/S", help="angular speed (default 1)"),
        argument(
            "-r", "--rate", type=hertz, default=20.0, metavar="HZ", help="commands per second (default 20)"
        ),
    ),
)
