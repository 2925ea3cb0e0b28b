"""QoS in the text of liveliness tokens (design, "Graph Cache").

`<reliability>:<durability>:<history>,<depth>:<deadline>:<lifespan>:<liveliness>,<lease>`, where the three
durations are `<seconds>,<nanoseconds>`. Numbers are those of `rmw_qos_profile_t`. Default values of rmw_zenoh
are left empty: reliable, volatile, keep-last 42, no deadline, no lifespan, automatic liveliness. ROS's
default profile is `::,10:,:,:,,`.
"""

from __future__ import annotations

from rwt_graph.errors import WireError
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import LONGEST_SECONDS, MOST_DEPTH, Durability, History, QoS, Reliability

#: Depth that is left empty.
DEFAULT_DEPTH = 42

_LARGEST = 10**18

_RELIABILITY = {"": Reliability.RELIABLE, "0": Reliability.RELIABLE, "1": Reliability.RELIABLE,
                "2": Reliability.BEST_EFFORT, "3": Reliability.RELIABLE,
                "4": Reliability.BEST_AVAILABLE}  # fmt: skip
_DURABILITY = {"": Durability.VOLATILE, "0": Durability.VOLATILE, "1": Durability.TRANSIENT_LOCAL,
               "2": Durability.VOLATILE, "3": Durability.VOLATILE,
               "4": Durability.BEST_AVAILABLE}  # fmt: skip
_HISTORY = {"": History.KEEP_LAST, "0": History.KEEP_LAST, "1": History.KEEP_LAST,
            "2": History.KEEP_ALL, "3": History.KEEP_LAST}  # fmt: skip


def encode(qos: QoS) -> str:
    """Encode a QoS; "best available" policies are written as the default."""
    reliability = "2" if qos.reliability is Reliability.BEST_EFFORT else ""
    durability = "1" if qos.durability is Durability.TRANSIENT_LOCAL else ""
    history = "2" if qos.history is History.KEEP_ALL else ""
    depth = "" if qos.depth == DEFAULT_DEPTH else str(qos.depth)
    return (
        f"{reliability}:{durability}:{history},{depth}:{_duration(qos.deadline)}:{_duration(qos.lifespan)}:,,"
    )


def decode(text: str) -> QoS:
    """Decode a QoS. Raises :exc:`WireError`."""
    parts = text.split(":")
    fields = [part.split(",") for part in parts]
    if [len(field) for field in fields] != [1, 1, 2, 2, 2, 3]:
        raise WireError(f"{text[:80]!r} is not a QoS like '::,10:,:,:,,'")
    (reliability,), (durability,), (history, depth), deadline, lifespan, _liveliness = fields
    try:
        return QoS(
            _HISTORY[history],
            min(_number(depth, DEFAULT_DEPTH), MOST_DEPTH),
            _RELIABILITY[reliability],
            _DURABILITY[durability],
            _seconds(deadline),
            _seconds(lifespan),
        )
    except (KeyError, ValueError):
        raise WireError(f"{text[:80]!r} is not a QoS: a part of it is not a number of the list") from None


def _duration(seconds: float | None) -> str:
    if not seconds:
        return ","
    whole, nanoseconds = divmod(round(seconds * NANOSECONDS), NANOSECONDS)
    return f"{whole},{nanoseconds}"


def _seconds(parts: list[str]) -> float | None:
    if parts == ["", ""]:
        return None
    total = _number(parts[0], 0) * NANOSECONDS + _number(parts[1], 0)
    return total / NANOSECONDS if 0 < total <= LONGEST_SECONDS * NANOSECONDS else None


def _number(text: str, default: int) -> int:
    if not text:
        return default
    if not text.isascii() or not text.isdigit() or len(text) > 20:
        raise ValueError(text)
    return min(int(text), _LARGEST)
