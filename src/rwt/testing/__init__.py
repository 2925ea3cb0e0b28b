"""Test robots: scripted robots, a journal of what they received, and faults on the wire.

Names are imported on first use, because pytest imports this package at the start of every run.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.testing.errors import BlockingWait, ScriptError
    from rwt.testing.journal import Journal, Kind, Received
    from rwt.testing.matching import Matching
    from rwt.testing.observed_graph import ObservedGraph
    from rwt.testing.scripted.action import ScriptedAction
    from rwt.testing.scripted.robot import ScriptedRobot
    from rwt.testing.scripted.service import Case, ScriptedService
    from rwt.testing.scripted.topic import ScriptedTopic
    from rwt.testing.wire.faults import Fault, Faults
    from rwt.testing.wire.observed import ObservedWire
    from rwt.testing.wire.transcript import Transcript

_HOMES: Final = {
    name: home
    for home, names in {
        "rwt.testing.errors": "BlockingWait ScriptError",
        "rwt.testing.journal": "Journal Kind Received",
        "rwt.testing.matching": "Matching",
        "rwt.testing.observed_graph": "ObservedGraph",
        "rwt.testing.scripted.action": "ScriptedAction",
        "rwt.testing.scripted.robot": "ScriptedRobot",
        "rwt.testing.scripted.service": "Case ScriptedService",
        "rwt.testing.scripted.topic": "ScriptedTopic",
        "rwt.testing.wire.faults": "Fault Faults",
        "rwt.testing.wire.observed": "ObservedWire",
        "rwt.testing.wire.transcript": "Transcript",
    }.items()
    for name in names.split()
}

__all__ = [
    "ScriptedRobot",
    "ScriptedTopic",
    "ScriptedService",
    "Case",
    "ScriptedAction",
    "Matching",
    "Journal",
    "Kind",
    "Received",
    "ObservedGraph",
    "ObservedWire",
    "Transcript",
    "Faults",
    "Fault",
    "ScriptError",
    "BlockingWait",
]


def __getattr__(name: str) -> object:
    """Import a name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
