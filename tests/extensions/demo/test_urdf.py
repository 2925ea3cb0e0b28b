"""The description is a tree of links that agrees with what `/tf` says."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from rwt.extensions.demo.arm.kinematics import ARM
from rwt.extensions.demo.drive import Chassis
from rwt.extensions.demo.model.urdf import BASE, arm_mounts, fixed_mounts, urdf, visuals, wheel_mounts

ROBOT = ET.fromstring(urdf(Chassis()))


def test_it_has_every_link_and_each_hangs_on_the_base() -> None:
    links = {link.get("name") for link in ROBOT.findall("link")}
    wheels = {"left_wheel_link", "right_wheel_link"}
    arm = {joint.link for joint in ARM} | {"arm_base_link", "tool_link"}
    assert links == {BASE, "laser", "caster_link", "camera_link", "camera_optical_frame"} | wheels | arm
    parents = {}
    for joint in ROBOT.iter("joint"):
        (parent,), (child,) = joint.findall("parent"), joint.findall("child")
        assert child.get("link") not in parents
        parents[child.get("link")] = parent.get("link")
    assert parents.keys() == links - {BASE}
    for link in links:
        at: str | None = link
        for _ in range(len(links)):
            at = parents.get(at, at)
        assert at == BASE


def test_the_arm_has_six_joints_with_limits() -> None:
    joints = [joint for joint in ROBOT.iter("joint") if joint.get("type") == "revolute"]
    assert [joint.get("name") for joint in joints] == [joint.name for joint in ARM]
    for element, joint in zip(joints, ARM, strict=True):
        axis, limit = element.find("axis"), element.find("limit")
        assert axis is not None and limit is not None
        assert axis.get("xyz") == {"y": "0 1 0", "z": "0 0 1"}[joint.axis]
        assert float(limit.get("upper") or 0) == -float(limit.get("lower") or 0) == joint.limit
        assert float(limit.get("velocity") or 0) == joint.speed
        assert abs(joint.rest) < joint.limit


def test_joints_are_where_the_mounts_are() -> None:
    for mount in (*fixed_mounts(Chassis()), *wheel_mounts(Chassis()), *arm_mounts()):
        (joint,) = (j for j in ROBOT.iter("joint") if j.find(f"child[@link='{mount.link}']") is not None)
        origin = joint.find("origin")
        assert origin is not None
        place = [float(part) for part in (origin.get("xyz") or "").split()]
        assert place == pytest.approx([mount.x, mount.y, mount.z])
        turn = [float(part) for part in (origin.get("rpy") or "").split()]
        assert turn == pytest.approx(mount.rpy, abs=1e-5)


def test_wheels_turn_and_stand_on_the_floor() -> None:
    turning = {joint.get("name") for joint in ROBOT.iter("joint") if joint.get("type") == "continuous"}
    assert turning == {"left_wheel_joint", "right_wheel_joint"}
    assert all(mount.z == Chassis().wheel_radius for mount in wheel_mounts(Chassis()))


def test_a_mesh_hides_the_same_shape_within_it() -> None:
    drawn = {str(link.get("name")): link for link in ROBOT.findall("link") if len(link)}
    assert drawn.keys() == visuals(Chassis()).keys()
    for name, link in drawn.items():
        mesh, within, bumper = (_shape(part) for part in (*link.findall("visual"), link.find("collision")))
        assert mesh.attrib == {"filename": f"package://rwt_demo/meshes/{name}.dae"}
        assert within.tag == bumper.tag
        for inner, outer in zip(_sizes(within), _sizes(bumper), strict=True):
            assert 0.0019 < outer - inner < 0.0041


def _shape(part: ET.Element | None) -> ET.Element:
    """Return the element at this position in a link."""
    assert part is not None
    (shape,) = part.findall("geometry/*")
    return shape


def _sizes(shape: ET.Element) -> list[float]:
    return [float(value) for values in shape.attrib.values() for value in values.split()]
