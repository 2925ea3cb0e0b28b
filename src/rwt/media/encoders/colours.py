"""How the colours of videos are coded (ITU-T H.273): players would guess, and show green too dark."""

from typing import Final

MATRIX: Final = 6
"""BT.601, by which the images are converted."""
RANGE: Final = 1
"""Broadcast range: black is 16 and white 235."""
TRANSFER: Final = 13
"""sRGB."""
PRIMARIES: Final = 1
"""BT.709, which are those of sRGB."""
