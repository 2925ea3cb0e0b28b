"""`rclpy.qos_overriding_options`: quality of service that parameters can change."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from rwt_rclpy.clocks.duration import Duration
from rwt_rclpy.endpoints.publisher import Publisher
from rwt_rclpy.endpoints.qos import DURATIONS, ENUMS, QoSPolicyEnum, QoSPolicyKind, QoSProfile
from rwt_rclpy.endpoints.subscription import Subscription
from rwt_rclpy.exceptions import ParameterAlreadyDeclaredException
from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

QosCallbackResult = message_class("rcl_interfaces/SetParametersResult")
QosCallbackType = Callable[[QoSProfile], Any]


class InvalidQosOverridesError(Exception):
    """The program's callback rejected the profile."""


class QoSOverridingOptions:
    """Policies of an endpoint that parameters may override.

    Args:
        policy_kinds: policies.
        callback: rejects a profile by returning an unsuccessful `SetParametersResult`.
        entity_id: distinguishes endpoints of one topic.
    """

    def __init__(
        self,
        policy_kinds: Iterable[QoSPolicyKind],
        *,
        callback: QosCallbackType | None = None,
        entity_id: str | None = None,
    ) -> None:
        self.policy_kinds = tuple(policy_kinds)
        self.callback = callback
        self.entity_id = entity_id

    @classmethod
    def with_default_policies(
        cls, *, callback: QosCallbackType | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Return options for history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def _declare_qos_parameters(
    entity_type: type[Publisher] | type[Subscription],
    node: Node,
    topic_name: str,
    qos: QoSProfile,
    options: QoSOverridingOptions,
) -> None:
    """Declare the parameters of an endpoint, and apply them to its profile.

    Raises:
        InvalidQosOverridesError: the program's callback rejects it.
        RuntimeError: a parameter names no such policy.
        TypeError: `entity_type` is neither the class of publishers nor that of subscriptions.
    """
    if not issubclass(entity_type, (Publisher, Subscription)):
        raise TypeError("Argument `entity_type` should be a subclass of Publisher or Subscription")
    entity = "publisher" if issubclass(entity_type, Publisher) else "subscription"
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    of = f"for {entity} `{topic_name}` with id `{options.entity_id}`"
    for kind in options.policy_kinds:
        if entity == "subscription" and kind is QoSPolicyKind.LIFESPAN:
            continue
        policy = kind.name.lower()
        name = f"qos_overrides.{topic_name}.{entity}{suffix}.{policy}"
        descriptor: Any = message_class("rcl_interfaces/ParameterDescriptor")(
            description=f"{policy} {of}", read_only=True
        )
        try:
            parameter = node.declare_parameter(name, _get_qos_policy_parameter(qos, kind), descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        setattr(qos, policy, _value(policy, parameter.value))
    if options.callback is not None:
        result = options.callback(qos)
        if not result.successful:
            raise InvalidQosOverridesError(f"Provided QoS overrides {of}, are not valid: {result.reason}")


def _get_qos_policy_parameter(qos: QoSProfile, kind: QoSPolicyKind) -> Any:
    policy = getattr(qos, kind.name.lower())
    if isinstance(policy, QoSPolicyEnum):
        if policy.name == "UNKNOWN":
            raise ValueError("User provided QoS profile is invalid")
        return policy.name.lower()
    return policy.nanoseconds if isinstance(policy, Duration) else policy


def _value(policy: str, value: Any) -> Any:
    if policy in ENUMS:
        try:
            return ENUMS[policy][value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{policy}`: `{value}`") from None
    return Duration(nanoseconds=value) if policy in DURATIONS else value
