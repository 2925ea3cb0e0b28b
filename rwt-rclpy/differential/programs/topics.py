"""Publishers and subscriptions."""

from typing import Any

import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Int32, String

from differential.steps import QUIET_S, node, public, spinner, tell, wait


def publish_and_receive() -> None:
    """Messages arrive in order."""
    with node() as made, spinner(made) as spin:
        received: list[str] = []
        publisher = made.create_publisher(String, "topic", 10)
        made.create_subscription(String, "topic", lambda m: received.append(m.data), 10)
        spin(lambda: publisher.get_subscription_count())
        for text in ("a", "b", "c"):
            publisher.publish(String(data=text))
        spin(lambda: len(received) == 3)
        print(received)


def publish_serialized() -> None:
    """Bytes are published as they are."""
    with node() as made, spinner(made) as spin:
        received: list[str] = []
        publisher = made.create_publisher(String, "topic", 10)
        made.create_subscription(String, "topic", lambda m: received.append(m.data), 10)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(serialize_message(String(data="a")))
        spin(lambda: received)
        print(received)


def receive_serialized() -> None:
    """A raw subscription receives bytes."""
    with node() as made, spinner(made) as spin:
        received: list[bytes] = []
        publisher = made.create_publisher(String, "topic", 10)
        made.create_subscription(String, "topic", received.append, 10, raw=True)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(String(data="a"))
        spin(lambda: received)
        print(type(received[0]).__name__, deserialize_message(received[0], String))


def publish_wrong_type() -> None:
    """Messages of another class are rejected."""
    with node() as made:
        publisher = made.create_publisher(String, "topic", 10)
        for wrong in (Int32(), "text", None, 1, {"data": "a"}):
            tell(repr(wrong), publisher.publish, wrong)


def publish_after_destroy() -> None:
    """A destroyed publisher rejects messages."""
    with node() as made:
        publisher = made.create_publisher(String, "topic", 10)
        print(made.destroy_publisher(publisher))
        tell("publish", publisher.publish, String())
        tell("count", publisher.get_subscription_count)
        tell("name", lambda: publisher.topic_name)
        print(made.destroy_publisher(publisher), list(made.publishers)[2:])


def attributes_of_publisher() -> None:
    """Public attributes."""
    with node(namespace="/ns") as made:
        publisher = made.create_publisher(String, "topic", 10)
        print(
            publisher.topic, publisher.topic_name, publisher.msg_type.__name__, len(publisher.event_handlers)
        )
        print(public(publisher))


def attributes_of_subscription() -> None:
    """Public attributes."""
    with node(namespace="/ns") as made:
        subscription = made.create_subscription(String, "topic", print, 10)
        print(subscription.topic, subscription.topic_name, subscription.msg_type.__name__, subscription.raw)
        print(public(subscription))


def message_info() -> None:
    """A callback with two parameters receives metadata."""
    with node() as made, spinner(made) as spin:
        received: list[Any] = []
        publisher = made.create_publisher(Int32, "topic", 10)
        made.create_subscription(Int32, "topic", lambda m, i: received.append((m.data, i)), 10)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(Int32(data=1))
        publisher.publish(Int32(data=2))
        spin(lambda: len(received) == 2)
        for data, info in received:
            print(data, type(info).__name__, sorted(info))
            print(info["source_timestamp"] > 10**18, info["received_timestamp"] >= info["source_timestamp"])
            print(info["publication_sequence_number"], info["reception_sequence_number"])


def message_info_gid() -> None:
    """The metadata names the publisher."""
    with node() as made, spinner(made) as spin:
        received: list[Any] = []
        publishers = [made.create_publisher(Int32, "topic", 10) for _ in range(2)]
        made.create_subscription(Int32, "topic", lambda m, i: received.append(i.get("publisher_gid")), 10)
        spin(lambda: all(each.get_subscription_count() for each in publishers))
        for publisher in publishers:
            publisher.publish(Int32())
            publisher.publish(Int32())
        spin(lambda: len(received) == 4)
        print(type(received[0]).__name__, len({repr(each) for each in received}))


def callback_signatures() -> None:
    """Callbacks take one or two arguments."""
    with node() as made:
        for label, callback in (
            ("none", lambda: None),
            ("one", lambda a: None),
            ("two", lambda a, b: None),
            ("three", lambda a, b, c: None),
            ("default", lambda a, b=None: None),
            ("any", lambda *a: None),
            ("keywords", lambda a, **b: None),
        ):
            made_one = tell(
                label, lambda c=callback: made.create_subscription(Int32, "t", c, 1)._callback_type.name
            )
            del made_one


def callback_replaced() -> None:
    """The callback can be replaced."""
    with node() as made, spinner(made) as spin:
        received: list[str] = []
        publisher = made.create_publisher(Int32, "topic", 10)
        subscription = made.create_subscription(Int32, "topic", lambda m: received.append("first"), 10)
        subscription.callback = lambda m: received.append("second")
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(Int32())
        spin(lambda: received)
        print(received)


def subscriptions_of_two_nodes() -> None:
    """Nodes of one process communicate."""
    with node("a") as first:
        second = rclpy.create_node("b")
        received: list[int] = []
        publisher = first.create_publisher(Int32, "/topic", 10)
        second.create_subscription(Int32, "topic", lambda m: received.append(m.data), 10)
        with spinner(second) as spin:
            spin(lambda: publisher.get_subscription_count())
            publisher.publish(Int32(data=4))
            spin(lambda: received)
        print(received)


def messages_are_independent() -> None:
    """A message that is changed after it was published arrives as it was."""
    with node() as made, spinner(made) as spin:
        received: list[str] = []
        publisher = made.create_publisher(String, "topic", 10)
        made.create_subscription(String, "topic", lambda m: received.append(m.data), 10)
        spin(lambda: publisher.get_subscription_count())
        message = String(data="before")
        publisher.publish(message)
        message.data = "after"
        spin(lambda: received)
        print(received)


def counts() -> None:
    """Counts of both sides."""
    with node() as made:
        publisher = made.create_publisher(Int32, "topic", 10)
        print(publisher.get_subscription_count())
        subscriptions = [made.create_subscription(Int32, "topic", print, 10) for _ in range(3)]
        print(wait(lambda: publisher.get_subscription_count() == 3))
        print(wait(lambda: subscriptions[0].get_publisher_count() == 1))
        made.destroy_subscription(subscriptions[0])
        print(wait(lambda: publisher.get_subscription_count() == 2))


def wait_for_message() -> None:
    """The helper that waits for one message."""
    import threading

    from rclpy.wait_for_message import wait_for_message as wait_for

    with node() as made:
        publisher = made.create_publisher(Int32, "topic", 10)

        def publish() -> None:
            wait(lambda: publisher.get_subscription_count())
            publisher.publish(Int32(data=7))

        thread = threading.Thread(target=publish)
        thread.start()
        print(wait_for(Int32, made, "topic", time_to_wait=5))
        thread.join()
        print(wait_for(Int32, made, "topic", time_to_wait=0.1))


def wait_for_all_acked() -> None:
    """Waiting for acknowledgements."""
    from rclpy.duration import Duration

    with node() as made:
        publisher = made.create_publisher(Int32, "topic", 10)
        publisher.publish(Int32())
        print(publisher.wait_for_all_acked(Duration(seconds=1)))


def loan_and_options() -> None:
    """Unknown options."""
    with node() as made:
        tell("option", lambda: made.create_publisher(Int32, "topic", 10, other=1))
        tell("no callback", lambda: made.create_subscription(Int32, "topic", None, 10))
        tell("no type", lambda: made.create_publisher(None, "topic", 10))
        tell("a string as type", lambda: made.create_publisher("std_msgs/msg/Int32", "topic", 10))
        tell(
            "a service as type",
            lambda: made.create_publisher(__import__("std_srvs.srv").srv.Empty, "topic", 10),
        )
        tell("no class", lambda: made.create_subscription(int, "topic", print, 10))
        tell("no profile", lambda: made.create_publisher(Int32, "topic"))


def context_managers() -> None:
    """Endpoints are context managers."""
    with node() as made:
        with made.create_publisher(Int32, "topic", 10) as publisher:
            publisher.publish(Int32())
        tell("publish", publisher.publish, Int32())
        with made.create_subscription(Int32, "topic", print, 10) as subscription:
            pass
        tell("count", subscription.get_publisher_count)


def assert_liveliness() -> None:
    """Assertions of liveliness."""
    with node() as made:
        tell("assert", made.create_publisher(Int32, "topic", 10).assert_liveliness)


def content_filter() -> None:
    """Content filters."""
    from rclpy.subscription_content_filter_options import ContentFilterOptions

    with node() as made, spinner(made) as spin:
        received: list[int] = []
        publisher = made.create_publisher(Int32, "topic", 10)
        options = ContentFilterOptions(filter_expression="data > %0", expression_parameters=["1"])
        subscription = made.create_subscription(
            Int32, "topic", lambda m: received.append(m.data), 10, content_filter_options=options
        )
        spin(lambda: publisher.get_subscription_count())
        for number in range(4):
            publisher.publish(Int32(data=number))
        spin(lambda: len(received) == 2)
        spin(seconds=QUIET_S)
        print(subscription.is_cft_enabled, received)


def topic_repr() -> None:
    """Names after remapping."""
    with node(args=["--ros-args", "-r", "chatter:=/talk", "-r", "__ns:=/robot"]) as made:
        publisher = made.create_publisher(String, "chatter", 10)
        print(publisher.topic, publisher.topic_name)
        print(made.create_publisher(String, "~/private", 10).topic_name)
        print(made.resolve_topic_name("chatter"), made.resolve_topic_name("chatter", only_expand=True))


def hidden_topics() -> None:
    """Names that tools hide."""
    with node() as made:
        print(made.create_publisher(Int32, "_hidden", 10).topic_name)
        print(made.create_publisher(Int32, "a/_hidden/b", 10).topic_name)
