"""Detection of commands that waited in a stalled connection, and drive the robot when it recovers."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto
from math import inf
from typing import TYPE_CHECKING, Final

from rwt_interfaces.times import NANOSECONDS

if TYPE_CHECKING:
    import msgspec

    from rwt.access.gate.record import Actor
    from rwt_graph.clock import Clock

#: Maximum number of clients per topic; beyond it, the one that has been silent for longest is forgotten.
_MAX_CLIENTS: Final = 64

#: Commands without a gap that make a stream. A client that sends fewer at a time holds no control.
_STREAM: Final = 3

#: Commands that arrive in a fraction of their usual time before they count as queued.
_BURST: Final = 3

#: Commands at their usual pace, after a pause, that prove that a stalled client does not send queued ones.
_PROBES: Final = 4

#: Pace of a client whose own is unknown, in seconds. Faster ones arrive together without being queued.
_LEAST_PACE: Final = 0.02

#: Allowed drift between the clocks of a client and of the server, in seconds per second.
_DRIFT: Final = 1e-4


class _State(Enum):
    RELEASED = auto()
    DRIVING = auto()
    STALLED = auto()
    PROBING = auto()


class _Delay:
    """Delay of one client's commands, relative to the fastest one.

    The absolute delay is unknown, because the clocks of the client and the server may differ.
    """

    __slots__ = ("_at", "_least")

    def __init__(self) -> None:
        self._least = inf
        self._at = 0.0

    def of(self, difference: float, now: float) -> float:
        """Return the delay of a command that arrived so many seconds after its stamp."""
        self._least = min(difference, self._least + (now - self._at) * _DRIFT)
        self._at = now
        return difference - self._least


@dataclass(slots=True)
class _CommandStream:
    """Commands of one client.

    Attributes:
        state: see :class:`Freshness`.
        at: arrival of the last command.
        since: arrival of the first command after the last gap.
        count: commands since then.
        had_gap: True after the first gap. The first commands of a client were not queued during one.
        pace: usual interval between two commands, in seconds; 0 until it is known.
        was_stop: True if the last command was the stop message.
        sends_stop: True once the client has sent the stop message. It says so when it lets go, so that its
            pauses are gaps: those of a slow page, or of a link that stalls again.
        delays: delays in real time and in ROS time. A simulation's clock may run at another speed.
    """

    at: float
    since: float
    state: _State = _State.RELEASED
    count: int = 0
    had_gap: bool = False
    pace: float = 0.0
    was_stop: bool = True
    sends_stop: bool = False
    delays: tuple[_Delay, _Delay] = field(default_factory=lambda: (_Delay(), _Delay()))


class Freshness:
    """Freshness of the commands on one topic.

    States of a client::

        released ──command──> driving ──gap while streaming, burst, or late stamp──> stalled
           ^                     │                                                    │  ^
           └────stop message─────┘       the stop message, then a command <───────────┤  │ burst
                                                 (driving)                            │  │
                                         4 commands at the usual pace <── probing <───┘──┘
                                                 (driving)          pause, of a client that
                                                                     never sent the stop message

    A *gap* is longer than the dead-man timeout. A client that was streaming commands and had not sent the
    stop message did not release its control: what follows a gap was queued, or is meant for a robot whose
    state its user could not see. A *burst* is the delivery of queued commands: several in a quarter of the
    time that they usually take.

    Commands of a stalled client are rejected until it sends the stop message and, not together with it, a
    command. If it never sent that message before, it may pause for longer than the timeout instead.

    Attributes:
        seconds: dead-man timeout.
        max_age: largest age of a command by its stamp, in seconds of the graph's clock.
    """

    __slots__ = ("_streams", "max_age", "seconds")

    def __init__(self, seconds: float, max_age: float = inf) -> None:
        self.seconds = seconds
        self.max_age = max_age
        self._streams: dict[Actor, _CommandStream] = {}

    def check(
        self, client: Actor, command: msgspec.Struct | None, now: float, clock: Clock, *, is_stop: bool
    ) -> str:
        """Return why a command must not move the robot; empty if it may.

        Args:
            command: value of the message; None for a large one, which is not decoded: its stamp is ignored.
            now: monotonic time.
            is_stop: True for the stop message.
        """
        stream = self._streams.get(client)
        if stream is None:
            stream = self._add(client, now)
        gap = now - stream.at
        was_stop, stream.was_stop = stream.was_stop, is_stop
        streamed = stream.count >= _STREAM
        stream.at = now
        if gap > self.seconds:
            stream.since, stream.count, stream.had_gap = now, 0, True
        elif streamed and stream.state is _State.DRIVING:
            stream.pace += ((gap - stream.pace) / 8) if stream.pace else gap
        stream.count += 1
        late, age = 0.0, 0.0
        has_header = command is not None and "header" in command.__struct_fields__
        if has_header and (stamp := _stamp_of(command)):
            times = (now, clock.time_ns() / NANOSECONDS)
            age = times[1] - stamp
            late = min(delay.of(time - stamp, now) for delay, time in zip(stream.delays, times, strict=True))
        if is_stop:
            stream.sends_stop = True
            if stream.state is _State.DRIVING:
                stream.state = _State.RELEASED
            return ""
        stream.state = self._next(stream, gap, late, streamed=streamed, was_stop=was_stop)
        if age > self.max_age:
            return (
                f"the command is {age:.3f} s old by its stamp, limit is {self.max_age:g} s (`max_age`): send"
                " newer ones, or synchronise the clocks"
            )
        if stream.state in (_State.RELEASED, _State.DRIVING):
            return ""
        or_pause = "" if stream.sends_stop else ", or pause for as long,"
        return (
            f"commands of this client waited in a stalled connection for more than {self.seconds:g} s:"
            f" send the stop message{or_pause} and begin again"
        )

    def _next(
        self, stream: _CommandStream, gap: float, late: float, *, streamed: bool, was_stop: bool
    ) -> _State:
        """Return the state after a command that moves the robot."""
        if late > self.seconds:
            return _State.STALLED
        taken = stream.at - stream.since
        is_burst = (
            stream.had_gap
            and stream.count >= _BURST
            and not 0 < stream.pace < _LEAST_PACE
            and taken < (stream.count - 1) * max(stream.pace, _LEAST_PACE) / 4
        )
        state = stream.state
        if state in (_State.RELEASED, _State.DRIVING):
            is_gap = state is _State.DRIVING and gap > self.seconds and streamed
            return _State.STALLED if is_gap or is_burst else _State.DRIVING
        if was_stop and gap > max(stream.pace, _LEAST_PACE) / 2:
            stream.since, stream.count = stream.at, 1  # The burst before does not count.
            return _State.DRIVING
        if state is _State.PROBING and not is_burst:
            return _State.DRIVING if stream.count >= _PROBES else state
        return _State.PROBING if gap > self.seconds and not stream.sends_stop else _State.STALLED

    def _add(self, client: Actor, now: float) -> _CommandStream:
        if len(self._streams) >= _MAX_CLIENTS:
            del self._streams[min(self._streams, key=lambda each: self._streams[each].at)]
        stream = self._streams[client] = _CommandStream(now, now)
        return stream


def _stamp_of(message: msgspec.Struct | None) -> float:
    """Return the time in a message's header in seconds; 0 if it has no stamp."""
    stamp: msgspec.Struct | None = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return 0.0
    seconds, nanoseconds = (getattr(stamp, name) for name in stamp.__struct_fields__)
    return float(seconds + nanoseconds / NANOSECONDS)
