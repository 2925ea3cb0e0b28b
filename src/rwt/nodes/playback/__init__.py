"""Playback of recordings into a graph, as a robot."""

from rwt.nodes.playback.clock import PlaybackClock
from rwt.nodes.playback.player import Player, PlayOptions

__all__ = ["Player", "PlayOptions", "PlaybackClock"]
