"""Calls of services in other processes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from rwt.extensions.zenoh.rmw.attachment import Attachment
from rwt_graph.backend import MemoryCall
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_participant.errors import ProviderGone

if TYPE_CHECKING:
    from rwt.extensions.zenoh.link import Presence, ZenohLink
    from rwt.extensions.zenoh.rmw.tokens import TokenEndpoint
    from rwt_graph.api import OnReply
    from rwt_interfaces.structs import MessageType

#: Schema of an error reply's encoding: the provider failed, or it left.
FAILED, GONE = "failed", "gone"

#: Timeout of Zenoh's own queries in seconds; timeouts of calls are kept by the graph's clock.
_ZENOH_TIMEOUT = 10**8

_NOTE = struct.Struct("<16sq")


def abandoned_key(domain: int, session: str) -> str:
    """Return the key on which a process is notified of abandoned requests.

    It is this project's own: rmw_zenoh's clients do not send these, and its providers answer in vain.
    """
    return f"@rwt/{domain}/abandoned/{session}"


def read_abandoned(note: bytes) -> tuple[bytes, int]:
    """Return the client's GID and the number of its request; an empty GID if the note is invalid."""
    if len(note) != _NOTE.size:
        return b"", 0
    gid, number = _NOTE.unpack(note)
    return gid, number


class RemoteCall(MemoryCall):
    """Request to another process, as its caller sees it."""

    __slots__ = ("_failure", "_response", "abandon")

    def __init__(self, service: str, request: Payload, on_reply: OnReply, response: MessageType) -> None:
        super().__init__(service, request, on_reply)
        self._response = response
        self._failure: ProviderGone | None = None
        #: Called when the call ends without an answer: timed out, cancelled, or the caller left.
        self.abandon: Callable[[], object] | None = None

    def _end(self) -> OnReply | None:
        abandon, self.abandon = self.abandon, None
        if abandon is not None:
            abandon()
        return super()._end()

    def replied(self, reply: zenoh.Reply) -> None:
        """End the call with a provider's response or failure; if it only leaves, another may still answer."""
        error = reply.err
        if error is not None:
            text = error.payload.to_bytes().decode(errors="replace")
            if str(error.encoding).partition(";")[2] == GONE:
                self._failure = ProviderGone(text)
            else:
                self.abandon = None
                self.fail(text)
            return
        assert reply.ok is not None  # A reply is one of the two.
        self.abandon = None
        try:
            self.reply(Payload.from_cdr(self._response, reply.ok.payload.to_bytes()))
        except InvalidMessage:
            self.fail(f"the answer of {self.service} is not a {self._response.name}")

    def over(self) -> None:
        """End the call after all providers have replied or left."""
        self.abandon = None
        text = f"Service {self.service} went away without an answer"
        self.end_with(self._failure or ProviderGone(text))


class Client:
    """Client of one node for one service.

    The token of a service may arrive before its queryable. A request in between waits for the queryable; sent
    at once, it would get no answer.
    """

    def __init__(
        self, link: ZenohLink, end: TokenEndpoint, presence: Presence, time_ns: Callable[[], int]
    ) -> None:
        self._link = link
        self._presence = presence
        self._time_ns = time_ns
        self._number = 0
        self._unsent: dict[RemoteCall, set[str]] = {}
        self._listener: zenoh.MatchingListener[None] | None = None
        self._querier = link.session.declare_querier(
            end.data_key(link.domain),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_ZENOH_TIMEOUT,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def ask(
        self, service: str, request: Payload, on_reply: OnReply, response: MessageType, sessions: set[str]
    ) -> RemoteCall:
        """Send a request.

        Args:
            sessions: sessions that may answer, which are notified when the call is abandoned.
        """
        call = RemoteCall(service, request, on_reply, response)
        if self._somebody_answers():
            self._send(call, sessions)
        else:
            self._unsent[call] = sessions
            call.abandon = partial(self._unsent.pop, call, None)
            if self._listener is None:
                handler = self._link.callback(self._send_waiting)
                self._listener = self._querier.declare_matching_listener(handler)
            # A provider may have appeared between the check and the declaration.
            self._send_waiting()
        return call

    def _somebody_answers(self) -> bool:
        found: bool = self._querier.matching_status.matching  # type: ignore[attr-defined]  # zenoh returns a MatchingStatus, its stub says bool
        return found

    def _send_waiting(self, _status: zenoh.MatchingStatus | None = None) -> None:
        if self._unsent and self._somebody_answers():
            unsent, self._unsent = self._unsent, {}
            for call, sessions in unsent.items():
                self._send(call, sessions)

    def _send(self, call: RemoteCall, sessions: set[str]) -> None:
        self._number = number = self._number + 1
        token = zenoh.CancellationToken()
        call.abandon = partial(self._abandon, number, token, sessions)
        self._querier.get(
            self._link.callback(call.replied, call.over),
            payload=call.request.cdr(),
            attachment=Attachment(number, self._time_ns(), self._presence.gid).encode(),
            cancellation_token=token,
        )

    def _abandon(self, number: int, token: zenoh.CancellationToken, sessions: set[str]) -> None:
        token.cancel()
        note = _NOTE.pack(self._presence.gid, number)
        for session in sessions:
            self._link.session.put(abandoned_key(self._link.domain, session), note)

    def close(self) -> None:
        self._presence.end()
        if self._listener is not None:
            self._listener.undeclare()
        self._querier.undeclare()
