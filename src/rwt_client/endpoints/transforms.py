"""Transforms of the robot, or a compact form of them from its tf2_web_republisher."""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from rwt_client.errors import ConnectionLost
from rwt_client.events import ConnectionEvent
from rwt_participant.errors import RobotError
from rwt_participant.transforms import AdvertiseVerb, SubscribeVerb, Transforms

logger = logging.getLogger("rwt_client")

REPUBLISHER: Final = "/republish_tfs"

_ARRAY: Final = "tf2_web_republisher/TFArray"


@dataclass(frozen=True, slots=True)
class _Thresholds:
    """Request to the republisher; see :meth:`RemoteTransforms.start_compact`."""

    rate: float
    linear: float
    angular: float

    def request(self) -> dict[str, object]:
        return {"rate": self.rate, "trans_thres": self.linear, "angular_thres": self.angular}


class RemoteTransforms(Transforms):
    """Tree of frames of a robot, over a connection that may be lost and restored.

    Args:
        subscribe: subscribes to `/tf` and `/tf_static`.
        subscribe_compact: subscribes to the republisher, in CBOR if the connection carries it.
        advertise: advertises `/tf` and `/tf_static`.
        call: calls the republisher.
        background: starts a task.
        timeout: default timeout of lookups in seconds; None waits without limit.
    """

    def __init__(
        self,
        subscribe: SubscribeVerb,
        subscribe_compact: SubscribeVerb,
        advertise: AdvertiseVerb,
        call: Callable[[str, dict[str, object], str], Awaitable[Any]],
        background: Callable[[Callable[[], Any]], object],
        timeout: float | None,
    ) -> None:
        super().__init__(self._listen, advertise, time.time_ns, timeout)
        self._subscribe_all = subscribe
        self._subscribe_compact = subscribe_compact
        self._call = call
        self._background = background
        self._thresholds: _Thresholds | None = None

    def _listen(self, topic: str, callback: Callable[[Any], None], type: str, /) -> Any:
        subscribe = self._subscribe_all if self._thresholds is None else self._subscribe_compact
        return subscribe(topic, callback, type)

    async def start_compact(self, rate: float = 10.0, linear: float = 0.01, angular: float = 0.01) -> None:
        """Receive only changes, from the robot's tf2_web_republisher, in place of `/tf`.

        No frame, as seen from the root of its tree, differs by more than the thresholds at the time of a
        message. Only the latest transforms are known, so lookups ignore the time. Requires a server of this
        project.

        Args:
            rate: maximum number of messages per second.
            linear: threshold in metres.
            angular: threshold in radians.

        Raises:
            ProviderNotFound: the server has no republisher.
        """
        self.close()
        self._thresholds = _Thresholds(rate, linear, angular)
        self._topics = "the republisher's topic"
        try:
            await self._follow()
        except RobotError:
            self.close()
            raise

    def close(self) -> None:
        super().close()
        self._thresholds = None
        self._topics = Transforms._topics

    async def _follow(self) -> None:
        assert self._thresholds is not None  # Only the compact form needs this.
        answer = await self._call(REPUBLISHER, self._thresholds.request(), "tf2_web_republisher/RepublishTFs")
        self._unsubscribe()
        await self._subscribe(answer.topic_name, _ARRAY, static=True)

    def on_event(self, event: ConnectionEvent) -> None:
        """Restore requests and static transforms on a new connection; fail lookups once it is closed."""
        if event.kind == "closed":
            self.end(ConnectionLost("the connection was closed before the transform was known"))
        elif event.kind == "restored":
            # The server has released the retained transforms and the republisher's topic with the connection.
            self.send_static_again()
            if self._thresholds is not None:
                self._background(self._follow_again)

    async def _follow_again(self) -> None:
        try:
            await self._follow()
        except RobotError as error:
            logger.warning("the robot's transforms are not heard any more: %s", error)
