"""How much one client may have open, and how fast it may send; each refusal names its setting."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.errors import Refused

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_bridge.settings import BridgeLimits
    from rwt_protocol.transport import Frame


class MessageRate:
    """Counts one client's messages: `burst` at once, and `rate` a second in the long run.

    It is a token bucket kept as one time: the moment at which the bucket would be full again.
    """

    __slots__ = ("_full", "_interval", "_tolerance")

    def __init__(self, rate: int, burst: int) -> None:
        self._interval = 1 / rate
        # Half a message more, since sums of floats round.
        self._tolerance = (burst + 0.5) / rate
        self._full = float("-inf")

    def take(self, now: float) -> bool:
        """Whether one more message is within the bounds; `now` in seconds on a clock that never goes back."""
        full = self._full
        full = (full if full > now else now) + self._interval
        if full - now > self._tolerance:
            return False
        self._full = full
        return True


def message_rate(limits: BridgeLimits) -> MessageRate | None:
    """What counts a new client's messages; None where any number is fine."""
    if not limits.messages_per_second:
        return None
    return MessageRate(limits.messages_per_second, limits.messages_burst)


def require_subscription(peer: Peer) -> None:
    """Refuse one more subscription than a client may have.

    Raises:
        Refused: it has as many as it may.
    """
    held = sum(subscription.count for subscription in peer.subscriptions.values())
    _require("subscribe", "subscriptions", held, peer.bridge.limits.subscriptions)


def require_advertisement(peer: Peer, op: str) -> None:
    """Refuse one more topic, service or action than a client may offer.

    Raises:
        Refused: it offers as many as it may.
    """
    held = sum(map(len, peer.advertised.values())) + len(peer.implicit)
    held += len(peer.services) + len(peer.actions)
    _require(op, "advertisements", held, peer.bridge.limits.advertisements)


def require_call(peer: Peer, op: str) -> None:
    """Refuse one more call or goal than a client may have under way.

    Raises:
        Refused: it waits for as many as it may.
    """
    _require(op, "calls", len(peer.calls) + len(peer.goals), peer.bridge.limits.calls)


def too_large(peer: Peer, frame: Frame, *, in_pieces: bool = False) -> str | None:
    """Why a message may not be sent to a client, or not `in_pieces`; None when it may."""
    carried = peer.info.max_message_size
    if carried and frame.size > carried and not in_pieces:
        return (
            f"a message of {frame.size} bytes, and {peer.info.transport} carries {carried}: ask for "
            "`fragment_size`, or connect by tcp"
        )
    most = peer.bridge.limits.outgoing_message_bytes
    if frame.size <= most:
        return None
    return f"a message of {frame.size} bytes, and {most} is the limit (limits.outgoing_message_bytes)"


def _require(op: str, setting: str, held: int, most: int) -> None:
    if held >= most:
        raise Refused(f"{op}: this client has {held} {setting}, and {most} is the limit (limits.{setting})")
