"""Mistakes of programs: the classes of the exceptions, and the first lines of their texts."""

import array
from typing import Any

import numpy
import rclpy
from builtin_interfaces.msg import Time as TimeMessage
from geometry_msgs.msg import Point, PoseWithCovariance, Twist
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSPresetProfiles, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.validate_topic_name import validate_topic_name
from sensor_msgs.msg import Image, LaserScan
from std_msgs.msg import ColorRGBA, Float64MultiArray, Int8, String, UInt8
from std_srvs.srv import SetBool, Trigger

from differential.steps import fails, node, spinner


def fields_of_wrong_types() -> None:
    """Nothing is checked when a field is assigned: the default of releases."""
    text, number, scan = String(), Int8(), LaserScan()
    text.data = 5
    number.data = 300
    scan.ranges = "abc"
    print(text, number, scan.ranges, String(data=None), ColorRGBA(r="red"))
    fails("unknown field", lambda: String(text="a"))
    fails("unknown attribute", setattr, text, "text", "a")
    fails("read", lambda: text.text)


def fields_that_are_checked() -> None:
    """Messages with checks, which an argument turns on."""
    fails("text", lambda: String(data=5, check_fields=True))
    fails("number", lambda: Int8(data=300, check_fields=True))
    fails("kind", lambda: UInt8(data="a", check_fields=True))
    fails("list", lambda: LaserScan(ranges=["a"], check_fields=True))
    fails("float", lambda: ColorRGBA(r=1, check_fields=True))
    fails("message", lambda: Twist(linear=Twist(), check_fields=True))
    fails("bytes", lambda: Image(data=[256], check_fields=True))
    fails("covariance", lambda: PoseWithCovariance(covariance=[1.0], check_fields=True))
    fails("unknown", lambda: Point(w=1.0, check_fields=True))
    fails("huge", lambda: Point(x=1e400, check_fields=True))


def arrays_of_messages() -> None:
    """Classes of arrays that fields hold."""
    scan, image, many = LaserScan(), Image(), Float64MultiArray()
    scan.ranges = [1, 2]
    image.data = b"ab"
    many.data = numpy.array([1.5, 2.5])
    for value in (scan.ranges, image.data, many.data, LaserScan().ranges, PoseWithCovariance().covariance):
        print(type(value).__name__, value)
    image.data = array.array("B", [1, 2])
    print(image.data, type(deserialize_message(serialize_message(image), Image).data).__name__)
    covariance = PoseWithCovariance()
    covariance.covariance[0] = 2.5
    print(covariance.covariance[0], covariance == PoseWithCovariance(), covariance.covariance.dtype)


def bytes_that_are_no_message() -> None:
    """Serialisation of wrong values, and of truncated bytes."""
    data = serialize_message(Twist())
    print(len(data), deserialize_message(data, Twist) == Twist())
    fails("no message", serialize_message, "text")
    fails("cut", deserialize_message, b"\x00\x01\x00\x00", Twist)
    fails("no type", deserialize_message, data, str)
    fails("no bytes", deserialize_message, "text", Twist)


def publishing_something_else() -> None:
    """Messages of other classes."""
    with node() as made:
        publisher = made.create_publisher(String, "words", 10)
        for value in ("text", Twist(), None, 1, {"data": "a"}):
            fails(type(value).__name__, publisher.publish, value)
        fails("bytes", publisher.publish, serialize_message(String(data="raw")))
        fails("wait", publisher.wait_for_all_acked, Duration(seconds=1))
        made.destroy_publisher(publisher)
        fails("destroyed", publisher.publish, String())
        fails("topic", lambda: publisher.topic_name)


def names_that_are_invalid() -> None:
    """Names of nodes, topics, services and namespaces."""
    rclpy.init()
    for name in ("a b", "1a", "", "a/b", "a" * 300):
        fails(f"node {name[:8]}", lambda each=name: Node(each).destroy_node())
    for namespace in ("a b", "/a//b", "/1"):
        fails(f"namespace {namespace}", lambda each=namespace: Node("n", namespace=each).destroy_node())
    made = Node("named")
    for topic in ("a b", "/a//b", "", "~a", "a/", "{unknown}", "1a"):
        fails(f"topic {topic}", lambda each=topic: made.create_publisher(String, each, 10).topic_name)
        fails(f"service {topic}", lambda each=topic: made.create_client(Trigger, each).srv_name)
    fails("validate", validate_topic_name, "a/1")
    fails("type of name", made.create_publisher, String, 5, 10)
    made.destroy_node()
    rclpy.shutdown()


def types_that_are_wrong() -> None:
    """Classes that are no message, service or callback."""
    with node() as made:
        fails("publisher", made.create_publisher, str, "a", 10)
        fails("instance", made.create_publisher, String(), "a", 10)
        fails("subscription", made.create_subscription, SetBool, "a", print, 10)
        fails("service", made.create_service, String, "a", print)
        fails("client", made.create_client, Twist, "a")
        fails("callback", made.create_subscription, String, "a", "callback", 10)
        fails("depth", made.create_publisher, String, "a", "ten")
        fails("negative", made.create_publisher, String, "a", -1)
        fails("timer", made.create_timer, "1", print)
        fails("period", made.create_timer, -1.0, print)


def profiles_that_are_wrong() -> None:
    """Policies of profiles."""
    fails("nothing", QoSProfile)
    fails("depth", lambda: QoSProfile(depth=-1).depth)
    fails("kind", lambda: QoSProfile(depth="1"))
    fails("policy", lambda: QoSProfile(depth=1, reliability="reliable"))
    fails("unknown", lambda: QoSProfile(depth=1, speed=3))
    fails("duration", lambda: QoSProfile(depth=1, deadline=3))
    fails("preset", lambda: QoSPresetProfiles.get_from_short_key("nothing"))
    fails("short", lambda: QoSReliabilityPolicy.get_from_short_key("nothing"))
    print(
        QoSPresetProfiles.get_from_short_key("sensor_data").reliability.name,
        QoSReliabilityPolicy.short_keys(),
    )


def parameters_that_are_wrong() -> None:
    """Declarations and values that nodes reject."""
    with node() as made:
        fails("read", made.get_parameter, "missing")
        fails("set", made.set_parameters, [Parameter("missing", value=1)])
        fails("atomically", made.set_parameters_atomically, [Parameter("missing", value=1)])
        fails("describe", made.describe_parameter, "missing")
        fails("undeclare", made.undeclare_parameter, "missing")
        fails("name", made.declare_parameter, "", 1)
        fails("value", made.declare_parameter, "object", object())
        fails("not a parameter", made.set_parameters, [1])
        fails("descriptor", made.declare_parameter, "a", 1, "descriptor")
        fails("type", made.declare_parameter, "b", 1, ParameterDescriptor(type=4))
        made.add_on_set_parameters_callback(lambda _: SetParametersResult(successful=False, reason="never"))
        fails("rejected", made.declare_parameter, "c", 1)
        fails("several", made.declare_parameters, "", [("d",), ("e", 1, None, 2)])
        fails("python", parameter_value_to_python, 5)
        try:
            made.get_parameter("missing")
        except ParameterNotDeclaredException as error:
            print(error.args)


def node_after_shutdown() -> None:
    """Everything that a node offers, after the context has ended."""
    fails("before", rclpy.create_node, "early")
    fails("spin", rclpy.spin, None)
    fails("shutdown", rclpy.shutdown)
    rclpy.init()
    made = rclpy.create_node("late")
    publisher = made.create_publisher(String, "a", 10)
    timer = made.create_timer(10, print)
    rclpy.shutdown()
    fails("node", rclpy.create_node, "later")
    fails("publish", publisher.publish, String())
    fails("service", made.create_client, Trigger, "b")
    fails("timer", timer.is_ready)
    fails("count", made.count_publishers, "a")
    fails("executor", SingleThreadedExecutor)
    fails("names", made.get_node_names)


def node_that_is_destroyed() -> None:
    """A node's functions after its end."""
    with node("kept"):
        made = Node("gone")
        publisher, client = made.create_publisher(String, "a", 10), made.create_client(Trigger, "b")
        print(made.destroy_node())
        fails("name", made.get_name)
        fails("publish", publisher.publish, String())
        fails("ready", client.service_is_ready)
        fails("create", made.create_publisher, String, "c", 10)
        fails("topics", made.get_topic_names_and_types)
        fails("again", made.destroy_node)


def callbacks_that_raise() -> None:
    """Exceptions of callbacks leave the executor."""
    with node() as made, spinner(made) as spin:
        publisher = made.create_publisher(String, "a", 10)

        def broken(message: Any) -> None:
            raise RuntimeError(f"cannot read {message.data}")

        made.create_subscription(String, "a", broken, 10)
        made.create_timer(0.05, lambda: publisher.publish(String(data="it")))
        fails("subscription", spin)
    with node() as made, spinner(made) as spin:
        made.create_service(Trigger, "b", lambda request, response: None)
        client = made.create_client(Trigger, "b")
        client.wait_for_service(4)
        future = client.call_async(Trigger.Request())
        fails("no response", spin, future.done, 1)


def clocks_that_are_wrong() -> None:
    """Clocks and times of wrong classes."""
    with node() as made:
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        fails("until", clock.sleep_until, made.get_clock().now())
        fails("for", clock.sleep_for, 1)
        fails("until number", clock.sleep_until, 5)
        fails("type", lambda: Clock(clock_type=99))
        fails("jump", clock.create_jump_callback, None)
        fails("override", lambda: clock.set_ros_time_override)
        print(TimeMessage(sec=1), clock.now().clock_type == ClockType.STEADY_TIME)
