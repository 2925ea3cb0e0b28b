"""Test robots: scripted robots, a journal of what they received, and faults on the wire.

Names are imported on first use, because pytest imports this package at the start of every run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.testing.errors import BlockingWait as BlockingWait
    from rwt.extensions.testing.errors import ScriptError as ScriptError
    from rwt.extensions.testing.journal import Journal as Journal
    from rwt.extensions.testing.journal import Kind as Kind
    from rwt.extensions.testing.journal import ObservedGraph as ObservedGraph
    from rwt.extensions.testing.journal import Received as Received
    from rwt.extensions.testing.matching import Matching as Matching
    from rwt.extensions.testing.scripted.action import ScriptedAction as ScriptedAction
    from rwt.extensions.testing.scripted.robot import ScriptedRobot as ScriptedRobot
    from rwt.extensions.testing.scripted.service import Case as Case
    from rwt.extensions.testing.scripted.service import ScriptedService as ScriptedService
    from rwt.extensions.testing.scripted.topic import ScriptedTopic as ScriptedTopic
    from rwt.extensions.testing.wire.faults import Fault as Fault
    from rwt.extensions.testing.wire.faults import Faults as Faults
    from rwt.extensions.testing.wire.observed import ObservedWire as ObservedWire
    from rwt.extensions.testing.wire.transcript import Transcript as Transcript

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.testing.scripted.robot": "ScriptedRobot",
        "rwt.extensions.testing.scripted.topic": "ScriptedTopic",
        "rwt.extensions.testing.scripted.service": "ScriptedService Case",
        "rwt.extensions.testing.scripted.action": "ScriptedAction",
        "rwt.extensions.testing.matching": "Matching",
        "rwt.extensions.testing.journal": "Journal Kind Received ObservedGraph",
        "rwt.extensions.testing.wire.observed": "ObservedWire",
        "rwt.extensions.testing.wire.transcript": "Transcript",
        "rwt.extensions.testing.wire.faults": "Faults Fault",
        "rwt.extensions.testing.errors": "ScriptError BlockingWait",
    },
)
