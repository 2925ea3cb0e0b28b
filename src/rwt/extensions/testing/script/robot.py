"""Scripted robot from a script in TOML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rwt.extensions.testing.errors import ScriptError
from rwt.extensions.testing.journal import ObservedGraph
from rwt.extensions.testing.script.file import (
    ActionScript,
    AnswerScript,
    FaultScript,
    Fields,
    Script,
    ServiceScript,
    TopicScript,
    dotted,
    read_recorded,
)
from rwt.extensions.testing.scripted.robot import ScriptedRobot
from rwt.extensions.testing.scripted.service import Case, ScriptedService
from rwt.extensions.testing.scripted.topic import ScriptedTopic
from rwt.extensions.testing.wire.faults import Faults, Scope
from rwt_participant.errors import RobotError


class SteppedTopic:
    """Topic whose messages are published one at a time, by :meth:`step`."""

    def __init__(self, topic: ScriptedTopic, messages: list[Fields]) -> None:
        self.name = topic.name
        self.messages = messages
        self.done = 0
        self._topic = topic

    def step(self) -> bool:
        """Publish the next message. Returns False if there is none left."""
        if self.done >= len(self.messages):
            return False
        self.done += 1
        self._topic.publish(self.messages[self.done - 1])
        return True


class TomlRobot:
    """Robot driven by a script in TOML.

    Args:
        file: file of the script, for relative paths and error texts.

    Attributes:
        stepped: topics that are published step by step.

    Raises:
        ScriptError: a type is unknown, a name is not allowed, or a message does not fit its type.
    """

    def __init__(self, graph: ObservedGraph, script: Script, file: Path) -> None:
        self._file = file
        self.stepped: list[SteppedTopic] = []
        with self._saying("name"):
            self.node = ScriptedRobot(graph, script.name)
        try:
            self._do(script)
        except ScriptError:
            self.node.close()
            raise

    def _do(self, script: Script) -> None:
        for name, value in script.parameters.items():
            with self._saying("parameters", name):
                self.node.has_parameter(name, value)
        for name, service in script.services.items():
            self._service(name, service)
        for name, action in script.actions.items():
            with self._saying("actions", name):
                self._action(name, action)
        for name, topic in script.topics.items():
            self._topic(name, topic)

    def close(self) -> None:
        """Close the node."""
        self.node.close()

    @contextmanager
    def _saying(self, *key: str | int) -> Iterator[None]:
        """Prefix errors raised in the block with the file and the key."""
        try:
            yield
        except (ScriptError, RobotError) as error:
            raise ScriptError(f"{self._file}: `{dotted(key)}`: {error}") from None

    def _topic(self, name: str, script: TopicScript) -> None:
        with self._saying("topics", name):
            topic = self.node.publishes(name, script.type, latch=script.latched is not None)
        recorded = script.recorded
        if script.file is not None:
            recorded = read_recorded(self._file.parent / script.file)
        for index, message in enumerate(script.messages):
            with self._saying("topics", name, "messages", index):
                topic.check((message,))
        with self._saying("topics", name):
            if script.latched is not None:
                topic.publish(script.latched)
            elif script.rate is not None:
                topic.repeat(script.messages, script.rate, again=script.repeat is not False)
            elif script.messages:
                self.stepped.append(SteppedTopic(topic, script.messages))
            elif recorded:
                topic.play([(each.at, each.msg) for each in recorded], repeat=script.repeat is True)

    def _service(self, name: str, script: ServiceScript) -> None:
        with self._saying("services", name):
            service = self.node.on_service(name, script.type)
            _answer(service, script)
        # In a script the first matching case answers, in a scripted service the last: reverse them.
        for index, case in reversed(tuple(enumerate(script.when))):
            with self._saying("services", name, "when", index):
                _answer(service.when(case.request), case)

    def _action(self, name: str, script: ActionScript) -> None:
        action = self.node.on_action(name, script.type)
        action.feedback(*script.feedback, every=script.every)
        if script.ignores_cancel:
            action.ignores_cancel()
        if script.rejects is not None:
            action.rejects(script.rejects)
        elif script.aborts is not None:
            action.aborts(script.aborts, after=script.after)
        elif script.never_ends:
            action.never_ends()
        else:
            action.succeeds(script.succeeds, after=script.after)


def _answer(service: ScriptedService | Case, script: AnswerScript) -> None:
    if script.returns is not None:
        several = script.returns if isinstance(script.returns, list) else (script.returns,)
        service.returns(*several, after=script.after)
    elif script.fails is not None:
        service.raises(script.fails, after=script.after)
    elif script.never_answers:
        service.never_answers()


def inject(faults: Faults, scripts: Iterable[FaultScript]) -> None:
    """Inject the faults of a script."""
    for each in scripts:
        scope: Scope = {"op": each.op, "to": each.to, "count": each.count, "every": each.every}
        if each.drop is not None:
            faults.drop(each.drop, **scope)
        elif each.delay is not None:
            faults.delay(each.seconds or 0.0, each.delay, **scope)
        elif each.duplicate is not None:
            faults.duplicate(each.duplicate, copies=each.copies, **scope)
        elif each.refuse is not None:
            faults.refuse(each.refuse, count=each.count)
        else:
            faults.slow_reader(each.slow_reader or 1.0)
