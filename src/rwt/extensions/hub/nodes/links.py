"""Links of a home node to other nodes: each serves the streams of one robot there."""

from __future__ import annotations

import logging
from functools import partial
from ssl import SSLContext
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.hub.ends import ClientEnd, RobotEnd
from rwt.extensions.hub.uplink.dial import open_uplink
from rwt.extensions.hub.uplink.frames import Refusal
from rwt.extensions.hub.uplink.openings import ROBOTS, PageRequest, encode_opening
from rwt.extensions.hub.uplink.streams import Stream
from rwt_transports.background import TaskStarter
from rwt_transports.backoff import Backoff
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import BadUrl, Refused
from rwt_transports.limits import Limits

if TYPE_CHECKING:
    from rwt.extensions.hub.hub import Hub

logger = logging.getLogger(__name__)

BACKOFF: Final = Backoff(first=0.2, longest=1.0, jitter=0.5, attempts=5)
"""Delays between the attempts to reach a node that has asked for a robot. It asks again if it needs to."""

MAX_LINKS: Final = 65_536
"""Maximum number of links of a node to others, which ask for no more than their own limits."""


class Links:
    """Links of a node to others, for robots that have dialled in here.

    Args:
        hub: the node.
        starter: starts the tasks that keep the links.
        limits: limits of each link; ``connections`` counts its streams.
        tls: how to check the certificates of other nodes; by default against the system's authorities.
    """

    def __init__(self, hub: Hub, starter: TaskStarter, limits: Limits, tls: SSLContext | None) -> None:
        self._hub = hub
        self._starter = starter
        self._limits = limits
        self._tls = tls
        self._open: dict[str, list[anyio.CancelScope]] = {}

    def __len__(self) -> int:
        return sum(map(len, self._open.values()))

    def open(self, robot: str, url: str, token: str) -> str:
        """Serve a robot at the node with this URL. Returns why that is impossible, or an empty text."""
        if self._hub.here(robot) is None:
            return f"no robot {robot} is here"
        if len(self) >= MAX_LINKS:
            return f"all {MAX_LINKS} links are open"
        self._starter.start_soon(self._keep, robot, url, token)
        return ""

    def end(self, robot: str) -> None:
        """End the links for a robot that has left."""
        for scope in self._open.get(robot, ()):
            scope.cancel()

    async def _keep(self, robot: str, url: str, token: str) -> None:
        if self._hub.here(robot) is None:
            return  # It has left meanwhile.
        scope = anyio.CancelScope()
        self._open.setdefault(robot, []).append(scope)
        opened = open_uplink(
            f"{url}{ROBOTS}{robot}",
            partial(self._serve, robot),
            token=token,
            limits=self._limits,
            tls=self._tls,
            backoff=BACKOFF,
            until_unused=True,
        )
        try:
            with scope:
                async with opened as status:
                    await status.over.wait()
        except BadUrl as error:
            logger.warning("cannot serve robot %s at another node: %s", robot, error)
        finally:
            scopes = self._open[robot]
            scopes.remove(scope)
            if not scopes:
                del self._open[robot]

    def _serve(self, robot: str, stream: Stream, opened: PeerInfo | PageRequest) -> None:
        """Pass a stream on to the robot; raises Refused."""
        address = opened.address if isinstance(opened, PeerInfo) else opened.request.address
        found = self._hub.here(robot)
        if found is None or not found.is_reachable:
            raise Refused(503, f"the robot {robot} is unreachable at the moment", {"Retry-After": "1"})
        client = ClientEnd(self._hub, found, stream, address)
        further = found.uplink.open(encode_opening(opened), address)
        further.on_admission = partial(_answered, stream)
        end = RobotEnd(self._hub, found, further, address)
        client.other, end.other = end, client
        found.feeds.admit(further.number, stream)
        further.begin(end)
        stream.begin(client)


def _answered(stream: Stream, refusal: Refusal | None) -> None:
    if refusal is None:
        stream.admit()
    else:
        stream.refuse(refusal)
