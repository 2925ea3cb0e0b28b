"""A worker thread that processes the latest input only, while the result has subscribers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final, Generic, TypeVar

import anyio.to_thread

from rwt.extensions.depth_cloud.errors import DepthCloudError
from rwt.media.errors import ImageUnreadable
from rwt_graph import Node, TopicPublisher
from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_participant.errors import HandleClosed
from rwt_participant.handles import Handle

T = TypeVar("T")

LOOK_EVERY: Final = 0.2
"""Interval at which the number of subscribers is checked, in seconds."""

_COMPLAIN_EVERY: Final = 10.0


@dataclass(eq=False)
class LatestOnly(Generic[T]):
    """Worker that turns inputs into messages in a thread, one at a time; it keeps only the latest input.

    Args:
        work: returns the result, in a worker thread; raises an error for unreadable input.
        listen: subscribes to the inputs and passes them to :meth:`offer`; the returned subscription is closed
            when the topic has no subscribers.
    """

    node: Node
    topic: TopicPublisher
    work: Callable[[T], Mapping[str, object]]
    listen: Callable[[], tuple[Handle, ...]]

    def __post_init__(self) -> None:
        self._inputs: tuple[Handle, ...] = ()
        self._next: T | None = None
        self._busy = False
        self._complained = float("-inf")
        self.node.create_timer(LOOK_EVERY, self._look)

    def offer(self, item: T) -> None:
        """Process `item` next, in place of a pending one."""
        self._next = item
        if not self._busy:
            self._busy = True
            self.node.graph.spawn(self._run, f"work for {self.topic.name}")

    async def _run(self) -> None:
        try:
            while (item := self._next) is not None:
                self._next = None
                await self._publish(item)
        finally:
            self._busy = False

    async def _publish(self, item: T) -> None:
        try:
            message = await anyio.to_thread.run_sync(partial(self.work, item))
        except (DepthCloudError, ImageUnreadable, InvalidCloud) as error:
            self._complain(str(error))
            return
        with suppress(HandleClosed):  # The node has left meanwhile.
            self.topic.publish(message)

    def _complain(self, text: str) -> None:
        now = self.node.clock.monotonic()
        if now - self._complained >= _COMPLAIN_EVERY:
            self._complained = now
            line = f"nothing on {self.topic.name}: {text}"
            self.node.log.warning(line)

    def _look(self) -> None:
        wanted = self.topic.subscriber_count > 0
        if wanted and not self._inputs:
            self._inputs = self.listen()
        elif not wanted and self._inputs:
            for each in self._inputs:
                each.close()
            self._inputs = ()
