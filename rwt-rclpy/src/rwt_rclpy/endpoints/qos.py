"""`rclpy.qos`: quality of service, with rmw's numbers and profiles."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from enum import Enum, IntEnum
from typing import Any, Final

from rwt_participant import qos as program
from rwt_rclpy.clocks.duration import Duration, Infinite
from rwt_rclpy.release import FROM_KILTED

#: rmw's duration for "best available".
BEST_AVAILABLE_NS: Final = 9223372036854775806


class QoSPolicyKind(IntEnum):
    """Kinds of policies in events of incompatible ones."""

    INVALID = 1
    DURABILITY = 2
    DEADLINE = 4
    LIVELINESS = 8
    RELIABILITY = 16
    HISTORY = 32
    LIFESPAN = 64
    DEPTH = 128
    LIVELINESS_LEASE_DURATION = 256
    AVOID_ROS_NAMESPACE_CONVENTIONS = 512


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """Return the name of a policy."""
    return QoSPolicyKind(policy_kind).name


class InvalidQoSProfileException(Exception):
    """The profile lacks a required policy."""

    if not FROM_KILTED:

        def __init__(self, *args: object) -> None:
            super().__init__("Invalid QoSProfile", *args)


class QoSPolicyEnum(IntEnum):
    """Base of enumerated policies."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the short names of the values."""
        return [key.lower() for key in cls.__members__ if not key.startswith("RMW")]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """Return the value of a short name. Raises KeyError for unknown ones."""
        return cls[name.upper()].value

    @property
    def short_key(self) -> str:
        """Short name of the value."""
        return self.name.lower()


class HistoryPolicy(QoSPolicyEnum):
    """Policy for the samples that are kept."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(QoSPolicyEnum):
    """Policy for lost samples."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class DurabilityPolicy(QoSPolicyEnum):
    """Policy for samples that were published before a subscription."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class LivelinessPolicy(QoSPolicyEnum):
    """Policy for the liveliness of a publisher."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


class _OldName:
    """Deprecated name from before Foxy."""

    def __init__(self, old: str, new: str) -> None:
        self._old, self._new = old, new

    def __get__(self, instance: object, owner: Any) -> Any:
        name = owner.__name__
        warnings.warn(f"{name}.{self._old} is deprecated. Use {name}.{self._new} instead.", stacklevel=2)
        return owner[self._new]


for _policy, _word in (
    (HistoryPolicy, "HISTORY"),
    (ReliabilityPolicy, "RELIABILITY"),
    (DurabilityPolicy, "DURABILITY"),
    (LivelinessPolicy, "LIVELINESS"),
):
    for _name in tuple(_policy.__members__):
        if _name != "BEST_AVAILABLE":
            _old = f"RMW_QOS_POLICY_{_word}_{_name}"
            type.__setattr__(_policy, _old, _OldName(_old, _name))

QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy

DeadlineBestAvailable = Duration(nanoseconds=BEST_AVAILABLE_NS)
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=BEST_AVAILABLE_NS)  # rclpy's spelling

#: Default values of a profile. A duration of zero means none.
_DEFAULTS: Final[dict[str, Any]] = {
    "depth": 10,
    "reliability": ReliabilityPolicy.RELIABLE,
    "durability": DurabilityPolicy.VOLATILE,
    "lifespan": Duration(),
    "deadline": Duration(),
    "liveliness": LivelinessPolicy.SYSTEM_DEFAULT,
    "liveliness_lease_duration": Duration(),
    "avoid_ros_namespace_conventions": False,
}
ENUMS: Final[dict[str, type[QoSPolicyEnum]]] = {
    "history": HistoryPolicy,
    "reliability": ReliabilityPolicy,
    "durability": DurabilityPolicy,
    "liveliness": LivelinessPolicy,
}
DURATIONS: Final = frozenset({"lifespan", "deadline", "liveliness_lease_duration"})
POLICIES: Final = (
    "history", "depth", "reliability", "durability", "lifespan", "deadline", "liveliness",
    "liveliness_lease_duration", "avoid_ros_namespace_conventions",
)  # fmt: skip


class QoSProfile:
    """Policies of one endpoint, as attributes that check assigned values.

    Raises:
        InvalidQoSProfileException: neither history nor depth is given, or KEEP_LAST without a depth.
        AssertionError: a policy is unknown, or its value is of another type.
        TypeError: on Kilted, a policy is unknown.
    """

    __slots__ = tuple(f"_{name}" for name in POLICIES)

    history: HistoryPolicy
    depth: int
    reliability: ReliabilityPolicy
    durability: DurabilityPolicy
    lifespan: Duration
    deadline: Duration
    liveliness: LivelinessPolicy
    liveliness_lease_duration: Duration
    avoid_ros_namespace_conventions: bool

    def __init__(self, **kwargs: Any) -> None:
        unknown = set(kwargs) - set(POLICIES)
        if unknown:
            if FROM_KILTED:
                name = sorted(unknown)[0]
                raise TypeError(f"QoSProfile.__init__() got an unexpected keyword argument '{name}'")
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()}")
        if "history" not in kwargs:
            if "depth" not in kwargs:
                raise InvalidQoSProfileException("History and/or depth settings are required.")
            kwargs["history"] = HistoryPolicy.KEEP_LAST
        self.history = kwargs["history"]
        if self.history is HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        for name, default in _DEFAULTS.items():
            setattr(self, name, kwargs.get(name, default))

    def get_c_qos_profile(self) -> QoSProfile:
        """Return the profile itself, for code that passes it to rmw."""
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the policies by name."""
        return {name: getattr(self, name) for name in POLICIES}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and all(
            getattr(self, slot) == getattr(other, slot) for slot in self.__slots__
        )

    def __str__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{n}={getattr(self, n)}' for n in POLICIES)})"

    __repr__ = __str__


def _checked(name: str) -> property:
    slot = f"_{name}"

    def get(self: QoSProfile) -> Any:
        return getattr(self, slot)

    def put(self: QoSProfile, value: Any) -> None:
        if name in ENUMS:
            if not isinstance(value, int):
                raise AssertionError(f"{name}: expected one of {ENUMS[name].short_keys()}, got {value!r}")
            value = ENUMS[name](value)
        elif name in DURATIONS:
            if not isinstance(value, Duration):
                raise AssertionError(f"{name}: expected a rclpy.duration.Duration, got {value!r}")
        elif name == "depth":
            if not isinstance(value, int):
                raise AssertionError(f"depth: expected a number of samples, got {value!r}")
            if self.history is HistoryPolicy.KEEP_LAST and value == 0:
                warnings.warn(
                    "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
                    "This will be interpreted as SYSTEM_DEFAULT",
                    stacklevel=2,
                )
        elif not isinstance(value, bool):
            raise AssertionError(f"{name}: expected a bool, got {value!r}")
        setattr(self, slot, value)

    return property(get, put, doc=f"The policy {name}.")


for _name in POLICIES:
    setattr(QoSProfile, _name, _checked(_name))


def _profile(
    history: HistoryPolicy,
    depth: int,
    reliability: ReliabilityPolicy,
    durability: DurabilityPolicy,
    **others: Any,
) -> QoSProfile:
    return QoSProfile(history=history, depth=depth, reliability=reliability, durability=durability, **others)


_H, _R, _D = HistoryPolicy, ReliabilityPolicy, DurabilityPolicy
qos_profile_unknown = _profile(_H.UNKNOWN, 0, _R.UNKNOWN, _D.UNKNOWN, liveliness=LivelinessPolicy.UNKNOWN)
qos_profile_default = _profile(_H.KEEP_LAST, 10, _R.RELIABLE, _D.VOLATILE)
qos_profile_system_default = _profile(_H.SYSTEM_DEFAULT, 0, _R.SYSTEM_DEFAULT, _D.SYSTEM_DEFAULT)
qos_profile_sensor_data = _profile(_H.KEEP_LAST, 5, _R.BEST_EFFORT, _D.VOLATILE)
qos_profile_services_default = _profile(_H.KEEP_LAST, 10, _R.RELIABLE, _D.VOLATILE)
qos_profile_parameters = _profile(_H.KEEP_LAST, 1000, _R.RELIABLE, _D.VOLATILE)
qos_profile_parameter_events = _profile(_H.KEEP_LAST, 1000, _R.RELIABLE, _D.VOLATILE)
qos_profile_best_available = _profile(
    _H.KEEP_LAST,
    10,
    _R.BEST_AVAILABLE,
    _D.BEST_AVAILABLE,
    deadline=DeadlineBestAvailable,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
    liveliness_lease_duration=LivelinessLeaseDurationeBestAvailable,
)
qos_profile_action_status_default = _profile(_H.KEEP_LAST, 1, _R.RELIABLE, _D.TRANSIENT_LOCAL)
qos_profile_rosout_default = _profile(_H.KEEP_LAST, 1000, _R.RELIABLE, _D.TRANSIENT_LOCAL)
qos_profile_rosout_default.lifespan = Duration(seconds=10)


class QoSPresetProfiles(Enum):
    """Profiles by short name."""

    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available
    if FROM_KILTED:
        ROSOUT_DEFAULT = qos_profile_rosout_default

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the short names."""
        return [key.lower() for key in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """Return the profile of a short name. Raises KeyError for unknown ones."""
        found: QoSProfile = cls[name.upper()].value
        return found


class QoSCompatibility(IntEnum):
    """Compatibility of a publisher and a subscription."""

    OK = 0
    WARNING = 1
    ERROR = 2


#: Texts of rmw about a policy: if the subscription requests more than the publisher offers, if both leave it
#: open, and if one side does: the value that the other side has, and the sentence.
_RULES: Final = (
    (
        "reliability",
        "Best effort publisher and reliable subscription",
        "WARNING: Publisher reliability is {} and subscription reliability is {};",
        (ReliabilityPolicy.RELIABLE, "WARNING: Reliable subscription, but publisher is {};"),
        (ReliabilityPolicy.BEST_EFFORT, "WARNING: Best effort publisher, but subscription is {};"),
    ),
    (
        "durability",
        "Volatile publisher and transient local subscription",
        "WARNING: Publisher durabilty is {} and subscription durability is {};",
        (DurabilityPolicy.TRANSIENT_LOCAL, "WARNING: Transient local subscription, but publisher is {};"),
        (DurabilityPolicy.VOLATILE, "WARNING: Volatile publisher, but subscription is {};"),
    ),
    (
        "liveliness",
        "Publisher's liveliness is automatic and subscription's is manual by topic",
        "WARNING: Publisher liveliness is {} and subscription liveliness is {};",
        (
            LivelinessPolicy.MANUAL_BY_TOPIC,
            "WARNING: Subscription's liveliness is manual by topic, but publisher's is {};",
        ),
        (
            LivelinessPolicy.AUTOMATIC,
            "WARNING: Publisher's liveliness is automatic, but subscription's is {};",
        ),
    ),
)


def qos_check_compatible(
    publisher_qos: QoSProfile, subscription_qos: QoSProfile
) -> tuple[QoSCompatibility, str]:
    """Return the compatibility of a publisher and a subscription, with the reasons against it.

    A subscription may not request more than the publisher offers (`rmw_qos_profile_check_compatible`).
    """
    errors = _errors(publisher_qos, subscription_qos)
    if errors:
        return QoSCompatibility.ERROR, "".join(f"ERROR: {each};" for each in errors)
    warned = "".join(_open_policies(publisher_qos, subscription_qos))
    return (QoSCompatibility.WARNING if warned else QoSCompatibility.OK), warned


def _open_policies(publisher: QoSProfile, subscription: QoSProfile) -> Iterator[str]:
    for name, _, both, (requested, of_publisher), (offered, of_subscription) in _RULES:
        own, other = getattr(publisher, name), getattr(subscription, name)
        is_open = [each.name in ("SYSTEM_DEFAULT", "UNKNOWN") for each in (own, other)]
        if all(is_open):
            yield both.format(own.short_key, other.short_key)
        elif is_open[0] and other is requested:
            yield of_publisher.format(own.short_key)
        elif is_open[1] and own is offered:
            yield of_subscription.format(other.short_key)


def _errors(publisher: QoSProfile, subscription: QoSProfile) -> list[str]:
    found = {
        name: [error]
        for name, error, _, (requested, _), (offered, _) in _RULES
        if getattr(publisher, name) is offered and getattr(subscription, name) is requested
    }
    found["deadline"] = _shorter("deadline", publisher.deadline, subscription.deadline, " deadline")
    leases = publisher.liveliness_lease_duration, subscription.liveliness_lease_duration
    found["lease"] = _shorter("liveliness lease duration", *leases, "")
    order = ("reliability", "durability", "deadline", "liveliness", "lease")
    return [error for name in order for error in found.get(name, ())]


def _shorter(name: str, offered: Duration, requested: Duration, noun: str) -> list[str]:
    if requested.nanoseconds and not offered.nanoseconds:
        return [f"Subscription has a {name}, but publisher does not"]
    if requested.nanoseconds and requested < offered:
        return [f"Subscription {name} is less than publisher{noun}"]
    return []


def _seconds(duration: Duration) -> float | None:
    """Return the seconds of a finite duration; None for others."""
    span = duration.nanoseconds
    return None if span in (0, BEST_AVAILABLE_NS, 2**63 - 1) else min(span / 1e9, program.LONGEST_SECONDS)


def graph_qos(profile: QoSProfile) -> program.QoS:
    """Return the profile as the graph's quality of service; what it leaves open is rmw's default."""
    history, reliability, durability = program.History, program.Reliability, program.Durability
    return program.QoS(
        history=history.__members__.get(profile.history.name, history.KEEP_LAST),
        depth=min(profile.depth or 1, program.MOST_DEPTH),
        reliability=reliability.__members__.get(profile.reliability.name, reliability.RELIABLE),
        durability=durability.__members__.get(profile.durability.name, durability.VOLATILE),
        deadline=_seconds(profile.deadline),
        lifespan=_seconds(profile.lifespan),
        manual_liveliness=profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC,
        lease=_seconds(profile.liveliness_lease_duration),
    )


def profile_of(qos: program.QoS) -> QoSProfile:
    """Return the quality of service of an endpoint in the graph, whose history others do not see in ROS 2."""
    return QoSProfile(
        history=HistoryPolicy.UNKNOWN,
        depth=0,
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
        deadline=_duration(qos.deadline),
        lifespan=_duration(qos.lifespan),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC if qos.manual_liveliness else LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=_duration(qos.lease),
    )


def _duration(seconds: float | None) -> Duration:
    return Duration(seconds=seconds) if seconds else Infinite
