"""Queries of the graph."""

from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32, String
from std_srvs.srv import Empty

from differential.steps import node, public, tell, wait


def node_names() -> None:
    """Names of nodes."""
    with node("a") as made:
        second = rclpy.create_node("b", namespace="ns")
        wait(lambda: len(made.get_node_names()) == 2)
        print(sorted(made.get_node_names()))
        print(sorted(made.get_node_names_and_namespaces()))
        print(sorted(made.get_node_names_and_namespaces_with_enclaves()))
        second.destroy_node()
        print(wait(lambda: len(made.get_node_names()) == 1))


def topic_names() -> None:
    """Topics and types."""
    with node() as made:
        made.create_publisher(Int32, "a", 10)
        made.create_subscription(String, "b", print, 10)
        wait(lambda: len(made.get_topic_names_and_types()) >= 4)
        for name, types in sorted(made.get_topic_names_and_types()):
            print(name, types)
        print([name for name, _ in made.get_topic_names_and_types(no_demangle=True) if name.endswith("a")])


def topics_of_a_new_node() -> None:
    """Topics that every node has."""
    with node() as made:
        wait(lambda: False, 0.3)
        print(sorted(made.get_topic_names_and_types()))
        print(sorted(made.get_publisher_names_and_types_by_node("node", "/")))
        print(sorted(made.get_subscriber_names_and_types_by_node("node", "/")))


def services_of_a_new_node() -> None:
    """Services that every node has."""
    with node() as made:
        wait(lambda: False, 0.3)
        print(sorted(made.get_service_names_and_types()))
        print(sorted(made.get_service_names_and_types_by_node("node", "/")))
        print(sorted(made.get_client_names_and_types_by_node("node", "/")))


def service_queries() -> None:
    """Services and clients."""
    with node() as made:
        made.create_service(Empty, "service", lambda q, r: r)
        client = made.create_client(Empty, "service")
        client.wait_for_service(5)
        print(made.count_services("service"), made.count_services("/service"), made.count_services("none"))
        tell("clients", made.count_clients, "service")
        print([each for each in made.get_service_names_and_types() if each[0] == "/service"])
        print(made.get_client_names_and_types_by_node("node", "/"))


def by_unknown_node() -> None:
    """Nodes that do not exist."""
    with node() as made:
        tell("publishers", made.get_publisher_names_and_types_by_node, "none", "/")
        tell("subscriptions", made.get_subscriber_names_and_types_by_node, "none", "/")
        tell("services", made.get_service_names_and_types_by_node, "none", "/")
        tell("clients", made.get_client_names_and_types_by_node, "none", "/")
        tell("wrong name", made.get_client_names_and_types_by_node, "a-b", "/")


def by_node() -> None:
    """Topics of a node."""
    with node("a") as made:
        other = rclpy.create_node("b", namespace="/ns")
        other.create_publisher(Int32, "x", 10)
        other.create_subscription(Int32, "y", print, 10)
        wait(lambda: len(made.get_topic_names_and_types()) >= 4)
        print([e for e in made.get_publisher_names_and_types_by_node("b", "/ns") if "/x" in e[0]])
        print(made.get_subscriber_names_and_types_by_node("b", "/ns"))
        print(made.get_publisher_names_and_types_by_node("b", "/ns", no_demangle=True)[0][0][:3])


def counts() -> None:
    """Counts of endpoints."""
    with node() as made:
        made.create_publisher(Int32, "a", 10)
        made.create_subscription(Int32, "a", print, 10)
        made.create_subscription(Int32, "a", print, 10)
        wait(lambda: made.count_subscribers("a") == 2)
        print(made.count_publishers("a"), made.count_subscribers("/a"), made.count_publishers("b"))
        tell("wrong", made.count_publishers, "1")
        tell("wrong", made.count_subscribers, "a b")


def counts_of_incompatible() -> None:
    """Incompatible endpoints are counted in the graph."""
    with node() as made:
        made.create_publisher(Int32, "a", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
        made.create_subscription(Int32, "a", print, 10)
        print(wait(lambda: made.count_publishers("a") == 1 and made.count_subscribers("a") == 1))


def counts_with_remapping() -> None:
    """Counts resolve names."""
    with node(args=["--ros-args", "-r", "a:=b"]) as made:
        made.create_publisher(Int32, "a", 10)
        wait(lambda: made.count_publishers("/b") == 1)
        print(made.count_publishers("a"), made.count_publishers("/b"), made.count_publishers("/a"))


def _show(info: Any) -> None:
    print(info.node_name, info.node_namespace, info.topic_type, info.endpoint_type, str(info.topic_type_hash))
    print(type(info.endpoint_gid).__name__, len(info.endpoint_gid))
    print(info.qos_profile)


def endpoint_info() -> None:
    """Information about endpoints."""
    with node(namespace="/ns") as made:
        qos = QoSProfile(depth=7, durability=DurabilityPolicy.TRANSIENT_LOCAL, deadline=Duration(seconds=1))
        made.create_publisher(Int32, "a", qos)
        made.create_subscription(Int32, "a", print, 10)
        wait(lambda: made.count_publishers("a") == 1 and made.count_subscribers("a") == 1)
        for info in (*made.get_publishers_info_by_topic("a"), *made.get_subscriptions_info_by_topic("a")):
            _show(info)
            print(public(info))
        print(made.get_publishers_info_by_topic("b"))
        tell("wrong", made.get_publishers_info_by_topic, "1")


def endpoint_info_text() -> None:
    """Information about endpoints as text."""
    with node() as made:
        made.create_publisher(Int32, "a", 10)
        wait(lambda: made.count_publishers("a") == 1)
        for line in str(made.get_publishers_info_by_topic("a")[0]).splitlines():
            print(line if "GID" not in line else "GID")


def endpoint_info_mangled() -> None:
    """Names of the middleware."""
    with node() as made:
        made.create_publisher(Int32, "a", 10)
        wait(lambda: made.count_publishers("a") == 1)
        print(len(made.get_publishers_info_by_topic("rt/a", no_mangle=True)))
        print(len(made.get_publishers_info_by_topic("/a", no_mangle=True)))


def wait_for_node() -> None:
    """Waiting for a node."""
    with node() as made:
        other = rclpy.create_node("other", namespace="ns")
        print(made.wait_for_node("/ns/other", 5), made.wait_for_node("/none", 0.2))
        other.destroy_node()


def attributes_of_node() -> None:
    """Public attributes."""
    with node() as made:
        print(public(made))
        print([each.__name__ for each in type(made).__mro__][:3])


def entities_of_node() -> None:
    """Iterators over entities."""
    with node() as made:
        made.create_timer(1, print)
        made.create_guard_condition(print)
        made.create_client(Empty, "service")
        made.create_subscription(Int32, "a", print, 1)
        for name in ("publishers", "subscriptions", "clients", "services", "timers", "guards", "waitables"):
            print(name, len(list(getattr(made, name))))
        tell("handle", setattr, made, "handle", None)


def destroyed_node() -> None:
    """A destroyed node."""
    with node() as made:
        other = rclpy.create_node("other")
        print(other.destroy_node())
        tell("name", other.get_name)
        tell("publisher", lambda: bool(other.create_publisher(Int32, "a", 1)))
        tell("names", other.get_node_names)
        tell("parameter", lambda: other.declare_parameter("a", 1).value)
        tell("logger", lambda: other.get_logger().name)
        tell("now", lambda: other.get_clock().now().nanoseconds > 0)
        tell("again", other.destroy_node)
        del made


def type_description() -> None:
    """The service that describes types."""
    with node() as made:
        client_type = __import__("type_description_interfaces.srv").srv.GetTypeDescription
        client = made.create_client(client_type, "node/get_type_description")
        print(client.wait_for_service(5))


def counts_of_services() -> None:
    """Servers and clients of one node and of two."""
    from std_srvs.srv import Empty

    with node("a") as made:
        other = rclpy.create_node("b")
        made.create_service(Empty, "/service", lambda request, response: response)
        made.create_service(Empty, "/service", lambda request, response: response)
        made.create_client(Empty, "/service")
        other.create_client(Empty, "/service")
        wait(lambda: made.count_clients("/service") == 2 and made.count_services("/service") == 2)
        print(made.count_services("/service"), made.count_clients("/service"))
        print(other.count_services("/service"), other.count_clients("/service"))
        other.destroy_node()
        wait(lambda: made.count_clients("/service") == 1)
        print(made.count_services("/service"), made.count_clients("/service"))
