"""The clock of a graph that plays a recording."""

from __future__ import annotations

from collections.abc import Callable

from rwt_graph.clock import SteadyClock


class PlaybackClock(SteadyClock):
    """ROS time is that of a recording; steady time and timers are real.

    Give it to the graph, and the graph to a :class:`~rwt_nodes.playback.player.Player`, which tells it the
    time: messages are published with the very stamps that they were recorded with, and who asks the robot for
    the time hears the recording's.

    Args:
        start_ns: the time before a player plays, nanoseconds since the epoch.
    """

    def __init__(self, start_ns: int = 0) -> None:
        super().__init__()
        self._position: Callable[[], int] = lambda: start_ns
        self._held: int | None = None

    def follow(self, position: Callable[[], int]) -> None:
        """Take ROS time from `position` from now on."""
        self._position = position

    def hold(self, time_ns: int | None) -> None:
        """Stand at a time while a message is published; None lets it go on."""
        self._held = time_ns

    def time_ns(self) -> int:
        """The recording's time, nanoseconds since the epoch."""
        held = self._held
        return self._position() if held is None else held


__all__ = ["PlaybackClock"]
