"""Events of endpoints, in virtual time: deadlines, liveliness, matching; and content filters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

if TYPE_CHECKING:
    from rwt_rclpy.endpoints.content_filter import ContentFilter


@pytest.fixture
def node(rclpy: Any, executor: Any) -> Any:
    made = rclpy.create_node("node")
    executor.add_node(made)
    return made


def spin(executor: Any, seconds: float) -> None:
    import rclpy

    executor.spin_until_future_complete(rclpy.task.Future(), seconds)


def int32() -> Any:
    from rwt_rclpy.messages.loaded import message_class

    return message_class("std_msgs/Int32")


def test_a_missed_deadline_is_told_on_both_sides(node: Any, executor: Any) -> None:
    from rclpy.duration import Duration
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
    from rclpy.qos import QoSProfile

    qos = QoSProfile(depth=1, deadline=Duration(seconds=1))
    offered: list[Any] = []
    requested: list[Any] = []
    publisher = node.create_publisher(
        int32(), "a", qos, event_callbacks=PublisherEventCallbacks(deadline=offered.append)
    )
    node.create_subscription(
        int32(),
        "a",
        lambda _: None,
        qos,
        event_callbacks=SubscriptionEventCallbacks(deadline=requested.append),
    )
    spin(executor, 5.0)
    assert not offered, "nothing was promised before the first message"
    publisher.publish(int32()())
    spin(executor, 0.9)
    assert not offered and not requested
    publisher.publish(int32()())
    spin(executor, 2.5)
    assert [each.total_count for each in offered] == [1, 2] == [each.total_count for each in requested]
    assert offered[-1].total_count_change == 1


def test_a_lease_that_ends_is_told_once(node: Any, executor: Any) -> None:
    from rclpy.duration import Duration
    from rclpy.event_handler import PublisherEventCallbacks
    from rclpy.qos import LivelinessPolicy, QoSProfile

    lost: list[Any] = []
    publisher = node.create_publisher(
        int32(),
        "a",
        QoSProfile(
            depth=1,
            liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
            liveliness_lease_duration=Duration(seconds=1),
        ),
        event_callbacks=PublisherEventCallbacks(liveliness=lost.append),
    )
    publisher.assert_liveliness()
    spin(executor, 0.8)
    publisher.assert_liveliness()
    spin(executor, 0.8)
    assert not lost
    spin(executor, 10.0)
    assert [each.total_count for each in lost] == [1]


def test_incompatible_endpoints_are_warned_of_once(
    node: Any, executor: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    from rclpy.qos import qos_profile_sensor_data

    heard: list[Any] = []
    publisher = node.create_publisher(int32(), "a", qos_profile_sensor_data)
    subscription = node.create_subscription(int32(), "a", heard.append, 1)
    publisher.publish(int32()())
    spin(executor, 1.0)
    node.create_publisher(int32(), "b", 1)
    spin(executor, 1.0)
    said = capsys.readouterr().err
    assert not heard and publisher.get_subscription_count() == subscription.get_publisher_count() == 0
    assert said.count("requesting incompatible QoS. No messages will be sent to it.") == 1
    assert said.count("offering incompatible QoS. No messages will be received from it.") == 1
    assert said.count("Last incompatible policy: RELIABILITY") == 2


class Pose:
    """Something with fields, as a message has them."""

    def __init__(self, x: float, name: str) -> None:
        self.position = self
        self.x = x
        self.name = name
        self.ok = True


def content_filter(text: str, *parameters: str) -> ContentFilter:
    from rwt_rclpy.endpoints.content_filter import ContentFilter

    return ContentFilter(text, parameters)


@pytest.mark.parametrize(
    ("text", "parameters", "fits"),
    [
        ("x = 1.5", (), True),
        ("position.x > 1 AND name = 'wheel_left'", (), True),
        ("x > 2 or name like 'wheel%'", (), True),
        ("name LIKE 'whee_'", (), False),
        ("name LIKE '%left'", (), True),
        ("name LIKE '%_'", (), True),
        ("name = %0", ("wheel_left",), True),
        ("name = %0", ("'wheel_left'",), True),
        ("x NOT BETWEEN 0 AND 1", (), True),
        ("NOT NOT x >= 0x1", (), True),
        ("ok = TRUE", (), True),
        ("ok <> true", (), False),
        ("1 < x", (), True),
    ],
)
def test_expressions(text: str, parameters: tuple[str, ...], fits: bool) -> None:
    assert content_filter(text, *parameters).matches(Pose(1.5, "wheel_left")) is fits


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected a field or a value, got the end"),
        ("x", "expected one of"),
        ("x = ", "expected a field or a value"),
        ("x = 1 y = 2", "expected AND, OR or the end, got y"),
        ("(x = 1", "expected '\\)'"),
        ("x = %3", "has %3, and 0 parameters were given"),
        ("x NOT LIKE 'a'", "expected BETWEEN after NOT"),
        ("x = ;", "cannot be read from character 3"),
        ("NOT " * 60 + "x = 1", "nested deeper than 50"),
        ("x = 1 OR " * 2000, "expected at most 10000"),
    ],
)
def test_what_is_no_expression_is_refused(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        content_filter(text)


def test_values_that_cannot_be_compared_are_told() -> None:
    with pytest.raises(ValueError, match="cannot be compared"):
        content_filter("name > 1").matches(Pose(1.0, "a"))
    with pytest.raises(ValueError, match="no field 'speed'"):
        content_filter("speed > 1").matches(Pose(1.0, "a"))


@given(st.text(alphabet="x.<>=%()'10_ ANDORNOTLIKEBETWEEN", max_size=60))
def test_any_text_is_an_expression_or_refused(text: str) -> None:
    try:
        content_filter(text, "1").matches(Pose(1.0, "a"))
    except ValueError:
        return


@pytest.mark.parametrize(
    "name",
    [
        "IncompatibleType", "QoSLivelinessChanged", "QoSLivelinessLost", "QoSMessageLost",
        "QoSOfferedDeadlineMissed", "QoSOfferedIncompatibleQoS", "QoSPublisherMatched",
        "QoSRequestedDeadlineMissed", "QoSRequestedIncompatibleQoS", "QoSSubscriptionMatched",
    ],
)  # fmt: skip
def test_what_callbacks_get_is_in_the_module_that_programs_import_it_from(rclpy: Any, name: str) -> None:
    from rclpy import event_handler

    assert isinstance(getattr(event_handler, f"{name}Info"), type)
