"""Server that plays a recording as its robot."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Self

from rwt.access.settings import SettingsError
from rwt.extensions.recording import Recording
from rwt.extensions.recording.playback.clock import PlaybackClock
from rwt.extensions.recording.playback.player import Player, PlayOptions
from rwt.server import Server
from rwt.settings.models import Settings
from rwt_graph.api import Graph
from rwt_graph.errors import NotRunning
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.registry import Registry


class PlaybackServer(Server):
    """Plays the messages of a recording at their times, on a clock that shows the recording's time.

    Args:
        recording: open recording (:func:`rwt.extensions.recording.open_recording`); must stay open.
        urls: URLs to listen on, as for :class:`Server`.
        options: options of the player. It starts when clients can connect, unless it is `paused`.
        stay: True to keep serving at the end, with the retained messages; otherwise :meth:`ended` returns
            then.
        settings: as for :class:`Server`, with the distribution of the recording.

    Raises:
        SettingsError: a setting or an option is invalid, or contradicts the recording.
    """

    def __init__(
        self,
        recording: Recording,
        *urls: str,
        options: PlayOptions | None = None,
        stay: bool = False,
        settings: Settings | None = None,
    ) -> None:
        graph = MemoryGraph(Registry(recording.distro), PlaybackClock(recording.start_ns))
        super().__init__(*urls, settings=settings, graph=graph, extra_nodes=(self._make_player,))
        self._recording = recording
        self._options = options or PlayOptions()
        self._stay = stay
        self._player: Player | None = None

    @property
    def player(self) -> Player:
        """Player of the recording. Raises :exc:`NotRunning` until the server is entered."""
        if self._player is None:
            raise NotRunning("no player yet: enter the server with `async with server:` or `with server:`")
        return self._player

    def _make_player(self, graph: Graph) -> Player:
        try:
            self._player = Player(graph, self._recording, replace(self._options, paused=True))
        except ValueError as error:
            raise SettingsError(f"options: {error}") from error
        return self._player

    def _ends(self) -> list[Callable[[], Awaitable[object]]]:
        return [*super()._ends(), *([] if self._stay else [self.player.finished.wait])]

    async def __aenter__(self) -> Self:
        await super().__aenter__()
        if not self._options.paused:
            self.player.resume()
        return self
