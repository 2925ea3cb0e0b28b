"""Quality of service: how a topic treats late joiners and slow readers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from rwt_participant.errors import InvalidQoS

#: Maximum history depth of a publisher or a subscription, in samples.
MOST_DEPTH: Final = 1_000_000

#: Maximum deadline and lifespan in seconds: what fits 64 bits of nanoseconds, as in rmw.
LONGEST_SECONDS: Final = 9_223_372_036


class History(Enum):
    """Samples that are kept."""

    KEEP_LAST = "keep_last"
    KEEP_ALL = "keep_all"


class Reliability(Enum):
    """Guarantee of delivery."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best_effort"
    BEST_AVAILABLE = "best_available"


class Durability(Enum):
    """Retention of samples for late joiners."""

    VOLATILE = "volatile"
    TRANSIENT_LOCAL = "transient_local"
    BEST_AVAILABLE = "best_available"


@dataclass(frozen=True, slots=True)
class QoS:
    """Policies of ROS 2.

    Attributes:
        depth: samples kept with `History.KEEP_LAST`, at most :data:`MOST_DEPTH`; 0 counts as 1.
        deadline: longest expected time between two samples, in seconds, at most :data:`LONGEST_SECONDS`; None
            and 0 are infinite.
        lifespan: age after which a sample is no longer delivered, likewise.
        manual_liveliness: True if a publisher asserts its liveliness itself.
        lease: longest time between two assertions of a publisher's liveliness, like the deadline.

    Raises:
        InvalidQoS: a number is out of its range.
    """

    history: History = History.KEEP_LAST
    depth: int = 10
    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    deadline: float | None = None
    lifespan: float | None = None
    manual_liveliness: bool = False
    lease: float | None = None

    def __post_init__(self) -> None:
        _require("depth", self.depth, MOST_DEPTH, "samples")
        _require("deadline", self.deadline or 0, LONGEST_SECONDS, "seconds")
        _require("lifespan", self.lifespan or 0, LONGEST_SECONDS, "seconds")
        _require("lease", self.lease or 0, LONGEST_SECONDS, "seconds")


def _require(policy: str, value: float, most: int, unit: str) -> None:
    # Written so that NaN is rejected, too.
    if not 0 <= value <= most:
        # An integer may be too large for every format.
        shown = "a very large number" if 2**63 < abs(value) < math.inf else f"{value:g}"
        raise InvalidQoS(f"{policy} is a number from 0 to {most} {unit}, not {shown}")


def incompatible_policies(offered: QoS, requested: QoS) -> tuple[str, ...]:
    """Return the policies by which a subscription requests more than a publisher offers.

    If there is none, the publisher's samples reach the subscription. "Best available" adapts to the peer.
    """
    exceeded = {
        "deadline": _is_longer(offered.deadline, requested.deadline),
        "liveliness": (requested.manual_liveliness and not offered.manual_liveliness)
        or _is_longer(offered.lease, requested.lease),
        "durability": (offered.durability, requested.durability)
        == (Durability.VOLATILE, Durability.TRANSIENT_LOCAL),
        "reliability": (offered.reliability, requested.reliability)
        == (Reliability.BEST_EFFORT, Reliability.RELIABLE),
    }
    return tuple(name for name, is_exceeded in exceeded.items() if is_exceeded)


def _is_longer(offered: float | None, requested: float | None) -> bool:
    return (offered or math.inf) > (requested or math.inf)


#: ROS 2's default profile.
DEFAULT_QOS = QoS()

#: ROS 1's `latch=True`: the last sample is retained for late joiners.
LATCHED = QoS(depth=1, durability=Durability.TRANSIENT_LOCAL)

#: Request of a subscriber that accepts whatever the publishers offer.
BEST_AVAILABLE = QoS(reliability=Reliability.BEST_AVAILABLE, durability=Durability.BEST_AVAILABLE)

#: ROS 2's profile for sensor streams.
SENSOR_DATA = QoS(depth=5, reliability=Reliability.BEST_EFFORT)
