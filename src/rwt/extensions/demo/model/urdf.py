"""The robot's description: links, joints and shapes, as URDF."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from rwt.extensions.demo.arm.kinematics import ARM, ArmJoint
from rwt.extensions.demo.drive import Chassis
from rwt.extensions.demo.model.meshes import Visual, mesh_url
from rwt.extensions.demo.model.shapes import Cuboid, Cylinder, Sphere, text

BASE = "base_link"
LASER = "laser"
CASTER = "caster_link"
CAMERA = "camera_link"
#: Rotation of an optical frame: z forward, x right, y down (REP 103).
OPTICAL = "camera_optical_frame"
#: Name of that frame in drivers of OpenNI cameras.
OPENNI_OPTICAL = "camera_rgb_optical_frame"
ARM_BASE = "arm_base_link"
#: Tip of the hand, with z outwards.
TOOL = "tool_link"
LEFT_WHEEL = "left_wheel_link"
RIGHT_WHEEL = "right_wheel_link"
LEFT_JOINT = "left_wheel_joint"
RIGHT_JOINT = "right_wheel_joint"

#: Heights above the floor, metres.
_BODY_HEIGHT = 0.12
_GROUND_CLEARANCE = 0.03
_LASER_SIZE = (0.035, 0.04)  # radius, height
_CASTER_RADIUS = 0.03
_CAMERA_SIZE = (0.03, 0.1, 0.03)
_CAMERA_HEIGHT = 0.3
#: Behind the laser, out of the camera's view.
_ARM_X = -0.12
_ARM_BASE_SIZE = (0.04, ARM[0].height)  # radius, height
_ARM_COLOURS = ((0.9, 0.5, 0.1), (0.85, 0.85, 0.85))
_BLACK = (0.1, 0.1, 0.1)
_WHEEL_WIDTH = 0.03
#: Margin by which a shape is smaller than its mesh, so that the mesh hides it.
_INSET = 0.002


@dataclass(frozen=True, slots=True)
class Mount:
    """Position of a link on its parent, in metres; :data:`BASE` is on the floor between the wheels.

    Wheels turn around y, which is an axle across the robot.

    Attributes:
        rpy: rotation about the parent's x, y and z, in this order; radians.
    """

    link: str
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    parent: str = BASE
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)


def fixed_mounts(chassis: Chassis) -> tuple[Mount, ...]:
    """Return the fixed links."""
    return (
        Mount(LASER, z=_GROUND_CLEARANCE + _BODY_HEIGHT + _LASER_SIZE[1] / 2),
        Mount(CASTER, x=-chassis.radius + 2 * _CASTER_RADIUS, z=_CASTER_RADIUS),
        camera_mount(chassis),
        Mount(OPTICAL, parent=CAMERA, rpy=(-math.pi / 2, 0.0, -math.pi / 2)),
        Mount(ARM_BASE, x=_ARM_X, z=_GROUND_CLEARANCE + _BODY_HEIGHT),
        Mount(TOOL, z=ARM[-1].length, parent=ARM[-1].link),
    )


def camera_mount(chassis: Chassis) -> Mount:
    """Return the camera, which looks forward from a mast."""
    return Mount(CAMERA, x=chassis.radius / 2, z=_CAMERA_HEIGHT)


def wheel_mounts(chassis: Chassis) -> tuple[Mount, Mount]:
    """Return the left and the right wheel."""
    half, up = chassis.track / 2, chassis.wheel_radius
    return Mount(LEFT_WHEEL, y=half, z=up), Mount(RIGHT_WHEEL, y=-half, z=up)


def arm_mounts() -> tuple[Mount, ...]:
    """Return the links of the arm, in the order of its joints, at joint angles of 0."""
    parents = (ARM_BASE, *(joint.link for joint in ARM))
    return tuple(
        Mount(joint.link, z=joint.height, parent=parent) for joint, parent in zip(ARM, parents, strict=False)
    )


def visuals(chassis: Chassis) -> Mapping[str, Visual]:
    """Return the visuals by link, around their origins."""
    wheel = Visual(Cylinder(chassis.wheel_radius, _WHEEL_WIDTH), _BLACK)
    return {
        BASE: Visual(Cylinder(chassis.radius, _BODY_HEIGHT), (0.2, 0.4, 0.8)),
        LASER: Visual(Cylinder(*_LASER_SIZE), _BLACK),
        CASTER: Visual(Sphere(_CASTER_RADIUS), (0.6, 0.6, 0.6)),
        CAMERA: Visual(Cuboid(*_CAMERA_SIZE), _BLACK),
        LEFT_WHEEL: wheel,
        RIGHT_WHEEL: wheel,
        ARM_BASE: Visual(Cylinder(*_ARM_BASE_SIZE), (0.2, 0.2, 0.2)),
        **{
            joint.link: Visual(Cylinder(joint.radius, joint.length), _ARM_COLOURS[number % 2])
            for number, joint in enumerate(ARM)
        },
    }


def urdf(chassis: Chassis) -> str:
    """Return the description as XML text."""
    robot = ET.Element("robot", name="demo_robot")
    seen = visuals(chassis)
    _link(robot, BASE, seen, "0 0 0.09")
    laser, caster, camera, optical, arm_base, tool = fixed_mounts(chassis)
    for joint, mount in (("laser", laser), ("caster", caster), ("camera", camera)):
        _link(robot, mount.link, seen)
        _joint(robot, f"{joint}_joint", mount)
    _frame(robot, "camera_optical_joint", optical)
    for joint, mount in zip((LEFT_JOINT, RIGHT_JOINT), wheel_mounts(chassis), strict=True):
        # Cylinders are along z: a quarter turn around x puts it on the axle.
        _link(robot, mount.link, seen, rpy="1.5707963 0 0")
        _joint(robot, joint, mount, axis="0 1 0")
    _link(robot, ARM_BASE, seen, f"0 0 {text(ARM[0].height / 2)}")
    _joint(robot, "arm_base_joint", arm_base)
    for arm_joint, mount in zip(ARM, arm_mounts(), strict=True):
        _link(robot, arm_joint.link, seen, f"0 0 {text(arm_joint.length / 2)}")
        _arm_joint(robot, arm_joint, mount)
    _frame(robot, "tool_joint", tool)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _link(
    robot: ET.Element, name: str, visuals: Mapping[str, Visual], xyz: str = "0 0 0", rpy: str = "0 0 0"
) -> None:
    visual = visuals[name]
    link = ET.SubElement(robot, "link", name=name)
    mesh = ET.Element("mesh", filename=mesh_url(name))
    for part, geometry in (
        ("visual", mesh),
        ("visual", visual.shape.element(_INSET)),
        ("collision", visual.shape.element()),
    ):
        element = ET.SubElement(link, part)
        ET.SubElement(element, "origin", xyz=xyz, rpy=rpy)
        ET.SubElement(element, "geometry").append(geometry)
        if part == "visual":
            material = ET.SubElement(element, "material", name=f"{name}_colour")
            ET.SubElement(material, "color", rgba=f"{_texts(visual.colour)} 1")


def _frame(robot: ET.Element, joint: str, mount: Mount) -> None:
    """Return a link that is only a frame, without visual or collision."""
    ET.SubElement(robot, "link", name=mount.link)
    _joint(robot, joint, mount)


def _arm_joint(robot: ET.Element, joint: ArmJoint, mount: Mount) -> None:
    axis = "0 1 0" if joint.axis == "y" else "0 0 1"
    element = _joint(robot, joint.name, mount, axis, kind="revolute")
    limit, speed = text(joint.limit), text(joint.speed)
    ET.SubElement(element, "limit", lower=f"-{limit}", upper=limit, velocity=speed, effort="10")


def _joint(
    robot: ET.Element, name: str, mount: Mount, axis: str | None = None, kind: str = "continuous"
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type="fixed" if axis is None else kind)
    ET.SubElement(joint, "parent", link=mount.parent)
    ET.SubElement(joint, "child", link=mount.link)
    ET.SubElement(joint, "origin", xyz=_texts((mount.x, mount.y, mount.z)), rpy=_texts(mount.rpy))
    if axis is not None:
        ET.SubElement(joint, "axis", xyz=axis)
    return joint


def _texts(values: tuple[float, ...]) -> str:
    return " ".join(map(text, values))
