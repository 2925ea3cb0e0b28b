"""`tf2_geometry_msgs`: points, vectors, poses and wrenches in another frame."""

from __future__ import annotations

import copy
from typing import Any

from rwt_rclpy.companions.tf2_ros import TransformRegistration
from rwt_rclpy.messages.loaded import message_class
from rwt_tf2.messages import read_transform
from rwt_tf2.transform import Transform


def _turned(transform: Any) -> Transform:
    return Transform((0.0, 0.0, 0.0), read_transform(transform).transform.rotation)


def _move(vector: Any, by: Transform) -> None:
    vector.x, vector.y, vector.z = map(float, by.apply((vector.x, vector.y, vector.z)))


def do_transform_point(point: Any, transform: Any) -> Any:
    """Return a `PointStamped` in the frame of a transform."""
    moved = copy.deepcopy(point)
    _move(moved.point, read_transform(transform).transform)
    moved.header = transform.header
    return moved


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """Return a `Vector3Stamped` in the frame of a transform: rotated, not translated."""
    moved = copy.deepcopy(vector3)
    _move(moved.vector, _turned(transform))
    moved.header = transform.header
    return moved


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """Return a `Pose` in the frame of a transform."""
    moved = copy.deepcopy(pose)
    turned = pose.orientation
    place = Transform(
        (pose.position.x, pose.position.y, pose.position.z), (turned.x, turned.y, turned.z, turned.w)
    )
    result = read_transform(transform).transform @ place
    moved.position.x, moved.position.y, moved.position.z = map(float, result.translation)
    rotation = moved.orientation
    rotation.x, rotation.y, rotation.z, rotation.w = map(float, result.rotation)
    return moved


def do_transform_pose_stamped(pose: Any, transform: Any) -> Any:
    """Return a `PoseStamped` in the frame of a transform."""
    moved = copy.deepcopy(pose)
    moved.pose = do_transform_pose(pose.pose, transform)
    moved.header = transform.header
    return moved


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """Return a `PoseWithCovarianceStamped` in the frame of a transform, with rotated covariance."""
    import numpy as np

    moved = copy.deepcopy(pose)
    moved.pose.pose = do_transform_pose(pose.pose.pose, transform)
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = _turned(transform).matrix()[:3, :3]
    covariance = turn @ np.reshape(pose.pose.covariance, (6, 6)) @ turn.T
    moved.pose.covariance = covariance.ravel()
    moved.header = transform.header
    return moved


def do_transform_wrench(wrench: Any, transform: Any) -> Any:
    """Return a `WrenchStamped` in the frame of a transform: force and torque are rotated."""
    moved = copy.deepcopy(wrench)
    turn = _turned(transform)
    _move(moved.wrench.force, turn)
    _move(moved.wrench.torque, turn)
    moved.header = transform.header
    return moved


def _register() -> None:
    known = TransformRegistration()
    for name, function in (
        ("PointStamped", do_transform_point),
        ("Vector3Stamped", do_transform_vector3),
        ("PoseStamped", do_transform_pose_stamped),
        ("PoseWithCovarianceStamped", do_transform_pose_with_covariance_stamped),
        ("WrenchStamped", do_transform_wrench),
    ):
        known.add(message_class(f"geometry_msgs/{name}"), function)


_register()
