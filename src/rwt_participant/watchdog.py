"""A watchdog for commands: what moves must stop when nobody says any more that it should."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, Self

from rwt_participant.messages import is_coroutine_function


class _Timer(Protocol):
    def reset(self) -> None: ...

    def cancel(self) -> None: ...


class HasTimers(Protocol):
    """A robot that makes timers: :class:`~rwt_participant.api.RobotApi`, or one whose verbs wait."""

    def create_timer(self, period: float, callback: Callable[[], None], /) -> _Timer:
        """Call `callback` every `period` seconds."""


class Watchdog:
    """Calls `stop` when no command has come for `timeout` seconds: once, until the next one has come.

    >>> def drive(twist):
    ...     watchdog.feed()
    ...     motors.publish({"data": twist.linear.x})
    >>> with Watchdog(robot, 0.5, stop) as watchdog:
    ...     robot.subscribe("/cmd_vel", drive, "geometry_msgs/Twist")
    ...     await anyio.sleep_forever()

    At the end of the `with` block `stop` is called, whatever has come: also when the program is ended by a
    signal or by an error. It cannot be where nothing runs: in a process that was killed, or while a callback
    holds the event loop. A motor controller needs a watchdog of its own for those.

    Args:
        robot: a node or a client, awaited or blocking; the seconds are those of its timers, simulated where
            the node's graph is.
        timeout: seconds from the last command, or the last :meth:`feed`, to the stop.
        stop: a plain function without arguments, called on the thread of the graph or the connection, and at
            the end of the block on the thread that leaves it. It should be quick. If it raises, that is
            logged, and it is called again `timeout` seconds later.

    Raises:
        TypeError: `stop` is no function, or a coroutine function: what waits might never come to its end.
        ValueError: `timeout` is shorter than a microsecond, or longer than some thirty years.
    """

    def __init__(self, robot: HasTimers, timeout: float, stop: Callable[[], None]) -> None:
        if not callable(stop) or is_coroutine_function(stop):
            raise TypeError(f"a watchdog's stop is a plain function, got {stop!r}")
        self._stop = stop
        self._running = False
        self._timer = robot.create_timer(timeout, self._expire)

    @property
    def running(self) -> bool:
        """Whether commands come; False before the first, and from the stop to the next."""
        return self._running

    def feed(self) -> None:
        """A command has come. To be called at the beginning of its callback."""
        self._timer.reset()
        self._running = True

    def close(self) -> None:
        """Watch no more; `stop` is not called. May be called twice."""
        self._timer.cancel()
        self._running = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        try:
            self.close()
        finally:
            self._stop()

    def _expire(self) -> None:
        if self._running:
            self._stop()
            self._running = False
