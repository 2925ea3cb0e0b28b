"""Robot from a file, with services by which a test resets it and reads what it received."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from rwt.extensions.testing.errors import ScriptError
from rwt.extensions.testing.journal import OF_THE_SERVER, Kind, ObservedGraph, Received
from rwt.extensions.testing.script.file import FaultScript, read_script
from rwt.extensions.testing.script.program import ProgramRobot, read_program
from rwt.extensions.testing.script.robot import SteppedTopic, TomlRobot, inject
from rwt.extensions.testing.scripted.robot import ScriptedRobot
from rwt.extensions.testing.wire.observed import ObservedWire
from rwt_graph.nodes.node import Node
from rwt_participant.handles import Handle
from rwt_participant.messages import Message, MessageLike, ParameterValue

#: Node of the control services, and prefix of their names.
CONTROL = "/rwt_script"

#: Node under which all clients publish; calls and goals have no node.
_CLIENTS = ("/rosbridge_websocket", "")


class ScriptControl:
    """Plays a file on a graph, and offers the services `/rwt_script/…`.

    Each is a `std_srvs/Trigger` unless noted:

    - `reset`: restart the robot and clear what was received;
    - `received`: everything that clients have sent, as JSON in `message`;
    - `next/TOPIC`: publish the next of the topic's `messages`, if it has no `rate`;
    - `disconnect`: disconnect every client, including the caller;
    - `faults` (`std_srvs/SetBool`): enable or disable the faults of the file.

    Args:
        file: `.toml` or `.py` file.

    Raises:
        ScriptError: the file cannot be played.
    """

    def __init__(self, graph: ObservedGraph, wire: ObservedWire, file: Path) -> None:
        self._graph = graph
        self._wire = wire
        self._file = file
        self._faults_of_file: list[FaultScript] = []
        self._step_services: list[Handle] = []
        self._make = self._maker()
        self._robot = self._make()
        graph.unobserved.add(CONTROL)
        self._node = Node(graph, CONTROL)
        self._offer("reset", self._reset)
        self._offer("received", self._received)
        self._offer("disconnect", lambda: (True, f"{wire.faults.disconnect()} clients are disconnected"))
        self._node.advertise_service(f"{CONTROL}/faults", "std_srvs/SetBool", self._switch_faults)
        self._begin()

    @property
    def node(self) -> ScriptedRobot:
        """Current robot; `reset` replaces it."""
        return self._robot.node

    def close(self) -> None:
        """Leave the graph."""
        self._robot.close()
        self._node.close()

    def _maker(self) -> Callable[[], TomlRobot | ProgramRobot]:
        if self._file.suffix == ".py":
            function = read_program(self._file)
            return lambda: ProgramRobot(self._graph, function, self._file)
        if self._file.suffix != ".toml":
            raise ScriptError(f"{self._file}: expected a script whose name ends in .toml or .py")
        script = read_script(self._file)
        self._faults_of_file = script.faults
        return lambda: TomlRobot(self._graph, script, self._file)

    def _offer(self, name: str, act: Callable[[], tuple[bool, str]]) -> Handle:
        def handle(request: Message) -> MessageLike:
            success, message = act()
            return {"success": success, "message": message}

        return self._node.advertise_service(f"{CONTROL}/{name}", "std_srvs/Trigger", handle)

    def _begin(self) -> None:
        inject(self._wire.faults, self._faults_of_file)
        for service in self._step_services:
            service.close()
        stepped = self._robot.stepped if isinstance(self._robot, TomlRobot) else ()
        self._step_services = [self._offer_next(topic) for topic in stepped]

    def _offer_next(self, topic: SteppedTopic) -> Handle:
        def step() -> tuple[bool, str]:
            if topic.step():
                return True, f"{topic.name}: message {topic.done} of {len(topic.messages)}"
            return False, f"{topic.name}: all {topic.done} messages were published; call {CONTROL}/reset"

        return self._offer(f"next{topic.name}", step)

    def _reset(self) -> tuple[bool, str]:
        self._robot.close()
        self._wire.faults.clear()
        self._graph.journal.clear()
        try:
            self._robot = self._make()
        except ScriptError as error:
            return False, str(error)
        self._begin()
        return True, "the robot starts again"

    def _switch_faults(self, request: Message) -> MessageLike:
        self._wire.faults.clear()
        if request.data:
            inject(self._wire.faults, self._faults_of_file)
        return {"success": True, "message": f"{len(self._faults_of_file) if request.data else 0} faults"}

    def _received(self) -> tuple[bool, str]:
        journal = self._graph.journal
        received = {
            "published": _by_name(journal.everything(Kind.MESSAGE)),
            "called": _by_name(journal.everything(Kind.CALL)),
            "goals": _by_name(journal.everything(Kind.GOAL)),
            "clients": self._wire.client_count,
        }
        return True, json.dumps(received, ensure_ascii=False)


def _by_name(entries: Mapping[str, tuple[Received, ...]]) -> dict[str, list[ParameterValue]]:
    chosen = {
        name: [json.loads(entry.json) for entry in kept if entry.node in _CLIENTS]
        for name, kept in entries.items()
        if name not in OF_THE_SERVER
    }
    return {name: messages for name, messages in chosen.items() if messages}
