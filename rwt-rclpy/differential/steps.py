"""Steps that the programs share: a node, waiting for a condition, and the outcome of a call as one line."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.executors import SingleThreadedExecutor

F = TypeVar("F", bound=Callable[..., Any])

#: Longest wait for something that has to happen, in seconds.
PATIENCE_S = 4.0
#: Wait for something that must not happen, in seconds.
QUIET_S = 0.25


def with_logs(program: F) -> F:
    """Compare what a program writes to standard error, too."""
    program.with_logs = True  # type: ignore[attr-defined]  # a mark on the function, read by the player
    return program


def tell(label: object, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Print the result of a call, or the class of its exception."""
    try:
        result = function(*args, **kwargs)
    except Exception as error:
        print(label, "raises", type(error).__name__)
        return None
    print(label, "->", repr(result))
    return result


def fails(label: object, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Print the result of a call, or the class of its exception and the first line of its text.

    Programs match on that line; `differential.comparison` counts lines that differ in the text alone apart.
    """
    try:
        result = function(*args, **kwargs)
    except Exception as error:
        print(label, "raises", f"{type(error).__name__}:", next(iter(str(error).splitlines()), ""))
        return None
    print(label, "->", repr(result))
    return result


@contextmanager
def node(name: str = "node", *, args: list[str] | None = None, **options: Any) -> Iterator[Any]:
    """Initialise rclpy, and yield a node."""
    rclpy.init(args=args or [])
    made = rclpy.create_node(name, **options)
    try:
        yield made
    finally:
        if rclpy.ok():  # The real one may crash when a node is destroyed after the context.
            made.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def spinner(*nodes: Any, executor: Any = None) -> Iterator[Callable[..., bool]]:
    """Yield a function that runs callbacks until a condition is met, or for some seconds."""
    executor = executor or SingleThreadedExecutor()
    for each in nodes:
        executor.add_node(each)

    def spin(condition: Callable[[], object] = lambda: False, seconds: float = PATIENCE_S) -> bool:
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() >= end:
                return False
            executor.spin_once(timeout_sec=0.02)
        return True

    try:
        yield spin
    finally:
        executor.shutdown()


def wait(condition: Callable[[], object], seconds: float = PATIENCE_S) -> bool:
    """Wait for a condition without running callbacks."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() >= end:
            return False
        time.sleep(0.005)
    return True


def public(thing: object) -> list[str]:
    """Return the public attributes of an object."""
    return [each for each in dir(thing) if not each.startswith("_")]
