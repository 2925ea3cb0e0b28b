"""Emergency stop of a gate, as a robot program follows it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final

from rwt_participant.handles import Handle
from rwt_participant.messages import Message, is_coroutine_function
from rwt_participant.timers import RobotClock
from rwt_participant.transforms import SubscribeVerb

logger = logging.getLogger(__name__)

_TOPIC: Final = "/gate/stopped"
_TYPE: Final = "rwt_gate_msgs/EmergencyStop"

_RETRY_SECONDS: Final = 0.5
"""Interval between two calls of a `stop` that raises."""


class EmergencyStopHandle(Handle):
    """Subscription to the emergency stop; see :meth:`~rwt_participant.api.RobotApi.on_emergency_stop`."""

    def __init__(
        self,
        subscribe: SubscribeVerb,
        clock: RobotClock,
        stop: Callable[[], None],
        release: Callable[[], None] | None,
    ) -> None:
        for function in (stop, release):
            if function is not None and (not callable(function) or is_coroutine_function(function)):
                raise TypeError(
                    f"on_emergency_stop(stop, release): expected plain functions, got {function!r}"
                )
        self.name = _TOPIC
        self._clock = clock
        self._stop = stop
        self._release = release
        self._is_stopped = False
        self._subscription = subscribe(_TOPIC, self._receive, _TYPE)

    async def ready(self) -> None:
        await self._subscription.ready()

    def close(self) -> None:
        self._is_stopped = False
        self._subscription.close()

    def _receive(self, message: Message) -> None:
        if message.stopped == self._is_stopped:
            return
        self._is_stopped = message.stopped
        if message.stopped:
            self._call_stop()
        elif self._release is not None:
            self._release()

    def _call_stop(self) -> None:
        if not self._is_stopped:
            return
        try:
            self._stop()
        except Exception:
            logger.exception("the emergency stop failed; it is tried again in %g s", _RETRY_SECONDS)
            self._clock.call_later(_RETRY_SECONDS, self._call_stop)
