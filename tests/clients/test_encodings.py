"""cbor, cbor-raw, png and fragments, as the JavaScript clients decode them."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from tests.clients.conftest import Program

pytestmark = pytest.mark.clients

STORES = {"noetic": get_typestore(Stores.ROS1_NOETIC), "jazzy": get_typestore(Stores.ROS2_JAZZY)}

#: The kinds of array as which the libraries give the arrays of CBOR out.
KINDS = {
    "geometry_msgs/PoseWithCovarianceStamped": {"Float64Array"},
    "sensor_msgs/JointState": {"Float64Array"},
    "sensor_msgs/LaserScan": {"Float32Array"},
    "nav_msgs/OccupancyGrid": {"Int8Array"},
    "sensor_msgs/PointCloud2": {"Uint8Array"},
}


def as_json(value: Any) -> Any:
    """Return a value decoded from CBOR as it would be in JSON."""
    if isinstance(value, dict):
        if value.keys() == {"kind", "items"}:
            octets = value["kind"] in ("Uint8Array", "Buffer")
            return base64.b64encode(bytes(value["items"])).decode() if octets else value["items"]
        return {key: as_json(each) for key, each in value.items()}
    return [as_json(each) for each in value] if isinstance(value, list) else value


def kinds(value: Any) -> set[str]:
    if isinstance(value, dict):
        own = {value["kind"]} if value.keys() == {"kind", "items"} else set()
        return own.union(*map(kinds, value.values()))
    return set().union(*map(kinds, value)) if isinstance(value, list) else set()


def test_cbor_carries_what_json_does(roslib: Program) -> None:
    for type_name, (plain, cbor) in roslib.observe("cbor").items():
        assert as_json(cbor) == plain
        assert kinds(cbor) == KINDS.get(type_name, set())


def test_pictures_carry_what_json_does(roslib: Program) -> None:
    observed = roslib.observe("png")
    assert len(observed) == 6
    for plain, picture in observed.values():
        assert picture == plain


def test_raw_messages_are_what_the_robot_would_serialise(roslib: Program, distro: str) -> None:
    store = STORES[distro]
    for type_name, (raw, plain) in roslib.observe("cbor_raw").items():
        assert raw.keys() == {"secs", "nsecs", "bytes"}
        data = bytes(raw["bytes"]["items"])
        name = type_name.replace("/", "/msg/")
        read = store.deserialize_ros1 if distro == "noetic" else store.deserialize_cdr
        message: Any = read(data, name)
        if type_name == "std_msgs/String":
            assert message.data == plain["data"]
        else:
            assert message.header.stamp.sec == 5 and message.header.stamp.nanosec == 7
            assert message.header.frame_id == plain["header"]["frame_id"]


def test_the_robots_own_topics_arrive_in_cbor(roslib: Program) -> None:
    observed = roslib.observe("robot_in_cbor")
    odometry, joints = observed["/odom"], observed["/joint_states"]
    assert odometry["header"]["frame_id"] == "odom"
    for part in ("pose", "twist"):
        assert odometry[part]["covariance"]["kind"] == "Float64Array"
        assert len(odometry[part]["covariance"]["items"]) == 36
    assert all(isinstance(name, str) for name in joints["name"])
    assert len(joints["name"]) == len(joints["position"]["items"]) > 0


def test_the_map_is_the_same_in_every_encoding(roslib: Program) -> None:
    assert roslib.observe("map_in_every_encoding") == {"size": True, "same": True}


def test_pieces_are_joined_by_the_client(roslib2: Program) -> None:
    assert roslib2.observe("pieces") == [True, True, True]


def test_pictures_in_pieces_are_joined_by_the_client(roslib2: Program) -> None:
    assert roslib2.observe("pictures_in_pieces") == [True, True]
