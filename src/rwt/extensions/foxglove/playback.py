"""Control of a playback in Foxglove's protocol, through the services of the player's node."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from rwt.access.client_graph import ClientGraph
from rwt.access.errors import AccessError
from rwt.extensions.foxglove.replies import FoxgloveReplies
from rwt.extensions.foxglove.wire.client_messages import PlaybackControlRequest
from rwt.extensions.foxglove.wire.server_messages import Level, PlaybackStatus, playback_state
from rwt_graph.clock import Playback
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, RobotError
from rwt_protocol.frames import Frame

_SAME_SPEED: Final = 1e-6
"""Two speeds this close are the same: the protocol has 32 bits for one."""


PlaybackState = tuple[PlaybackStatus, float, int]
"""State of a playback without its position: status, recorded seconds per second, and number of seeks."""


def state_of(playback: Playback) -> PlaybackState:
    """Return the current state of a playback."""
    status = PlaybackStatus.PLAYING
    if playback.paused:
        at_end = playback.position_ns >= playback.end_ns
        status = PlaybackStatus.ENDED if at_end else PlaybackStatus.PAUSED
    return status, playback.rate, playback.seeks


def state_frame(playback: Playback, *, did_seek: bool, request_id: bytes = b"") -> Frame:
    """Return the frame with the current state of a playback."""
    status, speed, _ = state_of(playback)
    return playback_state(status, playback.position_ns, speed, did_seek=did_seek, request_id=request_id)


class PlaybackControl:
    """Playback control by one client."""

    def __init__(self, graph: ClientGraph, replies: FoxgloveReplies, playback: Playback) -> None:
        self._graph = graph
        self._replies = replies
        self._playback = playback

    def request(self, asked: PlaybackControlRequest) -> None:
        """Execute a client's request, and send it the resulting state."""
        seeks = self._playback.seeks
        # A generator: the player's state is read again after each call, which may have changed it.
        steps = self._calls(asked)

        def go_on() -> None:
            for service, request in steps:
                self._call(service, request, finished)
                return
            did_seek = self._playback.seeks != seeks
            self._replies.send(state_frame(self._playback, did_seek=did_seek, request_id=asked.request_id))

        def finished(failure: str) -> None:
            if failure:
                self._replies.say(Level.ERROR, f"playback: {failure}")
            go_on()

        go_on()

    def _calls(self, asked: PlaybackControlRequest) -> Iterator[tuple[str, Mapping[str, object]]]:
        playback = self._playback
        # A pause comes first and a resumption last: nothing is published at the old position or speed.
        if not asked.plays and not playback.paused:
            yield "pause", {}
        if asked.seek_ns is not None:
            within = min(max(asked.seek_ns, playback.start_ns), playback.end_ns)
            yield "seek", {"time": self._graph.distro.time(within)}
        # NaN is not close to any speed, so it reaches the player like any other new value.
        if not abs(asked.speed - playback.rate) <= _SAME_SPEED * playback.rate:
            yield "set_rate", {"rate": asked.speed}
        if asked.plays and playback.paused:
            yield "resume", {}

    def _call(self, service: str, request: Mapping[str, object], finished: Callable[[str], None]) -> None:
        def on_reply(outcome: Payload | CallFailed) -> None:
            if isinstance(outcome, CallFailed):
                finished(str(outcome))
            else:
                done = getattr(outcome.value(), "success", True)
                finished("" if done else f"{service} {request}: the player refuses that")

        try:
            self._graph.call_service(
                f"{self._playback.node}/{service}", lambda type: Payload.from_value(type, request), on_reply
            )
        except (RobotError, AccessError) as error:
            finished(str(error))
