"""Scripted robot from a file: TOML, or Python with a function ``robot(robot)``."""

from __future__ import annotations

import importlib.util
import inspect
import logging
import sys
import traceback
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import anyio

from rwt.testing.errors import ScriptError, instead
from rwt.testing.journal import ObservedGraph
from rwt.testing.script.file import (
    ActionScript,
    AnswerScript,
    FaultScript,
    Script,
    ServiceScript,
    TopicScript,
    dotted,
    read_recorded,
)
from rwt.testing.scripted.robot import ScriptedRobot
from rwt.testing.scripted.service import Case, ScriptedService
from rwt.testing.scripted.topic import ScriptedTopic
from rwt.testing.wire.faults import Faults, Scope
from rwt_participant.errors import RobotError


class SteppedTopic:
    """Topic whose messages are published one at a time, by :meth:`step`."""

    def __init__(self, topic: ScriptedTopic, messages: tuple[Any, ...]) -> None:
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
                self.node.has_parameter(name, _as_lists(value))
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
                topic.check((_as_lists(message),))
        with self._saying("topics", name):
            if script.latched is not None:
                topic.publish(_as_lists(script.latched))
            elif script.rate is not None:
                messages = [_as_lists(message) for message in script.messages]
                topic.repeat(messages, script.rate, again=script.repeat is not False)
            elif script.messages:
                self.stepped.append(SteppedTopic(topic, tuple(map(_as_lists, script.messages))))
            elif recorded:
                timed = [(each.at, _as_lists(each.msg)) for each in recorded]
                topic.play(timed, repeat=script.repeat is True)

    def _service(self, name: str, script: ServiceScript) -> None:
        with self._saying("services", name):
            service = self.node.on_service(name, script.type)
            _answer(service, script)
        # In a script the first matching case answers, in a scripted service the last: reverse them.
        for index, case in reversed(tuple(enumerate(script.when))):
            with self._saying("services", name, "when", index):
                _answer(service.when(_as_lists(case.request)), case)

    def _action(self, name: str, script: ActionScript) -> None:
        action = self.node.on_action(name, script.type)
        action.feedback(*map(_as_lists, script.feedback), every=script.every)
        if script.ignores_cancel:
            action.ignores_cancel()
        if script.rejects is not None:
            action.rejects(script.rejects)
        elif script.aborts is not None:
            action.aborts(_as_lists(script.aborts), after=script.after)
        elif script.never_ends:
            action.never_ends()
        else:
            action.succeeds(_as_lists(script.succeeds), after=script.after)


def _answer(service: ScriptedService | Case, script: AnswerScript) -> None:
    if script.returns is not None:
        several = script.returns if isinstance(script.returns, tuple) else (script.returns,)
        service.returns(*map(_as_lists, several), after=script.after)
    elif script.fails is not None:
        service.raises(script.fails, after=script.after)
    elif script.never_answers:
        service.never_answers()


def _as_lists(value: Any) -> Any:
    """Convert tuples to lists: ROS arrays are lists, the models have tuples."""
    if isinstance(value, Mapping):
        return {key: _as_lists(inner) for key, inner in value.items()}
    return [_as_lists(inner) for inner in value] if isinstance(value, tuple | list) else value


def inject(faults: Faults, scripts: tuple[FaultScript, ...]) -> None:
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


logger = logging.getLogger(__name__)

FUNCTION = "robot"

RobotFunction = Callable[[ScriptedRobot], Coroutine[object, object, None] | None]


def read_program(file: Path) -> RobotFunction:
    """Run a file and return its function `robot`. Modules beside the file can be imported from it.

    Raises:
        ScriptError: the file cannot be read, raises, or has no such function.
    """
    spec = importlib.util.spec_from_file_location(f"rwt_script_{file.stem}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise ScriptError(f"{file}: no such Python file")
    module = importlib.util.module_from_spec(spec)
    folder = str(file.parent.resolve())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ScriptError(f"{_place(file, error.__traceback__)}: {_named(error)}") from error
    return _function(file, module)


def _function(file: Path, module: ModuleType) -> RobotFunction:
    function: RobotFunction | None = getattr(module, FUNCTION, None)
    if inspect.isfunction(function):
        return function
    known = [name for name, _ in inspect.getmembers(module, inspect.isfunction)]
    raise ScriptError(
        f"{file}: expected a function `def {FUNCTION}(robot):`, plain or async"
        + (f"; {instead(FUNCTION, known)}" if known else "")
    )


class ProgramRobot:
    """Robot driven by a function.

    A plain function is called once and must return; a coroutine function runs until the robot is closed.

    Args:
        file: file of the function, for error texts.

    Raises:
        ScriptError: the function raised.
    """

    def __init__(self, graph: ObservedGraph, function: RobotFunction, file: Path) -> None:
        self.node = ScriptedRobot(graph, "robot")
        self._file = file
        self._scope: anyio.CancelScope | None = None
        self._over = False
        try:
            returned = function(self.node)
        except Exception as error:
            self.node.close()
            raise ScriptError(f"{_place(file, error.__traceback__)}: {_named(error)}") from error
        if inspect.iscoroutine(returned):
            graph.spawn(partial(self._run, returned), f"script {file}")

    async def _run(self, coroutine: Coroutine[object, object, None]) -> None:
        if self._over:
            coroutine.close()
            return
        with anyio.CancelScope() as self._scope:
            try:
                await coroutine
            except Exception as error:
                place = _place(self._file, error.__traceback__)
                logger.exception("%s: %s", place, _named(error))

    def close(self) -> None:
        """Stop the function and close the node. Called on the graph's thread."""
        self._over = True
        if self._scope is not None:
            self._scope.cancel()
        self.node.close()


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _place(file: Path, trace: TracebackType | None) -> str:
    frames = traceback.extract_tb(trace)
    here = [frame.lineno for frame in frames if Path(frame.filename).resolve() == file.resolve()]
    return f"{file}:{here[-1]}" if here else str(file)
