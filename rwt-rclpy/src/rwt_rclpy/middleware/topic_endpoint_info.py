"""`rclpy.topic_endpoint_info` and `rclpy.type_hash`: description of an endpoint of a topic."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from enum import IntEnum

from rwt_rclpy.endpoints.qos import QoSProfile, qos_profile_unknown

TYPE_HASH_SIZE = 32


class TopicEndpointTypeEnum(IntEnum):
    """Kind of an endpoint."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


class TypeHash:
    """Hash of a type; `version` 1 is RIHS01."""

    __slots__ = ("value", "version")

    def __init__(self, version: int = -1, value: bytes = bytes(TYPE_HASH_SIZE)) -> None:
        if not isinstance(version, int):
            raise AssertionError(f"version: expected an int, got {version!r}")
        if not isinstance(value, bytes):
            raise AssertionError(f"value: expected bytes, got {value!r}")
        self.version = version
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TypeHash) and (self.version, self.value) == (other.version, other.value)

    def __hash__(self) -> int:
        return hash((self.version, self.value))

    def __str__(self) -> str:
        if self.version <= 0 or len(self.value) != TYPE_HASH_SIZE:
            return "INVALID"
        return f"RIHS{self.version:02}_{self.value.hex()}"

    @classmethod
    def from_text(cls, text: str) -> TypeHash:
        """Return the hash of a text ``RIHS01_…``."""
        version, _, digits = text.partition("_")
        return cls(int(version.removeprefix("RIHS")), bytes.fromhex(digits))


def endpoint_gid(node: str, topic: str, kind: TopicEndpointTypeEnum, number: int = 0) -> bytes:
    """Return the id of an endpoint, the `number`th of its kind that the node has on the topic."""
    return hashlib.sha256(f"{node} {topic} {int(kind)} {number}".encode()).digest()[:16]


@dataclass
class TopicEndpointInfo:
    """Publisher or subscription."""

    node_name: str = ""
    node_namespace: str = ""
    topic_type: str = ""
    topic_type_hash: TypeHash = field(default_factory=TypeHash)
    endpoint_type: TopicEndpointTypeEnum = TopicEndpointTypeEnum.INVALID
    endpoint_gid: list[int] = field(default_factory=list)
    qos_profile: QoSProfile = field(default_factory=lambda: qos_profile_unknown)

    def __setattr__(self, name: str, value: object) -> None:
        kinds: dict[str, tuple[type, ...]] = {
            "node_name": (str,),
            "node_namespace": (str,),
            "topic_type": (str,),
            "topic_type_hash": (TypeHash, dict),
            "endpoint_type": (TopicEndpointTypeEnum, int),
            "endpoint_gid": (list,),
            "qos_profile": (QoSProfile, dict),
        }
        if not isinstance(value, kinds[name]):
            raise AssertionError(f"{name}: expected {kinds[name][0].__name__}, got {value!r}")
        if isinstance(value, dict):
            value = TypeHash(**value) if name == "topic_type_hash" else QoSProfile(**value)
        if name == "endpoint_type" and isinstance(value, int):
            value = TopicEndpointTypeEnum(value)
        object.__setattr__(self, name, value)

    def __str__(self) -> str:
        qos = self.qos_profile
        depth = f" ({qos.depth})" if qos.history.name == "KEEP_LAST" else ""
        return "\n".join(
            [
                f"Node name: {self.node_name}",
                f"Node namespace: {self.node_namespace}",
                f"Topic type: {self.topic_type}",
                f"Topic type hash: {self.topic_type_hash}",
                f"Endpoint type: {self.endpoint_type.name}",
                f"GID: {'.'.join(f'{octet:02x}' for octet in self.endpoint_gid)}",
                "QoS profile:",
                f"  Reliability: {qos.reliability.name}",
                f"  History (Depth): {qos.history.name}{depth}",
                f"  Durability: {qos.durability.name}",
                f"  Lifespan: {qos.lifespan}",
                f"  Deadline: {qos.deadline}",
                f"  Liveliness: {qos.liveliness.name}",
                f"  Liveliness lease duration: {qos.liveliness_lease_duration}",
            ]
        )
