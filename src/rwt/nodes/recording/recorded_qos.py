"""QoS of publishers as recordings note it."""

from __future__ import annotations

import re
from typing import Final

from rwt_participant.qos import LATCHED, MOST_DEPTH, Durability, History, QoS, Reliability

_HISTORIES: Final = {"2": History.KEEP_ALL, "keep_all": History.KEEP_ALL}
_RELIABILITIES: Final = {"2": Reliability.BEST_EFFORT, "best_effort": Reliability.BEST_EFFORT}
_DURABILITIES: Final = {"1": Durability.TRANSIENT_LOCAL, "transient_local": Durability.TRANSIENT_LOCAL}
_ENTRY: Final = re.compile(r"^[- ] +(history|depth|reliability|durability): *\"?(\w+)", re.MULTILINE)


def read_offered_qos(metadata: dict[str, str]) -> tuple[QoS, ...]:
    """Return the profiles in a channel's metadata: rosbag2's, or ROS 1's latching. Invalid ones become the
    default.
    """
    if metadata.get("latching") == "1":
        return (LATCHED,)
    text = metadata.get("offered_qos_profiles", "")
    profiles = re.split(r"^(?=- )", text, flags=re.MULTILINE)
    return tuple(_profile(dict(_ENTRY.findall(profile))) for profile in profiles if _ENTRY.search(profile))


def _profile(entries: dict[str, str]) -> QoS:
    depth = entries.get("depth", "10")
    return QoS(
        history=_HISTORIES.get(entries.get("history", ""), History.KEEP_LAST),
        depth=min(int(depth), MOST_DEPTH) if depth.isdecimal() else 10,
        reliability=_RELIABILITIES.get(entries.get("reliability", ""), Reliability.RELIABLE),
        durability=_DURABILITIES.get(entries.get("durability", ""), Durability.VOLATILE),
    )


def combined(offered_qos: tuple[QoS, ...]) -> QoS:
    """Merge the profiles of several publishers into one that retains whatever any of them did.

    Transient-local if any is, with the sum of their depths.
    """
    kept = [qos for qos in offered_qos if qos.durability is Durability.TRANSIENT_LOCAL]
    if not kept:
        return offered_qos[0] if offered_qos else QoS()
    history = History.KEEP_ALL if any(qos.history is History.KEEP_ALL for qos in kept) else History.KEEP_LAST
    depth = min(sum(max(1, qos.depth) for qos in kept), MOST_DEPTH)
    return QoS(history, depth, kept[0].reliability, Durability.TRANSIENT_LOCAL)
