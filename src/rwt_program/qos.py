"""Quality of service: how a topic treats late joiners and slow readers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class History(Enum):
    """Which samples are kept."""

    KEEP_LAST = "keep_last"
    KEEP_ALL = "keep_all"


class Reliability(Enum):
    """Whether a sample may be lost on the way."""

    RELIABLE = "reliable"
    BEST_EFFORT = "best_effort"
    BEST_AVAILABLE = "best_available"


class Durability(Enum):
    """Whether a late joiner receives what was published before."""

    VOLATILE = "volatile"
    TRANSIENT_LOCAL = "transient_local"
    BEST_AVAILABLE = "best_available"


@dataclass(frozen=True, slots=True)
class QoS:
    """The policies of ROS 2.

    Attributes:
        depth: samples kept with `History.KEEP_LAST`.
        deadline: longest expected time between two samples, seconds; None and 0 are infinite.
        lifespan: age in seconds after which a sample is no longer delivered; None and 0 are infinite.
    """

    history: History = History.KEEP_LAST
    depth: int = 10
    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    deadline: float | None = None
    lifespan: float | None = None


#: ROS 2's default profile.
DEFAULT_QOS = QoS()

#: ROS 1's `latch=True`: the last sample is kept for whoever joins late.
LATCHED = QoS(depth=1, durability=Durability.TRANSIENT_LOCAL)

#: What a subscriber asks that wants whatever the publishers offer.
BEST_AVAILABLE = QoS(reliability=Reliability.BEST_AVAILABLE, durability=Durability.BEST_AVAILABLE)

#: ROS 2's profile for sensor streams.
SENSOR_DATA = QoS(depth=5, reliability=Reliability.BEST_EFFORT)
