"""Robots for tests: scripted robots, a journal of what they received, and faults on the wire."""

from rwt_testing.errors import BlockingWait, ScriptError
from rwt_testing.journal import Journal, Kind, Received
from rwt_testing.matching import Matching
from rwt_testing.observed_graph import ObservedGraph
from rwt_testing.scripted.action import ScriptedAction
from rwt_testing.scripted.robot import ScriptedRobot
from rwt_testing.scripted.service import Case, ScriptedService
from rwt_testing.scripted.topic import ScriptedTopic
from rwt_testing.wire.faults import Fault, Faults
from rwt_testing.wire.observed import ObservedWire
from rwt_testing.wire.transcript import Transcript

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
