"""`describe` of nodes and clients: the description, and transforms from joint states."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, TypeAlias

import pytest

from rwt import BlockingNode, InvalidDescription, Server
from rwt_client.blocking import BlockingRobot, connect
from tests.waiting import wait_until

Robot: TypeAlias = "BlockingNode | BlockingRobot"

ARM = """<robot name="arm">
  <link name="base"/><link name="upper"/><link name="left"/><link name="right"/><link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="finger" type="prismatic"><parent link="upper"/><child link="left"/><axis xyz="0 1 0"/></joint>
  <joint name="other_finger" type="prismatic"><parent link="upper"/><child link="right"/><axis xyz="0 1 0"/>
    <mimic joint="finger" multiplier="-1"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="1 0 0"/></joint>
</robot>"""


@pytest.fixture(params=["jazzy", "noetic"])
def node(request: pytest.FixtureRequest) -> Iterator[BlockingNode]:
    with Server("ws://127.0.0.1:0", distro=request.param) as robot:
        yield robot


@pytest.fixture(params=["node", "client"])
def robot(request: pytest.FixtureRequest, node: BlockingNode) -> Iterator[Robot]:
    with ExitStack() as stack:
        yield node if request.param == "node" else stack.enter_context(connect(node.server.urls[0]))


def move(node: BlockingNode, stamp: int, **joints: float) -> None:
    state = {
        "header": {"stamp": {"sec": stamp, "nanosec": 0}},
        "name": list(joints),
        "position": list(joints.values()),
    }
    node.publish("/joint_states", state, "sensor_msgs/JointState")


def hear(node: BlockingNode) -> list[Any]:
    """Return a list that grows by the transforms of `/tf`."""
    heard: list[Any] = []
    node.subscribe("/tf", lambda message: heard.extend(message.transforms), "tf2_msgs/TFMessage")
    return heard


def test_links_follow_the_joint_states(node: BlockingNode, robot: Robot) -> None:
    node.tf.start()
    with robot.describe(ARM):
        robot.topics()  # The answer comes after a client's subscription.
        move(node, 7, shoulder=1.5707963267948966, finger=0.1, unknown=1.0)
        tool = node.tf.lookup("base", "tool", timeout=10.0)
        assert tool.stamp_ns == 7_000_000_000
        assert tool.transform.translation == pytest.approx((0.0, 1.0, 0.5))
        fingers = [node.tf.lookup("upper", each).transform.translation[1] for each in ("left", "right")]
        assert fingers == pytest.approx([0.1, -0.1])


def test_the_description_is_latched_until_it_is_closed(node: BlockingNode, robot: Robot) -> None:
    description = robot.describe(ARM)
    assert node.once("/robot_description", "std_msgs/String", timeout=10.0).data == ARM
    heard = hear(node)
    robot.topics()
    move(node, 1, shoulder=0.0)
    wait_until(lambda: len(heard) == 1)
    description.close()
    move(node, 2, shoulder=0.0)
    robot.topics()  # A joint state before the answer would have been delivered.
    move(node, 3, shoulder=0.0)
    assert len(heard) == 1


def test_a_description_that_is_invalid_changes_nothing(node: BlockingNode, robot: Robot) -> None:
    with pytest.raises(InvalidDescription, match="expected <robot>"):
        robot.describe("<sdf/>")
    for rate in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(ValueError, match="publish_frequency"):
            robot.describe(ARM, publish_frequency=rate)
    assert "/robot_description" not in [topic.name for topic in node.topics()]


def test_each_joint_is_published_at_most_at_the_frequency(node: BlockingNode) -> None:
    heard = hear(node)
    with node.describe(ARM, frame_prefix="anna/", publish_frequency=0.5):
        for stamp in (10, 11, 12):
            move(node, stamp, shoulder=0.0)
        move(node, 11, finger=0.0)
        move(node, 5, shoulder=0.0)  # a recording that starts again
        node.clock.sleep(0.0)
    seconds = "sec" if hasattr(heard[0].header.stamp, "sec") else "secs"
    assert [(each.child_frame_id, getattr(each.header.stamp, seconds)) for each in heard] == [
        ("anna/upper", 10),
        ("anna/upper", 12),
        ("anna/left", 11),
        ("anna/right", 11),
        ("anna/upper", 5),
    ]


def test_states_without_a_position_for_each_name_move_nothing(
    node: BlockingNode, caplog: pytest.LogCaptureFixture
) -> None:
    heard = hear(node)
    with node.describe(ARM):
        for positions in ([], [0.1], [0.1], [float("nan"), 0.1]):
            state = {"name": ["shoulder", "finger"], "position": positions}
            node.publish("/joint_states", state, "sensor_msgs/JointState")
        node.clock.sleep(0.0)
    assert [each.child_frame_id for each in heard] == ["left", "right"]
    assert [each.getMessage() for each in caplog.records if "positions" in each.getMessage()] == [
        "/joint_states: 2 names, but 1 positions; such messages move no frame"
    ]


def test_a_node_has_the_description_as_parameter(node: BlockingNode) -> None:
    name = "/robot:robot_description" if node.node.distro.parameters_belong_to_nodes else "/robot_description"
    for urdf in (ARM, ARM.replace("arm", "other")):
        node.describe(urdf).close()
        assert node.params.get(name) == urdf
