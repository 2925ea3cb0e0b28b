"""Robots for programs without an event loop: the verbs block, and a loop runs in a thread behind them.

Callbacks and handlers run in that thread. They may publish and advertise. Verbs that wait for an answer raise
:exc:`~rwt_participant.errors.WrongThread` there, because the thread would wait for itself.
"""

from __future__ import annotations

import functools
import inspect
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar

from rwt_participant.api import Parameters, RobotApi
from rwt_participant.goals import Goal, GoalStatus
from rwt_participant.handles import Handle, Publisher, Subscription
from rwt_participant.messages import Message, MessageLike
from rwt_participant.timers import PeriodicTimer, ResettableTimer
from rwt_participant.transforms import Transforms

P = ParamSpec("P")
T = TypeVar("T")
Face = TypeVar("Face")
Inner = TypeVar("Inner")
Robot = TypeVar("Robot", bound=RobotApi)


class LoopThread(ABC):
    """Event loop that runs in another thread."""

    @property
    @abstractmethod
    def here(self) -> bool:
        """True on its thread."""

    @abstractmethod
    def run(self, function: Callable[[], T]) -> T:
        """Run a plain function there and return its result; at once on its thread."""

    @abstractmethod
    def post(self, function: Callable[[], None]) -> None:
        """Run a plain function there, soon and in order; does not wait."""

    @abstractmethod
    def wait(self, function: Callable[[], Awaitable[T]]) -> T:
        """Run a coroutine function there and return its result.

        Raises:
            WrongThread: this is its thread, which would wait for itself.
        """


class Blocking(Generic[Inner]):
    """Wrapper of an object of an event loop, for other threads."""

    def __init__(self, loop: LoopThread, inner: Inner) -> None:
        self._loop = loop
        self._inner = inner

    def __repr__(self) -> str:
        return repr(self._inner)


def _named_as(method: Callable[..., object]) -> Callable[[Callable[P, T]], Callable[P, T]]:
    def name(function: Callable[P, T]) -> Callable[P, T]:
        functools.update_wrapper(function, method)
        function.__doc__ = inspect.getdoc(method)
        return function

    return name


def waits(
    method: Callable[Concatenate[Any, P], Awaitable[T]],
) -> Callable[Concatenate[Blocking[Any], P], T]:
    """Return a method that blocks until the same coroutine method has finished."""
    name = method.__name__

    @_named_as(method)
    def wait(self: Blocking[Any], /, *args: P.args, **kwargs: P.kwargs) -> T:
        call = functools.partial(getattr(self._inner, name), *args, **kwargs)
        result: T = self._loop.wait(call)
        return result

    return wait


def runs(method: Callable[Concatenate[Any, P], T]) -> Callable[Concatenate[Blocking[Any], P], T]:
    """Return a method that runs the same plain method in the loop's thread."""
    name = method.__name__

    @_named_as(method)
    def run(self: Blocking[Any], /, *args: P.args, **kwargs: P.kwargs) -> T:
        call = functools.partial(getattr(self._inner, name), *args, **kwargs)
        result: T = self._loop.run(call)
        return result

    return run


def passes(
    method: Callable[Concatenate[Any, P], T], face: Callable[[LoopThread, T], Face]
) -> Callable[Concatenate[Blocking[Any], P], Face]:
    """Return a method that calls the same plain method in the caller's thread, and wraps its handle."""
    name = method.__name__

    @_named_as(method)
    def call(self: Blocking[Any], /, *args: P.args, **kwargs: P.kwargs) -> Face:
        return face(self._loop, getattr(self._inner, name)(*args, **kwargs))

    return call


def holds(
    method: Callable[Concatenate[Any, P], Awaitable[T]], face: Callable[[LoopThread, T], Face]
) -> Callable[Concatenate[Blocking[Any], P], Face]:
    """Return a method that wraps the handle or goal of the same method by `face`, once it is ready.

    In callbacks it does not wait for handles.
    """
    name, is_handle = method.__name__, not inspect.iscoroutinefunction(method)

    @_named_as(method)
    def hold(self: Blocking[Any], /, *args: P.args, **kwargs: P.kwargs) -> Face:
        make = functools.partial(getattr(self._inner, name), *args, **kwargs)

        async def begin() -> T:
            made: T = await make()
            return made

        at_once = is_handle and self._loop.here
        return face(self._loop, self._loop.run(make) if at_once else self._loop.wait(begin))

    return hold


_END: Any = object()


def iterate(loop: LoopThread, values: AsyncIterator[T]) -> Iterator[T]:
    """Yield what an asynchronous iterator of the loop yields."""

    async def take() -> T:
        return await anext(values, _END)

    while (value := loop.wait(take)) is not _END:
        yield value


class BlockingTimer(Blocking[PeriodicTimer], ResettableTimer):
    """Timer with a callback in the loop's thread; see :class:`~rwt_participant.timers.PeriodicTimer`."""

    reset = runs(PeriodicTimer.reset)
    cancel = runs(PeriodicTimer.cancel)


class BlockingHandle(Blocking[Handle]):
    """Subscription with a callback, or a service or action of this program; see :class:`Handle`."""

    ready = waits(Handle.ready)
    close = runs(Handle.close)

    @property
    def name(self) -> str:
        """Name of the topic, service or action."""
        return self._inner.name

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class BlockingPublisher(BlockingHandle):
    """Publisher of one topic; see :class:`~rwt_participant.handles.Publisher`."""

    _inner: Publisher

    def publish(self, message: MessageLike) -> None:
        """Publish one message; does not wait. See :meth:`Publisher.publish`."""
        self._inner.publish(message)


class BlockingSubscription(BlockingHandle):
    """Messages of a topic, as an iterator; see :class:`~rwt_participant.handles.Subscription`."""

    _inner: Subscription

    get = waits(Subscription.get)

    @property
    def dropped(self) -> int:
        """Number of messages that were dropped because they were not taken in time."""
        return self._inner.dropped

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Message:
        return next(iterate(self._loop, self._inner))


class BlockingGoal(Blocking[Goal]):
    """Goal that was sent, and an iterator over its feedback; see :class:`~rwt_participant.goals.Goal`."""

    result = waits(Goal.result)
    cancel = runs(Goal.cancel)
    abandon = runs(Goal.abandon)

    @property
    def action(self) -> str:
        """Name of the action."""
        return self._inner.action

    @property
    def id(self) -> str:
        """Id of the goal."""
        return self._inner.id

    @property
    def status(self) -> GoalStatus:
        """Last known state."""
        return self._inner.status

    @property
    def done(self) -> bool:
        """True if it has ended."""
        return self._inner.done

    @property
    def reason(self) -> str:
        """Reason that the server gave for the end of the goal; empty while it runs or if there is none."""
        return self._inner.reason

    def feedback(self) -> Iterator[Message]:
        """Yield the feedback until the goal ends; see :meth:`Goal.feedback`."""
        return iterate(self._loop, self._inner.feedback())

    def __iter__(self) -> Iterator[Message]:
        return self.feedback()


class BlockingParameters(Blocking[Parameters]):
    """Parameters of all nodes; see :class:`~rwt_participant.api.Parameters`."""

    get = waits(Parameters.get)
    set = waits(Parameters.set)
    has = waits(Parameters.has)
    delete = waits(Parameters.delete)
    names = waits(Parameters.names)


class BlockingTransforms(Blocking[Transforms]):
    """Transforms between frames; see :class:`~rwt_participant.transforms.Transforms`."""

    start = waits(Transforms.start)
    lookup = waits(Transforms.lookup)
    lookup_full = waits(Transforms.lookup_full)
    can_transform = waits(Transforms.can_transform)
    close = runs(Transforms.close)
    send_transform = runs(Transforms.send_transform)
    send_transforms = runs(Transforms.send_transforms)

    def tree(self) -> str:
        """Return the known frames as indented text."""
        return self._loop.run(self._inner.buffer.tree)


class BlockingVerbs(Blocking[Robot], Generic[Robot]):
    """Verbs that are the same for every robot; see :class:`~rwt_participant.api.RobotApi`.

    Verbs with further arguments of a node or a client are defined there: type checkers take a verb's
    arguments from its first definition.
    """

    def __init__(self, loop: LoopThread, inner: Robot) -> None:
        super().__init__(loop, inner)
        self.params = BlockingParameters(loop, inner.params)

    topics = waits(RobotApi.topics)
    services = waits(RobotApi.services)
    actions = waits(RobotApi.actions)
    type_of = waits(RobotApi.type_of)
    interface = waits(RobotApi.interface)
    subscribe_raw = holds(RobotApi.subscribe_raw, BlockingHandle)
    advertise_service = holds(RobotApi.advertise_service, BlockingHandle)
    cancel_goal = runs(RobotApi.cancel_goal)
    describe = holds(RobotApi.describe, BlockingHandle)
    on_emergency_stop = holds(RobotApi.on_emergency_stop, BlockingHandle)
    time_ns = waits(RobotApi.time_ns)

    def create_timer(
        self, period: float, callback: Callable[[], Awaitable[None] | None], *, threaded: bool = False
    ) -> BlockingTimer:
        """Call `callback` periodically in the loop's thread; see :meth:`RobotApi.create_timer`."""
        make = functools.partial(self._inner.create_timer, period, callback, threaded=threaded)
        return BlockingTimer(self._loop, self._loop.run(make))
