"""Robots for tests: scripted ones, what they received, and faults on the way. No test framework is needed."""

from rwt_testing.errors import BlockingWait, ScriptError
from rwt_testing.faults import Fault, Faults
from rwt_testing.journal import Journal, Kind, Received
from rwt_testing.matching import Matching
from rwt_testing.observed_graph import ObservedGraph
from rwt_testing.robot import ScriptedRobot
from rwt_testing.scripted_action import ScriptedAction
from rwt_testing.scripted_service import Case, ScriptedService
from rwt_testing.scripted_topic import ScriptedTopic
from rwt_testing.transcript import Transcript
from rwt_testing.wire import ObservedWire

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
