"""The description is a tree of links that agrees with what `/tf` says."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from rwt_nodes.demo.drive import Chassis
from rwt_nodes.demo.urdf import BASE, fixed_mounts, urdf, wheel_mounts

ROBOT = ET.fromstring(urdf(Chassis()))


def test_it_has_every_link_and_each_hangs_on_the_base() -> None:
    links = {link.get("name") for link in ROBOT.findall("link")}
    wheels = {"left_wheel_link", "right_wheel_link"}
    assert links == {BASE, "laser", "caster_link", "camera_link", "camera_optical_frame"} | wheels
    assert len(list(ROBOT.iter("joint"))) == len(links) - 1
    assert {element.get("link") for element in ROBOT.iter("child")} == links - {BASE}
    assert {element.get("link") for element in ROBOT.iter("parent")} == {BASE, "camera_link"}


def test_joints_are_where_the_mounts_are() -> None:
    for mount in (*fixed_mounts(Chassis()), *wheel_mounts(Chassis())):
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


def test_every_link_can_be_drawn_and_bumped_into() -> None:
    for link in ROBOT.findall("link"):
        if link.get("name") == "camera_optical_frame":
            continue
        for part in ("visual", "collision"):
            geometry = link.find(f"{part}/geometry")
            assert geometry is not None
            assert len(geometry) == 1
