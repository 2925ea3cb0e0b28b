"""Poses: composition and its inverse, arcs, angles."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.demo.world.map import Pose, wrap_angle

coordinate = st.floats(-100, 100)
poses = st.builds(Pose, coordinate, coordinate, st.floats(-math.pi, math.pi))


@given(poses, poses)
def test_seen_from_undoes_after(base: Pose, relative: Pose) -> None:
    back = base.after(relative).seen_from(base)
    assert (back.x, back.y) == pytest.approx((relative.x, relative.y), abs=1e-9)
    assert wrap_angle(back.heading - relative.heading) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_a_half_circle_ends_opposite() -> None:
    pose = Pose().moved(linear=math.pi, angular=math.pi, seconds=1.0)
    assert (pose.x, pose.y) == pytest.approx((0.0, 2.0))
    assert pose.heading == pytest.approx(math.pi)


def test_a_tiny_turn_is_nearly_straight() -> None:
    assert Pose().moved(1.0, 1e-12, 1.0).x == pytest.approx(1.0)
    assert Pose().moved(1.0, 1e-6, 1.0).x == pytest.approx(1.0)
