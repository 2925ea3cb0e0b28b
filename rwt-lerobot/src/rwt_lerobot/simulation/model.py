"""Model of MuJoCo: its joints, actuators, cameras and sensors, and its description as URDF."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

from rwt_lerobot.joints.limits import USUAL_SPEED, JointLimit
from rwt_tf2 import Transform
from rwt_tf2.quaternion import to_rpy

ARM: Final = Path(__file__).with_name("arm.xml")
"""The six-joint arm."""

WORLD: Final = "world"
HOME: Final = "home"
"""Keyframe at the start and after a reset, if the model has one."""


class ModelError(Exception):
    """A model cannot be used; the text gives the reason."""


@dataclass(frozen=True, slots=True)
class ModelJoint:
    """Hinge or slide of a model.

    Attributes:
        limit: name and limits.
        position: index of its position in `qpos`.
        velocity: index of its velocity in `qvel`.
        actuator: index of its position actuator; None if it has none.
    """

    limit: JointLimit
    position: int
    velocity: int
    actuator: int | None


class Model:
    """Compiled model.

    Args:
        path: MJCF or URDF file.

    Attributes:
        mujoco: the module.
        compiled: MuJoCo's `MjModel`.
        joints: hinges and slides with a name.
        cameras: names of cameras, with their vertical field of view in radians.
        sensors: names of sensors, with the range of their values in `sensordata`.
        other_actuators: names of actuators that are not those of joints' positions, with their index.

    Raises:
        ModelError: MuJoCo is not installed, or cannot read the file.
    """

    def __init__(self, path: Path) -> None:
        # Read when MuJoCo is imported; EGL renders without a display.
        os.environ.setdefault("MUJOCO_GL", "egl")
        try:
            import mujoco
        except ImportError as error:
            raise ModelError("MuJoCo is not installed: pip install 'rwt-lerobot[mujoco]'") from error
        self.mujoco: Any = mujoco
        try:
            self.compiled = model = mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise ModelError(f"{path}: {error}") from error
        self.joints = tuple(self._joints())
        driven = {joint.actuator for joint in self.joints}
        self.cameras = {
            name: math.radians(float(model.cam_fovy[index]))
            for index, name in _named(model.camera, model.ncam)
        }
        self.sensors = {
            name: slice(int(model.sensor_adr[index]), int(model.sensor_adr[index] + model.sensor_dim[index]))
            for index, name in _named(model.sensor, model.nsensor)
        }
        self.other_actuators = {
            name: index for index, name in _named(model.actuator, model.nu) if index not in driven
        }

    def _joints(self) -> Iterator[ModelJoint]:
        mujoco, model = self.mujoco, self.compiled
        kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
        actuators = {
            int(model.actuator_trnid[index][0]): index
            for index in range(model.nu)
            if int(model.actuator_trntype[index]) == int(mujoco.mjtTrn.mjTRN_JOINT)
            # A position actuator: its force falls with the position by as much as it rises with the command.
            and model.actuator_biasprm[index][1] == -model.actuator_gainprm[index][0] != 0
        }
        for index, name in _named(model.joint, model.njnt):
            if int(model.jnt_type[index]) not in kinds:
                continue
            lower, upper = model.jnt_range[index] if model.jnt_limited[index] else (-math.pi, math.pi)
            speed = float(model.jnt_user[index][0]) if model.nuser_jnt else 0.0
            yield ModelJoint(
                JointLimit(name, float(lower), float(upper), speed or USUAL_SPEED),
                int(model.jnt_qposadr[index]),
                int(model.jnt_dofadr[index]),
                actuators.get(index),
            )

    def body_name(self, index: int) -> str:
        """Return the frame of a body."""
        return WORLD if index == 0 else self.compiled.body(index).name or f"body_{index}"

    def urdf(self) -> str:
        """Return the bodies with their primitive shapes; meshes are left out."""
        robot = ET.Element("robot", name="mujoco")
        for body in range(self.compiled.nbody):
            self._add_link(robot, body)
        for body in range(1, self.compiled.nbody):
            self._add_joint(robot, body)
        return ET.tostring(robot, encoding="unicode")

    def _add_link(self, robot: ET.Element, body: int) -> None:
        model, link = self.compiled, ET.SubElement(robot, "link", name=self.body_name(body))
        for index in range(model.ngeom):
            shape = self._shape(index) if model.geom_bodyid[index] == body else None
            if shape is None:
                continue
            visual = ET.SubElement(link, "visual")
            _add_origin(visual, model.geom_pos[index], model.geom_quat[index])
            ET.SubElement(visual, "geometry").append(shape)
            colour = " ".join(f"{float(part):.3g}" for part in model.geom_rgba[index])
            material = ET.SubElement(visual, "material", name=f"colour_{index}")
            ET.SubElement(material, "color", rgba=colour)

    def _shape(self, index: int) -> ET.Element | None:
        kinds, model = self.mujoco.mjtGeom, self.compiled
        a, b, c = (float(size) for size in model.geom_size[index])
        kind = int(model.geom_type[index])
        if kind == int(kinds.mjGEOM_BOX):
            return ET.Element("box", size=f"{2 * a} {2 * b} {2 * c}")
        if kind == int(kinds.mjGEOM_SPHERE):
            return ET.Element("sphere", radius=f"{a}")
        if kind == int(kinds.mjGEOM_CYLINDER):
            return ET.Element("cylinder", radius=f"{a}", length=f"{2 * b}")
        if kind == int(kinds.mjGEOM_CAPSULE):
            return ET.Element("cylinder", radius=f"{a}", length=f"{2 * (a + b)}")
        return None

    def _add_joint(self, robot: ET.Element, body: int) -> None:
        model = self.compiled
        count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
        found = [each for each in self.joints if count and each.limit.name == model.joint(first).name]
        hinge = int(self.mujoco.mjtJoint.mjJNT_HINGE)
        # Several joints of one body, and free bodies, have no counterpart: their frames come from /tf alone.
        kind = (
            "fixed"
            if count != 1 or not found
            else ("revolute" if int(model.jnt_type[first]) == hinge else "prismatic")
        )
        name = found[0].limit.name if kind != "fixed" else f"{self.body_name(body)}_mount"
        joint = ET.SubElement(robot, "joint", name=name, type=kind)
        ET.SubElement(joint, "parent", link=self.body_name(int(model.body_parentid[body])))
        ET.SubElement(joint, "child", link=self.body_name(body))
        _add_origin(joint, model.body_pos[body], model.body_quat[body])
        if kind != "fixed":
            limit = found[0].limit
            ET.SubElement(joint, "axis", xyz=" ".join(f"{float(part):g}" for part in model.jnt_axis[first]))
            ET.SubElement(
                joint, "limit", lower=f"{limit.lower}", upper=f"{limit.upper}", velocity=f"{limit.speed}",
                effort="0",
            )  # fmt: skip


def _named(find: Callable[[int], Any], count: int) -> Iterator[tuple[int, str]]:
    """Yield the index and name of each part of a model that has a name."""
    for index in range(count):
        if name := find(index).name:
            yield index, name


def pose(position: Any, wxyz: Any) -> Transform:
    """Return a transform; MuJoCo's quaternions begin with w."""
    w, x, y, z = map(float, wxyz)
    px, py, pz = map(float, position)
    return Transform((px, py, pz), (x, y, z, w))


def _add_origin(element: ET.Element, position: Any, wxyz: Any) -> None:
    rpy = to_rpy(pose(position, wxyz).rotation)
    ET.SubElement(
        element,
        "origin",
        xyz=" ".join(f"{float(part):.6g}" for part in position),
        rpy=" ".join(f"{part:.6g}" for part in rpy),
    )
