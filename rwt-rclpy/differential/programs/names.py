"""Names of nodes, topics, services and their validation."""

from typing import Any

import rclpy
from rclpy.expand_topic_name import expand_topic_name
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_parameter_name import validate_parameter_name
from rclpy.validate_topic_name import validate_topic_name
from std_msgs.msg import Int32
from std_srvs.srv import Empty

from differential.steps import node, tell

NAMES = (
    "a", "/a", "a/b", "/a/b", "~", "~/a", "~a", "a~", "/", "", "//a", "a//b", "a/", "/a/", "1a", "a/1b",
    "a1", "_a",
    "a__b", "a b", "a-b", "a.b", "ä", "{node}/a", "{ns}/a", "{namespace}/a", "{other}/a", "a{b", "a}b",
    "A", "/~",
    "a" * 300, "/" + "a" * 255, None, 1, "a\n", "rostopic://a", "a/_b", "/_a", "@", "a:b",
)  # fmt: skip


def _outcome(function: Any, *arguments: Any) -> None:
    try:
        result = function(*arguments)
    except Exception as error:
        print(repr(arguments[0])[:40], "raises", type(error).__name__)
    else:
        print(repr(arguments[0])[:40], "->", repr(result))


def topic_names() -> None:
    """Names of topics."""
    for name in NAMES:
        _outcome(validate_topic_name, name)


def service_names() -> None:
    """Names of services."""
    for name in NAMES:
        try:
            validate_topic_name(name, is_service=True)
        except Exception as error:
            print(repr(name)[:40], type(error).__name__)


def full_names() -> None:
    """Absolute names."""
    for name in NAMES:
        _outcome(validate_full_topic_name, name)


def namespaces() -> None:
    """Namespaces."""
    for name in NAMES:
        _outcome(validate_namespace, name)


def node_names() -> None:
    """Names of nodes."""
    for name in NAMES:
        _outcome(validate_node_name, name)


def parameter_names() -> None:
    """Names of parameters."""
    for name in NAMES:
        _outcome(validate_parameter_name, name)


def expansion() -> None:
    """Expansion of names."""
    for name in NAMES:
        _outcome(expand_topic_name, name, "node", "/ns")
    for arguments in (
        ("a", "1node", "/ns"),
        ("a", "node", "ns"),
        ("a", "node", "/"),
        ("~/a", "node", "/"),
        ("a", "", "/"),
    ):
        tell(arguments, expand_topic_name, *arguments)


def hidden() -> None:
    """Hidden names."""
    for name in NAMES:
        _outcome(topic_or_service_is_hidden, name)


def error_texts() -> None:
    """Errors show the place."""
    for function, name in (
        (validate_node_name, "a-b"),
        (validate_topic_name, "a//b"),
        (validate_namespace, "a"),
    ):
        try:
            function(name)
        except Exception as error:
            print(error)


def of_nodes() -> None:
    """Names of nodes that are made."""
    rclpy.init(args=[])
    for name, namespace in (
        ("a", ""),
        ("a", "b"),
        ("a", "/b/"),
        ("a", "/"),
        ("1", ""),
        ("", ""),
        ("a", "1"),
        ("a", None),
        (None, None),
        ("a/b", ""),
    ):
        try:
            made = rclpy.create_node(name, namespace=namespace)
        except Exception as error:
            print(name, namespace, "raises", type(error).__name__)
            continue
        print(name, namespace, made.get_name(), made.get_namespace(), made.get_fully_qualified_name())
        print(made.get_logger().name)
        made.destroy_node()
    rclpy.shutdown()


def of_endpoints() -> None:
    """Names of endpoints."""
    with node("talker", namespace="/ns") as made:
        for name in ("a", "/a", "~/a", "{node}/a", "{ns}/b", "1", "", "a b", "a//b", "a/", "~", "/"):
            tell(name, lambda n=name: made.create_publisher(Int32, n, 1).topic_name)
            tell(name, lambda n=name: made.create_client(Empty, n).service_name)


def resolution() -> None:
    """Resolution of names."""
    with node("talker", namespace="/ns") as made:
        for name in ("a", "/a", "~/a", "1", ""):
            tell(name, made.resolve_topic_name, name)
            tell(name, made.resolve_service_name, name)
