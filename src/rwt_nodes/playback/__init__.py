"""Plays recordings into a graph, as a robot."""

from rwt_nodes.playback.clock import PlaybackClock
from rwt_nodes.playback.player import Player, PlayOptions

__all__ = ["Player", "PlayOptions", "PlaybackClock"]
