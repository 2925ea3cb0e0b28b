"""Services that control a player, with the names and types of the rosbag2 player."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, Protocol

from rwt_interfaces import InvalidMessage, Payload

if TYPE_CHECKING:
    from rwt_graph.api import Graph, ServiceCall

Answer = dict[str, object]

BURST_TURN: Final = 200
"""Messages of a burst that are published in one turn of the event loop: others get theirs in between."""


class Controlled(Protocol):
    """Controls of a player; see :class:`rwt.nodes.playback.player.Player`."""

    @property
    def paused(self) -> bool:
        """True while playback is paused."""
        ...

    @property
    def rate(self) -> float:
        """Recorded seconds per second."""
        ...

    def resume(self) -> None:
        """Resume playback."""

    def pause(self) -> None:
        """Pause playback."""

    def toggle_paused(self) -> None:
        """Pause or resume."""

    def set_rate(self, rate: float) -> None:
        """Change the rate."""

    def play_next(self) -> bool:
        """Publish one message."""
        ...

    def steps(self, count: int) -> Iterator[None]:
        """Publish some messages, one for each turn of the iterator."""
        ...

    def seek(self, time_ns: int) -> bool:
        """Jump to a time."""
        ...


_Answering = Callable[[object, Callable[[Answer], None]], None]
"""Answers a request, now or later."""


class PlayerServices:
    """Server of `/rosbag2_player/pause` and the other services."""

    def __init__(self, graph: Graph, player: Controlled, node: str) -> None:
        self._player = player
        self._clock = graph.clock
        self._participant = graph.participant(node)
        self._distro = graph.distro
        handlers: dict[tuple[str, str], Callable[[object], Answer]] = {
            ("pause", "Pause"): _doing(player.pause),
            ("resume", "Resume"): _doing(player.resume),
            ("toggle_paused", "TogglePaused"): _doing(player.toggle_paused),
            ("is_paused", "IsPaused"): lambda _: {"paused": player.paused},
            ("get_rate", "GetRate"): lambda _: {"rate": player.rate},
            ("set_rate", "SetRate"): self._set_rate,
            ("play_next", "PlayNext"): lambda _: {"success": player.play_next()},
            ("seek", "Seek"): self._seek,
        }
        for (name, kind), handler in handlers.items():
            self._offer(graph, f"{node}/{name}", kind, partial(_answer_at_once, handler))
        self._offer(graph, f"{node}/burst", "Burst", self._burst)

    def _offer(self, graph: Graph, name: str, kind: str, answer: _Answering) -> None:
        interface = graph.registry.service(f"rosbag2_interfaces/{kind}")

        def on_call(call: ServiceCall) -> None:
            try:
                request = call.request.value()
            except InvalidMessage as error:
                call.fail(str(error))
                return
            answer(request, lambda said: call.reply(Payload.from_value(interface.response, said)))

        self._participant.advertise_service(name, interface, on_call)

    def _burst(self, asked: Any, reply: Callable[[Answer], None]) -> None:
        """Publish in several turns of the event loop: a burst may be a whole long recording."""
        steps = self._player.steps(asked.num_messages)

        def turn(done: int) -> None:
            taken = sum(1 for _ in islice(steps, BURST_TURN))
            if taken == BURST_TURN:
                self._clock.call_later(0.0, partial(turn, done + taken))
            else:
                reply({"actually_burst": done + taken})

        turn(0)

    def _set_rate(self, asked: Any) -> Answer:
        try:
            self._player.set_rate(asked.rate)
        except ValueError:
            return {"success": False}
        return {"success": True}

    def _seek(self, asked: Any) -> Answer:
        return {"success": self._player.seek(self._distro.time_ns(asked.time))}

    def close(self) -> None:
        """Withdraw the services."""
        self._participant.close()


def _answer_at_once(
    handler: Callable[[object], Answer], request: object, reply: Callable[[Answer], None]
) -> None:
    reply(handler(request))


def _doing(action: Callable[[], None]) -> Callable[[object], Answer]:
    """Return a handler for an empty request and response."""

    def handle(_: object) -> Answer:
        action()
        return {}

    return handle
