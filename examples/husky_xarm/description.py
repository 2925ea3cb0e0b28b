"""Robot description: one URDF of three parts, and the folders of its meshes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import pybullet_data

from rwt_tf2 import Transform

ROOT: Final = "base_footprint"
BASE: Final = "base_link"
CAMERA: Final = "camera_link"
#: z forwards, x to the right, y down: how ROS gives what a camera sees (REP 103).
OPTICAL: Final = "camera_optical_frame"
LEFT_WHEELS: Final = ("front_left_wheel", "rear_left_wheel")
RIGHT_WHEELS: Final = ("front_right_wheel", "rear_right_wheel")
ARM_JOINTS: Final = ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6")

_DATA: Final = Path(pybullet_data.getDataPath())
PACKAGE_FOLDERS: Final = (_DATA, _DATA / "xarm")
"""Folders of the packages with the meshes: `husky` and `xarm_description`."""
_PACKAGES: Final[Mapping[str, Path]] = {
    "husky": _DATA / "husky",
    "xarm_description": _DATA / "xarm" / "xarm_description",
}

_TOP_PLATE = 0.2243
"""Height of the plate's upper side above base_link, metres: the end of its mesh."""
_MAST = (0.04, 0.04, 0.9)
_CAMERA_SIZE = (0.05, 0.16, 0.05)
#: Downwards, radians, so that the arm's hand and the floor before the robot are in the picture.
_CAMERA_PITCH = 0.5
#: Bullet takes links without a mass for 1 kg: an IMU would weigh as much as a link of the arm.
_LIGHT_LINK = 0.05

_OPTENV = re.compile(r"\$\(optenv \w+ ([^)]*)\)")
"""Remainder of xacro in the Husky's file: a variable with its default."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint.

    Attributes:
        parent: the link it is on.
        child: the link it carries.
        origin: where the child is while the joint is at 0.
        axis: that the child turns around, in its own frame; None for one that never moves.
        lower: end of its range, radians; both ends are 0 for a wheel.
        upper: the other end.
        max_velocity: radians per second; 0 for a wheel.
        max_effort: newton metres; 0 for a wheel.
    """

    name: str
    parent: str
    child: str
    origin: Transform
    axis: tuple[float, float, float] | None
    lower: float
    upper: float
    max_velocity: float
    max_effort: float


@dataclass(frozen=True, slots=True)
class Description:
    """The robot.

    Attributes:
        urdf: with meshes as `package://husky/…` and `package://xarm_description/…`.
        joints: all, in the order of the URDF.
    """

    urdf: str
    joints: tuple[Joint, ...]

    def with_paths(self) -> str:
        """The URDF with the meshes' paths on this machine, for Bullet."""
        text = self.urdf
        for package, folder in _PACKAGES.items():
            text = text.replace(f"package://{package}/", f"{folder}/")
        return text


def describe() -> Description:
    """Put the robot together: a Husky, an xArm 6 on its plate, and a camera on a mast behind the arm."""
    robot = ET.Element("robot", name="husky_xarm")
    robot.extend(_part(_DATA / "husky" / "husky.urdf", "package://husky/"))
    robot.extend(_part(_DATA / "xarm" / "xarm6_robot.urdf", "", without=("world", "world_joint")))
    _mount(robot, "arm_mount", "top_plate_link", "link_base", (0.1, 0.0, _TOP_PLATE))
    _add_camera(robot)
    for link in robot.iter("link"):
        if link.find("inertial") is None:
            link.append(_inertial(_LIGHT_LINK))
    ET.indent(robot)
    text = '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"
    return Description(text, tuple(map(_joint, robot.iter("joint"))))


def _part(file: Path, package: str, without: tuple[str, ...] = ()) -> Iterator[ET.Element]:
    """The links and joints of a file, with what stands in them alone.

    Both files name their materials Red, Blue and so on and mean different colours, so the colours go where
    they are used, under names of their own.
    """
    part = ET.parse(file).getroot()
    colours = {material.get("name"): material.find("color") for material in part.iterfind("material")}
    for each in part.iter("color"):
        each.set("rgba", " ".join(each.get("rgba", "").split()))  # viewers part them at each space
    for element in part:
        if element.tag not in ("link", "joint") or element.get("name") in without:
            continue
        for contact in element.findall("contact"):  # Bullet's springs in the tyres: the robot would bounce
            element.remove(contact)
        for mesh in element.iter("mesh"):
            name = mesh.get("filename", "")
            mesh.set("filename", name if name.startswith("package://") else package + name)
        for material in element.iter("material"):
            colour = colours.get(material.get("name"))
            if colour is not None:
                material.append(colour)
                material.set("name", f"{file.stem}_{material.get('name')}")
        for origin in element.iter("origin"):
            origin.attrib = {key: _OPTENV.sub(r"\1", value) for key, value in origin.attrib.items()}
        yield element


def _add_camera(robot: ET.Element) -> None:
    """A mast behind the arm and a camera on it, which looks forwards and down over the arm."""
    for name, size, colour in (
        ("camera_mast_link", _MAST, "0.6 0.6 0.6 1"),
        (CAMERA, _CAMERA_SIZE, "0.1 0.1 0.1 1"),
    ):
        link = ET.SubElement(robot, "link", name=name)
        visual = ET.SubElement(link, "visual")
        ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_texts(size))
        ET.SubElement(ET.SubElement(visual, "material", name=f"{name}_colour"), "color", rgba=colour)
        link.append(_inertial(0.5))
    ET.SubElement(robot, "link", name=OPTICAL)
    height = _MAST[2]
    _mount(
        robot, "camera_mast_joint", "top_plate_link", "camera_mast_link", (-0.36, 0, _TOP_PLATE + height / 2)
    )
    _mount(robot, "camera_joint", "camera_mast_link", CAMERA, (0.04, 0, height / 2), (0, _CAMERA_PITCH, 0))
    _mount(robot, "camera_optical_joint", CAMERA, OPTICAL, (0.026, 0, 0), (-1.5707963268, 0, -1.5707963268))


def _mount(
    robot: ET.Element,
    name: str,
    parent: str,
    child: str,
    xyz: tuple[float, ...],
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> None:
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_texts(xyz), rpy=_texts(rpy))


def _inertial(mass: float) -> ET.Element:
    """A compact thing of so many kilograms."""
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "mass", value=f"{mass:g}")
    moment = f"{mass / 100:g}"
    ET.SubElement(inertial, "inertia", ixx=moment, ixy="0", ixz="0", iyy=moment, iyz="0", izz=moment)
    return inertial


def _joint(element: ET.Element) -> Joint:
    origin, axis, limit = element.find("origin"), element.find("axis"), element.find("limit")
    xyz, rpy = (_vector(origin, "xyz"), _vector(origin, "rpy")) if origin is not None else ((0.0,) * 3,) * 2
    limits = {} if limit is None else limit.attrib
    return Joint(
        element.get("name", ""),
        _link_of(element, "parent"),
        _link_of(element, "child"),
        Transform.from_rpy((xyz[0], xyz[1], xyz[2]), *rpy),
        None if element.get("type") == "fixed" or axis is None else _vector(axis, "xyz"),
        *(float(limits.get(key, "0")) for key in ("lower", "upper", "velocity", "effort")),
    )


def _link_of(joint: ET.Element, role: str) -> str:
    link = joint.find(role)
    return "" if link is None else link.get("link", "")


def _vector(element: ET.Element, name: str) -> tuple[float, float, float]:
    x, y, z = map(float, element.get(name, "0 0 0").split())
    return x, y, z


def _texts(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.10g}" for value in values)
