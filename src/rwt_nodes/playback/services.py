"""The services with which a player is controlled: those of rosbag2's player, by its names and types."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from rwt_graph.clock import NANOSECONDS
from rwt_interfaces import Payload, PayloadError

if TYPE_CHECKING:
    from rwt_graph.api import Graph, ServiceCall

Answer = dict[str, object]


class Controlled(Protocol):
    """What the services control; see :class:`rwt_nodes.playback.player.Player`."""

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        ...

    @property
    def rate(self) -> float:
        """Recorded seconds in a second."""
        ...

    def resume(self) -> None:
        """Go on."""

    def pause(self) -> None:
        """Stand still."""

    def toggle_paused(self) -> None:
        """Pause or resume."""

    def set_rate(self, rate: float) -> None:
        """Play faster or slower."""

    def play_next(self) -> bool:
        """Publish one message."""
        ...

    def burst(self, count: int) -> int:
        """Publish some messages."""
        ...

    def seek(self, time_ns: int) -> bool:
        """Go on at a time."""
        ...


class PlayerServices:
    """Offers `/rosbag2_player/pause` and the others until it is closed."""

    def __init__(self, graph: Graph, player: Controlled, node: str) -> None:
        self._player = player
        self._participant = graph.participant(node)
        self._seconds, self._nanoseconds = graph.distro.time_fields
        handlers: dict[tuple[str, str], Callable[[object], Answer]] = {
            ("pause", "Pause"): _doing(player.pause),
            ("resume", "Resume"): _doing(player.resume),
            ("toggle_paused", "TogglePaused"): _doing(player.toggle_paused),
            ("is_paused", "IsPaused"): lambda _: {"paused": player.paused},
            ("get_rate", "GetRate"): lambda _: {"rate": player.rate},
            ("set_rate", "SetRate"): self._set_rate,
            ("play_next", "PlayNext"): lambda _: {"success": player.play_next()},
            ("burst", "Burst"): lambda asked: {"actually_burst": player.burst(asked.num_messages)},  # type: ignore[attr-defined]  # a request of that type
            ("seek", "Seek"): self._seek,
        }
        for (name, kind), handler in handlers.items():
            self._offer(graph, f"{node}/{name}", f"rosbag2_interfaces/{kind}", handler)

    def _offer(self, graph: Graph, name: str, kind: str, handler: Callable[[object], Answer]) -> None:
        interface = graph.registry.service(kind)

        def on_call(call: ServiceCall) -> None:
            try:
                request = call.request.value()
            except PayloadError as error:
                call.fail(str(error))
                return
            call.reply(Payload.from_value(interface.response, handler(request)))

        self._participant.advertise_service(name, interface, on_call)

    def _set_rate(self, asked: object) -> Answer:
        try:
            self._player.set_rate(asked.rate)  # type: ignore[attr-defined]  # a request of that type
        except ValueError:
            return {"success": False}
        return {"success": True}

    def _seek(self, asked: object) -> Answer:
        time = asked.time  # type: ignore[attr-defined]  # a request of that type
        seconds, nanoseconds = getattr(time, self._seconds), getattr(time, self._nanoseconds)
        return {"success": self._player.seek(seconds * NANOSECONDS + nanoseconds)}

    def close(self) -> None:
        """Withdraw the services."""
        self._participant.close()


def _doing(action: Callable[[], None]) -> Callable[[object], Answer]:
    """A handler of what neither asks nor answers anything."""

    def handle(_: object) -> Answer:
        action()
        return {}

    return handle


__all__ = ["Controlled", "PlayerServices"]
