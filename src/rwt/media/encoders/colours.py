"""Colour description of videos (ITU-T H.273): without it players guess, and show green too dark."""

from typing import Final

MATRIX: Final = 6
"""BT.601, which the conversion uses."""
RANGE: Final = 1
"""Broadcast range: black is 16 and white 235."""
TRANSFER: Final = 13
"""sRGB."""
PRIMARIES: Final = 1
"""BT.709, the primaries of sRGB."""
