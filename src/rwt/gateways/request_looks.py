"""Early looks of HTTP requests: before a request is read in its turn, and before it is answered."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Final

from rwt.gateways.early_look import EarlyLook, LookState
from rwt.gateways.visitors import peer_of

if TYPE_CHECKING:
    from rwt.access.access import Access
    from rwt.access.graph_view import GraphView
    from rwt_transports.http.routes import HttpRequest, StopRequests
    from rwt_transports.scheduler import Scheduler

MAX_STOP_BODY_BYTES: Final = 4096
"""Maximum size of the body of a request that is looked at, in bytes."""


class RequestLooks:
    """Early looks of HTTP clients, one for each of their connections.

    A request with a look presses the stop before it is answered like any other, so its answer reports the
    stopped robot.

    Args:
        turns: scheduler of the pages.
    """

    def __init__(self, access: Access, turns: Scheduler) -> None:
        self._access = access
        self._turns = turns
        self._looks: dict[Hashable, EarlyLook] = {}  # The last used is the last.
        self._ways: list[tuple[str, StopRequests[GraphView]]] = []

    def add(self, path: str, way: StopRequests[GraphView]) -> None:
        """Answer requests for a route early if they may press the stop.

        Args:
            path: path as in :class:`rwt_transports.http.routes.Routes`.
        """
        if (path, way) not in self._ways:
            self._ways.append((path, way))

    # -- requests that wait to be read ---------------------------------------------------------------------

    def may_begin(self, connection: Hashable, data: bytes) -> bool:
        """See :class:`rwt_transports.http.routes.EarlyRequests`."""
        gate, look = self._access.gate, self._looks.get(connection)
        if gate is None or gate.stopped_by or b"stop" not in data:
            return False
        return look is None or look.state is LookState.READY

    def begin(self, request: HttpRequest) -> bool:
        """Begin the look of a request that waits to be read, if its sender may press the stop by it."""
        for path, way in self._ways:
            if path == request.path or (path.endswith("/*") and request.path.startswith(path[:-1])):
                role = self._access.admission.expected_role(peer_of(request))
                if role is None:
                    return False
                reader = self._access.view(role, self._access.nobody.work)
                return way.may_press(request, reader) and self._of(request.connection).begin()
        return False

    def end(self, connection: Hashable) -> None:
        """End the look of a request, which was answered ahead of its turn."""
        look, gate = self._looks.get(connection), self._access.gate
        if look is not None and look.state is LookState.LOOKING:
            look.end(is_stopped=gate is not None and bool(gate.stopped_by))

    # -- requests that are answered ------------------------------------------------------------------------

    def press(self, way: StopRequests[GraphView], request: HttpRequest, reader: GraphView) -> bool:
        """Press the stop ahead of all that waits, if a request asks for it and its connection has a look.

        Returns:
            True if the stop was pressed: nothing may delay or refuse the request.
        """
        gate = self._access.gate
        if gate is None or len(request.body) > MAX_STOP_BODY_BYTES or not way.may_press(request, reader):
            return False
        look = self._of(request.connection)
        # It has begun for a request that waited to be read.
        if not look.begin() and look.state is not LookState.LOOKING:
            return False
        began = reader.clock.monotonic()
        try:
            way.press(request, reader)
        finally:
            look.end(is_stopped=bool(gate.stopped_by))
            seconds = reader.clock.monotonic() - began
            reader.work.add(seconds, "pages")
            self._turns.note(seconds)
        return bool(gate.stopped_by)

    def _of(self, connection: Hashable | None) -> EarlyLook:
        """Return the look of a connection; for an unknown one, a look of the request's own."""
        if connection is None:
            return EarlyLook(self._turns)
        look = self._looks.pop(connection, None) or EarlyLook(self._turns)
        # Those that are ready are as if there were none. The first was used longest ago.
        while self._looks and next(iter(self._looks.values())).state is LookState.READY:
            del self._looks[next(iter(self._looks))]
        self._looks[connection] = look
        return look
