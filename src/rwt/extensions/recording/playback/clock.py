"""Clock of a graph that plays a recording, and the topic `/clock`."""

from __future__ import annotations

from collections.abc import Callable

from rwt_graph.api import Graph, Participant
from rwt_graph.clock import Playback, SimulatedClock, SteadyClock
from rwt_interfaces import Payload
from rwt_participant.timers import Timer


class PlaybackClock(SteadyClock):
    """Clock whose ROS time is that of a recording; steady time and timers are real.

    Pass it to the graph, and the graph to a
    :class:`~rwt.extensions.recording.playback.player.Player`, which sets its time: messages are published
    with their recorded stamps, and clients see the time of the recording.

    Args:
        start_ns: time before a player plays, in nanoseconds since the epoch.
    """

    is_real = False

    def __init__(self, start_ns: int = 0) -> None:
        super().__init__()
        self.playback: Playback | None = None
        self._position: Callable[[], int] = lambda: start_ns
        self._held: int | None = None

    def follow(self, playback: Playback, position: Callable[[], int]) -> None:
        """Take ROS time from `position`, the one of `playback`, from now on."""
        self.playback = playback
        self._position = position

    def hold(self, time_ns: int | None) -> None:
        """Hold the clock at a time while a message is published; None to continue."""
        self._held = time_ns

    def time_ns(self) -> int:
        """Return the time of the recording, in nanoseconds since the epoch."""
        return self._position() if self._held is None else self._held


CLOCK = "/clock"


class ClockTopic:
    """Publisher of `rosgraph_msgs/Clock` in real time; with simulated time the graph itself publishes it."""

    def __init__(self, graph: Graph, participant: Participant, hertz: float) -> None:
        self._clock = graph.clock
        self._period = 1.0 / hertz
        self._distro = graph.distro
        self._timer: Timer | None = None
        if not isinstance(graph.clock, SimulatedClock):
            self._publisher = participant.advertise(CLOCK, graph.registry.message("rosgraph_msgs/Clock"))
            self._timer = self._clock.call_later(0.0, self._tick)

    def _tick(self) -> None:
        value = {"clock": self._distro.time(self._clock.time_ns())}
        self._publisher.publish(Payload.from_value(self._publisher.type, value))
        self._timer = self._clock.call_later(self._period, self._tick)

    def close(self) -> None:
        """Stop publishing."""
        if self._timer is not None:
            self._timer.cancel()
