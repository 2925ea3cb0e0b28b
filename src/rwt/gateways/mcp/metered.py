"""Metering of the work of a coroutine, without its waiting."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Coroutine, Generator
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Metered(Awaitable[T], Generic[T]):
    """A coroutine whose work is counted, each time that it waits again.

    Args:
        coroutine: what is done.
        charge: called with seconds.
    """

    def __init__(self, coroutine: Coroutine[Any, Any, T], charge: Callable[[float], object]) -> None:
        self._coroutine = coroutine
        self._charge = charge

    def __await__(self) -> Generator[Any, Any, T]:
        step = _sender(self._coroutine, None)
        while True:
            began = time.monotonic()
            try:
                waited_for = step()
            except StopIteration as ended:
                result: T = ended.value
                return result
            finally:
                self._charge(time.monotonic() - began)
            try:
                value = yield waited_for
            except GeneratorExit:
                self._coroutine.close()
                raise
            except BaseException as error:
                step = _thrower(self._coroutine, error)
            else:
                step = _sender(self._coroutine, value)


def _thrower(coroutine: Coroutine[Any, Any, Any], error: BaseException) -> Callable[[], Any]:
    return lambda: coroutine.throw(error)


def _sender(coroutine: Coroutine[Any, Any, Any], value: object) -> Callable[[], Any]:
    return lambda: coroutine.send(value)
