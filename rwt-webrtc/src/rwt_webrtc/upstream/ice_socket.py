"""Socket of an ICE agent that hands to aioice only what was validated.

Borrows :class:`aioice.ice.StunProtocol`, which answers requests without credentials, takes what it cannot
parse for data, and receives from any address. Private names, and why each is needed:

* ``Transaction.__addr``: the address to which a request was sent; a response from another one is no proof.
"""

from __future__ import annotations

import logging
from typing import Any, Final

from aioice import Connection, stun
from aioice.ice import StunProtocol

from rwt_webrtc.packets.ice_guard import DATAGRAM_BYTES, IceGuard
from rwt_webrtc.packets.stun import BadStun, StunClass, check_stun

logger = logging.getLogger("rwt_webrtc.transport")

_STUN_BYTES: Final = 4
_DTLS_BYTES: Final = 20
_MEDIA_BYTES: Final = 128
"""First bytes from which on a datagram is not STUN, is DTLS, and is SRTP or SRTCP (RFC 7983)."""


class GuardedSocket(StunProtocol):
    """Socket of an ICE agent."""

    def __init__(self, agent: Connection, guard: IceGuard) -> None:
        super().__init__(agent)
        self._guard = guard

    def datagram_received(self, data: bytes | str, addr: tuple[Any, ...]) -> None:
        """Receive a datagram; drop it unless it is valid and from an address of the peer."""
        assert isinstance(data, bytes)
        source = (addr[0], addr[1])
        if not data or len(data) > DATAGRAM_BYTES:
            return
        if data[0] < _STUN_BYTES:
            self._receive_stun(data, source)
        elif (
            self._guard.is_source(source)
            and data[0] >= _DTLS_BYTES
            and (data[0] < _MEDIA_BYTES or self._guard.admit_media(data))
        ):
            self.receiver.data_received(data, self.local_candidate.component)

    def _receive_stun(self, data: bytes, source: tuple[str, int]) -> None:
        agent = self.receiver
        try:
            head = check_stun(data)
            if head.kind is StunClass.REQUEST:
                if head.username.startswith(f"{agent.local_username}:".encode()):
                    self._receive_request(stun.parse_message(data), source, len(data))
                return
            transaction: Any = self.transactions.get(head.transaction)
            # A response from another address does not prove that this one receives anything.
            if transaction is not None and source == transaction._Transaction__addr:
                message = stun.parse_message(data)
                if message.check_message_integrity((agent.remote_password or "").encode()):
                    self._guard.answered(source)
                transaction.response_received(message, source)
        except (BadStun, ValueError) as bad:
            logger.debug("discarded %s", bad)

    def _receive_request(self, message: stun.Message, source: tuple[str, int], size: int) -> None:
        """Hand over a request with valid credentials; one without is not answered, since its sender is
        unknown.
        """
        agent = self.receiver
        is_valid = message.check_message_integrity(agent.local_password.encode())
        if is_valid and self._guard.admit_request(source, size):
            agent.request_received(message, source, self)

    def send_stun(self, message: stun.Message, addr: tuple[str, int]) -> None:
        """Send a message. One over the limits is dropped, and counts as lost."""
        data = bytes(message)
        if message.message_class != stun.Class.REQUEST:
            is_admitted = self._guard.admit_response(addr, len(data))
        else:
            # Only checks have credentials of the other side; questions to a STUN server do not.
            is_admitted = "USERNAME" not in message.attributes or self._guard.admit_check(addr, len(data))
        if is_admitted:
            self.transport.sendto(data, addr)
