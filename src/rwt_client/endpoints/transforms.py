"""Transforms of the robot, or a compact form of them from its tf2_web_republisher."""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable
from typing import Any, Final

from rwt_client.endpoints.remote_handle import ClientConnection
from rwt_client.errors import ConnectionLost
from rwt_client.events import ConnectionEvent
from rwt_participant.errors import RobotError
from rwt_participant.handles import Handle
from rwt_participant.transforms import AdvertiseVerb, Transforms

logger = logging.getLogger("rwt_client")

REPUBLISHER: Final = "/republish_tfs"

_ARRAY: Final = "tf2_web_republisher/TFArray"


class RemoteTransforms(Transforms):
    """Tree of frames of a robot, over a connection that may be lost and restored."""

    def __init__(
        self,
        connection: ClientConnection,
        subscribe: Callable[..., Handle],
        advertise: AdvertiseVerb,
        call: Callable[[str, dict[str, object], str], Awaitable[Any]],
        timeout: float | None,
    ) -> None:
        super().__init__(self._listen, advertise, time.time_ns, timeout)
        self._connection = connection
        self._subscribe_with_options = subscribe
        self._call = call
        self._request: dict[str, object] | None = None
        """Request to the republisher; None without one."""

    def _listen(self, topic: str, callback: Callable[[Any], None], type: str, /) -> Handle:
        is_compact = self._request is not None and self._connection.cbor_offered
        compression = "cbor" if is_compact else "none"
        return self._subscribe_with_options(topic, callback, type, compression=compression)

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
        self._request = {"rate": rate, "trans_thres": linear, "angular_thres": angular}
        self._topics = "the republisher's topic"
        try:
            await self._follow()
        except RobotError:
            self.close()
            raise

    def close(self) -> None:
        super().close()
        self._request = None
        self._topics = Transforms._topics

    async def _follow(self) -> None:
        assert self._request is not None  # Only the compact form needs this.
        answer = await self._call(REPUBLISHER, self._request, "tf2_web_republisher/RepublishTFs")
        self._unsubscribe()
        await self._subscribe(answer.topic_name, _ARRAY, static=True)

    def on_event(self, event: ConnectionEvent) -> None:
        """Restore requests and static transforms on a new connection; fail lookups once it is closed."""
        if event.kind == "closed":
            self.end(ConnectionLost("the connection was closed before the transform was known"))
        elif event.kind == "restored":
            # The server has released the retained transforms and the republisher's topic with the connection.
            self.send_static_again()
            if self._request is not None:
                self._connection.tasks.start_soon(self._follow_again)

    async def _follow_again(self) -> None:
        try:
            await self._follow()
        except RobotError as error:
            logger.warning("the robot's transforms are not heard any more: %s", error)
