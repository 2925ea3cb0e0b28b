"""Scripts in Python: a file with a function ``robot(robot)``."""

from __future__ import annotations

import importlib.util
import inspect
import logging
import sys
import traceback
from collections.abc import Callable, Coroutine
from functools import partial
from pathlib import Path
from types import ModuleType, TracebackType

import anyio

from rwt.extensions.testing.errors import ScriptError, instead
from rwt.extensions.testing.journal import ObservedGraph
from rwt.extensions.testing.scripted.robot import ScriptedRobot

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
