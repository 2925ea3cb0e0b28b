"""Playback of recordings into a graph, as a robot."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.recording.playback.clock import PlaybackClock as PlaybackClock
    from rwt.extensions.recording.playback.player import Player as Player
    from rwt.extensions.recording.playback.player import PlayOptions as PlayOptions
    from rwt.extensions.recording.playback.server import PlaybackServer as PlaybackServer

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.recording.playback.player": "Player PlayOptions",
        "rwt.extensions.recording.playback.clock": "PlaybackClock",
        "rwt.extensions.recording.playback.server": "PlaybackServer",
    },
)
