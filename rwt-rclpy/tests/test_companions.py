"""tf2_ros, message_filters, rosidl_runtime_py, sensor_msgs_py, cv_bridge and the index of packages."""

from __future__ import annotations

import importlib
import math
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from rwt_rclpy.companions import ament_index_python, cv_bridge, message_filters, rosidl_runtime_py
from rwt_rclpy.companions import sensor_msgs_py as clouds
from rwt_rclpy.messages.loaded import classes, message_class

if TYPE_CHECKING:
    from rwt_rclpy.middleware.link import VirtualDomain


def stamped(seconds: float) -> Any:
    message: Any = message_class("geometry_msgs/PointStamped")()
    message.header.stamp.sec = int(seconds)
    message.header.stamp.nanosec = round((seconds % 1) * 1e9)
    return message


def test_transforms_travel_and_move_points(rclpy_graph: VirtualDomain) -> None:
    import rclpy
    import tf2_geometry_msgs  # noqa: F401 - the import registers the conversions of points
    import tf2_ros

    node = rclpy.create_node("frames")
    buffer = tf2_ros.Buffer()
    tf2_ros.TransformListener(buffer, node)
    transform: Any = message_class("geometry_msgs/TransformStamped")()
    transform.header.frame_id, transform.child_frame_id = "map", "base"
    transform.transform.translation.x = 2.0
    transform.transform.rotation.z = transform.transform.rotation.w = math.sqrt(0.5)
    tf2_ros.StaticTransformBroadcaster(node).sendTransform(transform)
    waiting = buffer.wait_for_transform_async("map", "base", rclpy.time.Time())
    rclpy.spin_until_future_complete(node, waiting, timeout_sec=5.0)
    assert waiting.done() and buffer.can_transform("map", "base", rclpy.time.Time())
    point = stamped(0)
    point.header.frame_id, point.point.x = "base", 1.0
    moved = buffer.transform(point, "map")
    assert (moved.header.frame_id, moved.point.x, moved.point.y) == (
        "map",
        pytest.approx(2.0),
        pytest.approx(1.0),
    )
    with pytest.raises(tf2_ros.LookupException, match="nowhere"):
        buffer.lookup_transform("map", "nowhere", rclpy.time.Time())


def test_threads_may_add_the_same_transform(
    rclpy_graph: VirtualDomain, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rclpy
    import tf2_ros

    errors: list[BaseException | None] = []
    monkeypatch.setattr(threading, "excepthook", lambda args: errors.append(args.exc_value))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(20):
            buffer, barrier = tf2_ros.Buffer(), threading.Barrier(4)
            futures = [buffer.wait_for_transform_async("a", "b", rclpy.time.Time()) for _ in range(200)]
            transform: Any = message_class("geometry_msgs/TransformStamped")()
            transform.header.frame_id, transform.child_frame_id = "a", "b"
            transform.transform.rotation.w = 1.0

            def add(buffer: Any = buffer, barrier: Any = barrier, transform: Any = transform) -> None:
                barrier.wait()
                buffer.set_transform(transform, "")

            threads = [threading.Thread(target=add) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert all(future.done() for future in futures)
    finally:
        sys.setswitchinterval(interval)
    assert errors == []


def test_a_listener_fills_the_buffer_that_it_has_now(rclpy_graph: VirtualDomain) -> None:
    import rclpy
    import tf2_ros

    node = rclpy.create_node("frames")
    listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
    listener.buffer = buffer = tf2_ros.Buffer()
    time = rclpy.time.Time(seconds=2)
    waiting = buffer.lookup_transform_full_async("map", time, "base", time, "map")
    waiting.send(None)
    transform: Any = message_class("geometry_msgs/TransformStamped")(child_frame_id="base")
    transform.header.frame_id, transform.header.stamp = "map", time.to_msg()
    tf2_ros.TransformBroadcaster(node).sendTransform(transform)
    rclpy.spin_once(node, timeout_sec=1.0)
    with pytest.raises(StopIteration) as found:
        waiting.send(None)
    assert found.value.value == transform
    for seconds, side in ((1, "past"), (3, "future")):
        with pytest.raises(
            tf2_ros.ExtrapolationException, match=f"would require extrapolation into the {side}"
        ):
            buffer.lookup_transform("map", "base", rclpy.time.Time(seconds=seconds))


def test_a_buffer_client_raises_what_its_server_names() -> None:
    import rclpy
    import tf2_ros
    from rclpy.action import ActionServer

    LookupTransform: Any = classes().action("tf2_msgs/LookupTransform")
    buffer = tf2_ros.Buffer()
    transform: Any = message_class("geometry_msgs/TransformStamped")(child_frame_id="base")
    transform.header.frame_id = "map"
    buffer.set_transform_static(transform, "test")

    def answer(handle: Any) -> Any:
        asked, result = handle.request, LookupTransform.Result()
        try:
            result.transform = buffer.lookup_transform_core(
                asked.target_frame, asked.source_frame, asked.source_time
            )
        except tf2_ros.LookupException as error:
            result.error.error, result.error.error_string = 1, str(error)
        handle.succeed()
        return result

    rclpy.init(args=[])
    node, executor = rclpy.create_node("frames"), rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    client = tf2_ros.BufferClient(node, "lookup")
    with pytest.raises(tf2_ros.TimeoutException, match="not ready"):
        client.lookup_transform("map", "base", rclpy.time.Time())
    ActionServer(node, LookupTransform, "lookup", answer)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    try:
        timeout = rclpy.duration.Duration(seconds=60)  # An answer comes at once.
        assert client.action_client.wait_for_server(60)
        assert client.lookup_transform("map", "base", rclpy.time.Time(), timeout) == transform
        with pytest.raises(tf2_ros.LookupException, match="nowhere"):
            client.lookup_transform("map", "nowhere", rclpy.time.Time(), timeout)
        assert not client.can_transform("map", "nowhere", rclpy.time.Time(), timeout)
    finally:
        executor.shutdown()
        spinning.join()
        node.destroy_node()
        rclpy.shutdown()


def test_messages_of_the_same_time_come_together() -> None:
    first, second = message_filters.SimpleFilter(), message_filters.SimpleFilter()
    together: list[Any] = []
    message_filters.TimeSynchronizer([first, second], 5).registerCallback(lambda *pair: together.append(pair))
    for seconds in (1, 2, 3):
        first.signalMessage(stamped(seconds))
    second.signalMessage(stamped(2))
    second.signalMessage(stamped(2.5))
    assert [one.header.stamp.sec for one, _ in together] == [2] and len(together) == 1


def test_messages_of_about_the_same_time_come_together() -> None:
    first, second = message_filters.SimpleFilter(), message_filters.SimpleFilter()
    together: list[Any] = []
    synchronizer = message_filters.ApproximateTimeSynchronizer([first, second], 5, 0.1)
    synchronizer.registerCallback(lambda *pair: together.append(pair))
    first.signalMessage(stamped(1.0))
    second.signalMessage(stamped(1.2))
    second.signalMessage(stamped(1.05))
    assert len(together) == 1 and together[0][1].header.stamp.nanosec == 50_000_000
    first.signalMessage(stamped(3.0))
    second.signalMessage(stamped(3.1))
    assert len(together) == 1, "the difference is not less than the limit"


def test_an_old_message_that_a_full_queue_drops_is_not_combined() -> None:
    first, second = message_filters.SimpleFilter(), message_filters.SimpleFilter()
    together: list[Any] = []
    message_filters.ApproximateTimeSynchronizer([first, second], 1, 0.5).registerCallback(
        lambda *pair: together.append(pair)
    )
    first.signalMessage(stamped(5.0))
    first.signalMessage(stamped(4.0))
    second.signalMessage(stamped(4.1))
    assert not together
    second.signalMessage(stamped(5.1))
    assert len(together) == 1


def test_the_cache_finds_by_time() -> None:
    from rwt_rclpy.clocks.time import ClockType, Time

    def at(seconds: float) -> Time:
        return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)

    source = message_filters.SimpleFilter()
    cache = message_filters.Cache(source, 2)
    for seconds in (1, 2, 3):
        source.signalMessage(stamped(seconds))
    assert cache.getElemBeforeTime(at(1.5)) is None
    assert cache.getElemAfterTime(at(1.5)).header.stamp.sec == 2
    assert len(cache.getInterval(at(2), at(3))) == 2 and cache.getLast().header.stamp.sec == 3
    assert (cache.getOldestTime(), cache.getLastestTime()) == (at(2), at(3))


@pytest.mark.parametrize("allowed", [False, True])
def test_messages_without_a_header_have_their_time_of_arrival_if_allowed(allowed: bool) -> None:
    text = message_class("std_msgs/String")()
    first, second = message_filters.SimpleFilter(), message_filters.SimpleFilter()
    together: list[Any] = []
    synchronizer = message_filters.ApproximateTimeSynchronizer([first, second], 5, 60.0, allowed)
    synchronizer.registerCallback(lambda *pair: together.append(pair))
    cache = message_filters.Cache(first, 5, allowed)
    first.signalMessage(text)
    second.signalMessage(text)
    assert (together, cache.getLast()) == (([(text, text)], text) if allowed else ([], None))


def test_messages_from_and_to_dictionaries() -> None:
    twist: Any = message_class("geometry_msgs/Twist")()
    rosidl_runtime_py.set_message_fields(twist, {"linear": {"x": 1}, "angular": [0, 0, 2]})
    assert (twist.linear.x, twist.angular.z) == (1.0, 2.0)
    assert rosidl_runtime_py.message_to_ordereddict(twist)["linear"] == {"x": 1.0, "y": 0.0, "z": 0.0}
    assert rosidl_runtime_py.message_to_yaml(twist).startswith("linear:\n  x: 1.0\n")
    assert rosidl_runtime_py.message_to_csv(twist) == "1.0,0.0,0.0,0.0,0.0,2.0"
    with pytest.raises(AttributeError, match="no field 'up'"):
        rosidl_runtime_py.set_message_fields(twist, {"up": 1})
    path: Any = message_class("nav_msgs/Path")()
    later = rosidl_runtime_py.set_message_fields(
        path, {"header": "auto", "poses": [{"pose": {"position": {"x": 1}}}]}, expand_header_auto=True
    )
    later[0](message_class("builtin_interfaces/Time")(sec=5))
    assert path.poses[0].pose.position.x == 1.0 and path.header.stamp.sec == 5


def test_interfaces_by_name() -> None:
    assert rosidl_runtime_py.get_message("std_msgs/msg/String") is message_class("std_msgs/String")
    assert rosidl_runtime_py.is_service(rosidl_runtime_py.get_service("std_srvs/srv/SetBool"))
    assert rosidl_runtime_py.is_action(rosidl_runtime_py.get_action("example_interfaces/action/Fibonacci"))
    for wrong, error in (
        ("String", ValueError),
        ("std_msgs/msg/Strin", AttributeError),
        ("no_msgs/msg/String", ModuleNotFoundError),
    ):
        with pytest.raises(error):
            rosidl_runtime_py.get_interface(wrong)


def test_clouds_as_arrays_and_back() -> None:
    header = message_class("std_msgs/Header")(frame_id="lidar")
    points = np.array([[1, 2, 3], [4, np.nan, 6]], np.float32)
    cloud = clouds.create_cloud_xyz32(header, points)
    assert (cloud.width, cloud.height, cloud.point_step) == (2, 1, 12)
    assert np.array_equal(clouds.read_points_numpy(cloud), points, equal_nan=True)
    assert (
        clouds.read_points_list(cloud, ["x", "z"], skip_nans=True) == [(1.0, 3.0)]
        or len(clouds.read_points(cloud, ["x", "y"], skip_nans=True)) == 1
    )
    with pytest.raises(AssertionError, match="no field w"):
        clouds.read_points(cloud, ["w"])


def test_images_as_arrays_and_back() -> None:
    bridge = cv_bridge.CvBridge()
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    message = bridge.cv2_to_imgmsg(pixels, "bgr8")
    assert (message.height, message.width, message.step) == (2, 4, 12)
    assert np.array_equal(bridge.imgmsg_to_cv2(message), pixels)
    assert np.array_equal(bridge.imgmsg_to_cv2(message, "rgb8"), pixels[..., ::-1])
    depth = np.arange(8, dtype=np.uint16).reshape(2, 4)
    assert np.array_equal(bridge.imgmsg_to_cv2(bridge.cv2_to_imgmsg(depth)), depth)
    with pytest.raises(cv_bridge.CvBridgeError):
        bridge.imgmsg_to_cv2(message, "mono8")


def test_packages_are_found_where_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "share/robot").mkdir(parents=True)
    (tmp_path / "share/robot/package.xml").write_text("<package><name>robot</name></package>")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert ament_index_python.get_package_share_directory("robot") == str(tmp_path / "share/robot")
    with pytest.raises(ament_index_python.PackageNotFoundError, match="no folder of package 'other'"):
        ament_index_python.get_package_prefix("other")


def test_a_module_does_not_take_the_place_of_a_function_of_its_name() -> None:
    module = importlib.import_module("rosidl_runtime_py.get_interfaces")
    assert callable(module.get_interfaces)
    assert "std_msgs" in module.get_interfaces()
    assert module.get_interfaces is importlib.import_module("rosidl_runtime_py").get_interfaces
