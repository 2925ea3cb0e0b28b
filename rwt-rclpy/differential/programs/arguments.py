"""Arguments after --ros-args."""

from typing import Any

import rclpy
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Int32
from std_srvs.srv import Empty

from differential.steps import node, tell

WRONG: tuple[tuple[str, ...], ...] = (
    ("--ros-args", "-r"),
    ("--ros-args", "-r", "a"),
    ("--ros-args", "-r", "a:="),
    ("--ros-args", "-r", ":=a"),
    ("--ros-args", "-r", "a b:=c"),
    ("--ros-args", "-r", "__node:=a b"),
    ("--ros-args", "-r", "__node:=/a"),
    ("--ros-args", "-r", "__ns:=a"),
    ("--ros-args", "-r", "__ns:=/a b"),
    ("--ros-args", "-r", "__name:=a"),
    ("--ros-args", "-p"),
    ("--ros-args", "-p", "a"),
    ("--ros-args", "-p", "a:="),
    ("--ros-args", "-p", ":=1"),
    ("--ros-args", "-p", "a b:=1"),
    ("--ros-args", "-p", "a:=["),
    ("--ros-args", "--params-file"),
    ("--ros-args", "--log-level", "loud"),
    ("--ros-args", "--log-level", "INFO"),
    ("--ros-args", "--log-level", "a:=warn"),
    ("--ros-args", "--log-level", "a:=loud"),
    ("--ros-args", "--log-level", ":=warn"),
    ("--ros-args", "--log-level"),
    ("--ros-args", "--log-config-file", "/nowhere"),
    ("--ros-args", "--unknown"),
    ("--ros-args", "unknown"),
    ("--ros-args", "--enable-rosout-logs", "--disable-external-lib-logs"),
    ("--ros-args", "--disable-rosout-logs"),
    ("--ros-args", "-e", "/enclave"),
    ("--ros-args", "--enclave"),
    ("--ros-args", "--log-file-name", "a"),
    ("--ros-args", "--", "other"),
    ("--ros-args", "--ros-args"),
    ("--ros-args",),
    ("--other", "argument"),
    ("--ros-args", "-r", "a:=b", "--", "--other"),
    ("--ros-args", "-r", "a:=b:=c"),
    ("--ros-args", "-r", "rostopic://a:=b"),
    ("--ros-args", "-r", "node:a:=b"),
    ("--ros-args", "-r", "a:=~/b"),
    ("--ros-args", "-r", "~/a:=b"),
    ("--ros-args", "-r", "a:={node}/b"),
    ("--ros-args", "-r", "*:=b"),
    ("--ros-args", "-r", "**/a:=b"),
)


def accepted_and_rejected() -> None:
    """Arguments that init accepts or rejects."""
    for arguments in WRONG:
        tell(arguments, lambda a=arguments: rclpy.init(args=list(a)) and None)
        rclpy.try_shutdown()


def of_nodes() -> None:
    """Errors of a node's own arguments."""
    rclpy.init(args=[])
    for arguments in WRONG:
        try:
            rclpy.create_node("node", cli_args=list(arguments)).destroy_node()
        except Exception as error:
            print(arguments, "raises", type(error).__name__)
        else:
            print(arguments, "is accepted")
    rclpy.shutdown()


REMAPS: tuple[tuple[str, ...], ...] = (
    ("a:=b",),
    ("a:=/b",),
    ("/ns/a:=b",),
    ("/a:=b",),
    ("a:=b", "a:=c"),
    ("a:=b", "b:=c"),
    ("node:a:=b",),
    ("other:a:=b",),
    ("rostopic://a:=b",),
    ("rosservice://a:=b",),
    ("~/p:=b",),
    ("a:=~/b",),
    ("__node:=new",),
    ("__name:=new",),
    ("__ns:=/new",),
    ("node:__node:=new",),
    ("other:__node:=new",),
    ("node:__ns:=/new",),
    ("__node:=new", "new:a:=b"),
    ("__node:=new", "node:a:=b"),
    ("__ns:=/new", "a:=b"),
    ("__node:=new", "__node:=newer"),
    ("/ns/node/p:=b",),
)


def remapping() -> None:
    """Names after rules."""
    for rules in REMAPS:
        arguments = ["--ros-args", *(part for rule in rules for part in ("-r", rule))]
        with node(namespace="/ns", args=arguments) as made:
            print(
                rules,
                made.get_fully_qualified_name(),
                made.create_publisher(Int32, "a", 1).topic_name,
                made.create_service(Empty, "a", lambda q, r: r).service_name,
                made.create_subscription(Int32, "~/p", print, 1).topic_name,
                made.get_logger().name,
            )


def remapping_of_a_node() -> None:
    """A node's own rules come first."""
    rclpy.init(args=["--ros-args", "-r", "a:=b"])
    for options in ({}, {"cli_args": ["--ros-args", "-r", "a:=c"]}, {"use_global_arguments": False}):
        made = rclpy.create_node("node", **options)
        print(options, made.create_publisher(Int32, "a", 1).topic_name)
        made.destroy_node()
    rclpy.shutdown()


def two_nodes_renamed() -> None:
    """A rule renames every node."""
    with node("a", args=["--ros-args", "-r", "__node:=same"]) as made:
        other = rclpy.create_node("b")
        print(made.get_name(), other.get_name())


def removal() -> None:
    """Arguments that are not ROS's."""
    for arguments in (
        [],
        ["program"],
        ["program", "--ros-args", "-r", "a:=b"],
        ["program", "x", "--ros-args", "-r", "a:=b", "--", "y"],
        ["program", "--ros-args", "--ros-args", "-p", "a:=1"],
        ["program", "--ros-args", "--unknown", "y"],
        ["program", "--", "x"],
    ):
        result: Any = tell(arguments, remove_ros_args, arguments)
        del result


def node_options() -> None:
    """Options of the constructor."""
    rclpy.init(args=[])
    tell("unknown", rclpy.create_node, "node", other=1)
    tell("positional", lambda: rclpy.create_node("node", None))
    made = rclpy.create_node("node", start_parameter_services=False, enable_rosout=False)
    print(len(list(made.services)), len(list(made.publishers)))
    made.destroy_node()
    rclpy.shutdown()
