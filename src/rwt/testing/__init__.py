"""Test robots: scripted robots, a journal of what they received, and faults on the wire.

Names are imported on first use, because pytest imports this package at the start of every run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.testing.errors import BlockingWait as BlockingWait
    from rwt.testing.errors import ScriptError as ScriptError
    from rwt.testing.journal import Journal as Journal
    from rwt.testing.journal import Kind as Kind
    from rwt.testing.journal import ObservedGraph as ObservedGraph
    from rwt.testing.journal import Received as Received
    from rwt.testing.matching import Matching as Matching
    from rwt.testing.scripted.action import ScriptedAction as ScriptedAction
    from rwt.testing.scripted.robot import ScriptedRobot as ScriptedRobot
    from rwt.testing.scripted.service import Case as Case
    from rwt.testing.scripted.service import ScriptedService as ScriptedService
    from rwt.testing.scripted.topic import ScriptedTopic as ScriptedTopic
    from rwt.testing.wire.faults import Fault as Fault
    from rwt.testing.wire.faults import Faults as Faults
    from rwt.testing.wire.observed import ObservedWire as ObservedWire
    from rwt.testing.wire.transcript import Transcript as Transcript

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.testing.scripted.robot": "ScriptedRobot",
        "rwt.testing.scripted.topic": "ScriptedTopic",
        "rwt.testing.scripted.service": "ScriptedService Case",
        "rwt.testing.scripted.action": "ScriptedAction",
        "rwt.testing.matching": "Matching",
        "rwt.testing.journal": "Journal Kind Received ObservedGraph",
        "rwt.testing.wire.observed": "ObservedWire",
        "rwt.testing.wire.transcript": "Transcript",
        "rwt.testing.wire.faults": "Faults Fault",
        "rwt.testing.errors": "ScriptError BlockingWait",
    },
)
