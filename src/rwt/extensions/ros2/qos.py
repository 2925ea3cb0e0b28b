"""Quality of service in the form of `rclpy`, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from rclpy.duration import Duration, Infinite
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import LONGEST_SECONDS, MOST_DEPTH, Durability, History, QoS, Reliability

#: Policies of `rclpy` that are not those of a default profile.
_HISTORIES = {HistoryPolicy.KEEP_ALL: History.KEEP_ALL}
_RELIABILITIES = {ReliabilityPolicy.BEST_EFFORT: Reliability.BEST_EFFORT}
_DURABILITIES = {DurabilityPolicy.TRANSIENT_LOCAL: Durability.TRANSIENT_LOCAL}


def to_ros(qos: QoS) -> Any:
    """Return the profile for an endpoint; whatever is "best available" becomes ROS 2's default."""
    transient = qos.durability is Durability.TRANSIENT_LOCAL
    best_effort = qos.reliability is Reliability.BEST_EFFORT
    profile = QoSProfile(
        history=HistoryPolicy.KEEP_ALL if qos.history is History.KEEP_ALL else HistoryPolicy.KEEP_LAST,
        depth=max(1, qos.depth),
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if transient else DurabilityPolicy.VOLATILE,
        deadline=_duration(qos.deadline),
        lifespan=_duration(qos.lifespan),
    )
    return profile.get_c_qos_profile()


def _duration(seconds: float | None) -> Any:
    return Duration(nanoseconds=round(seconds * NANOSECONDS)) if seconds else Infinite


def from_ros(policies: Mapping[str, Any]) -> QoS:
    """Return the profile of a discovered endpoint. Depth 0 means that the middleware does not announce it."""
    return QoS(
        history=_HISTORIES.get(policies["history"], History.KEEP_LAST),
        depth=min(policies["depth"], MOST_DEPTH),
        reliability=_RELIABILITIES.get(policies["reliability"], Reliability.RELIABLE),
        durability=_DURABILITIES.get(policies["durability"], Durability.VOLATILE),
        deadline=_seconds(policies["deadline"]),
        lifespan=_seconds(policies["lifespan"]),
        manual_liveliness=policies["liveliness"] == LivelinessPolicy.MANUAL_BY_TOPIC,
        lease=_seconds(policies["liveliness_lease_duration"]),
    )


def adapted(offered: QoS, requests: Iterable[QoS], *, may_retain: bool = True) -> QoS:
    """Return the policies of a publisher that subscriptions of other processes receive from.

    A publisher that retains samples, or sends them reliably, also reaches those that do not request it.
    Deadline and liveliness are promises of the program that publishes, and stay.

    Args:
        may_retain: False to leave durability as it is.
    """
    requests = tuple(requests)
    if may_retain and any(each.durability is Durability.TRANSIENT_LOCAL for each in requests):
        offered = replace(offered, durability=Durability.TRANSIENT_LOCAL)
    if any(each.reliability is Reliability.RELIABLE for each in requests):
        offered = replace(offered, reliability=Reliability.RELIABLE)
    return offered


def _seconds(duration: Any) -> float | None:
    seconds = duration.nanoseconds / NANOSECONDS
    return seconds if 0 < seconds < LONGEST_SECONDS else None
