"""Playback of recordings into a graph, as a robot."""

from rwt.extensions.recording.playback.clock import PlaybackClock
from rwt.extensions.recording.playback.player import Player, PlayOptions

__all__ = ["Player", "PlayOptions", "PlaybackClock"]
