"""The buffer against an independent one, on trees, times and rotations that hypothesis thinks up."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt_tf2 import Buffer, ExtrapolationError, StampedTransform, Transform
from rwt_tf2.quaternion import from_rpy, multiply, slerp
from tests.core.tf2.oracle import Oracle, interpolated, matrix_of

pytestmark = pytest.mark.slow

LENGTH = st.floats(-100, 100)
ANGLE = st.floats(-3.1, 3.1)
TRANSFORMS = st.builds(
    lambda x, y, z, roll, pitch, yaw: Transform.from_rpy((x, y, z), roll, pitch, yaw),
    LENGTH, LENGTH, LENGTH, ANGLE, ANGLE, ANGLE,
)  # fmt: skip
STAMPS = st.lists(st.integers(1, 5000), min_size=2, max_size=5, unique=True)
MS = 1_000_000


@st.composite
def trees(draw: st.DrawFn) -> list[StampedTransform]:
    """A tree of up to eight frames, each with a few transforms in any order; all cover 1000 to 4000 ms."""
    stamped: list[StampedTransform] = []
    for number in range(1, draw(st.integers(2, 8))):
        parent = f"f{draw(st.integers(0, number - 1))}"
        stamped.extend(
            StampedTransform(parent, f"f{number}", stamp * MS, draw(TRANSFORMS))
            for stamp in [*draw(STAMPS), 1000, 4000]
        )
    unique = {(each.child, each.stamp_ns): each for each in stamped}
    return draw(st.permutations(list(unique.values())))


@settings(max_examples=60)
@given(trees(), st.data())
def test_lookups(tree: list[StampedTransform], data: st.DataObject) -> None:
    buffer, oracle = Buffer(), Oracle()
    for stamped in tree:
        buffer.set_transform(stamped)
        oracle.add(stamped)
    frames = st.sampled_from(buffer.frames())
    for _ in range(5):
        target, source = data.draw(frames), data.draw(frames)
        time = data.draw(st.integers(1000 * MS, 4000 * MS))
        found = buffer.lookup_transform(target, source, time)
        np.testing.assert_allclose(
            matrix_of(found.transform), oracle.lookup(target, source, time), rtol=0, atol=1e-6
        )
        np.testing.assert_allclose(found.transform.matrix(), matrix_of(found.transform), rtol=0, atol=1e-9)


@settings(max_examples=60)
@given(trees())
def test_all_times_are_covered_or_refused(tree: list[StampedTransform]) -> None:
    buffer = Buffer()
    for stamped in tree:
        buffer.set_transform(stamped)
    for child in {each.child for each in tree}:
        stamps = [each.stamp_ns for each in tree if each.child == child]
        parent = buffer.parent(child)
        assert parent is not None
        assert buffer.lookup_transform(parent, child).stamp_ns == max(stamps)
        for outside in (min(stamps) - 1, max(stamps) + 1):
            with pytest.raises(ExtrapolationError) as failure:
                buffer.lookup_transform(parent, child, outside)
            assert failure.value.future == (outside > max(stamps))
            assert failure.value.nearest_ns in (min(stamps), max(stamps))


@given(TRANSFORMS, TRANSFORMS, st.floats(0, 1))
def test_interpolation(a: Transform, b: Transform, fraction: float) -> None:
    if a.angle_to(b) > 3.0:
        return  # Half a turn has two shortest ways.
    np.testing.assert_allclose(
        matrix_of(a.interpolated(b, fraction)),
        interpolated(matrix_of(a), matrix_of(b), fraction),
        rtol=0,
        atol=1e-7,
    )


@given(TRANSFORMS, TRANSFORMS)
def test_products_and_inverses(a: Transform, b: Transform) -> None:
    np.testing.assert_allclose(matrix_of(a @ b), matrix_of(a) @ matrix_of(b), rtol=0, atol=1e-9)
    np.testing.assert_allclose(matrix_of(a.inverse()), np.linalg.inv(matrix_of(a)), rtol=0, atol=1e-9)
    points = np.arange(12.0).reshape(2, 2, 3)
    homogeneous = np.concatenate([points, np.ones((2, 2, 1))], axis=-1)
    np.testing.assert_allclose(
        a.apply_all(points), (homogeneous @ matrix_of(a).T)[..., :3], rtol=0, atol=1e-9
    )


@given(ANGLE, st.floats(-1.55, 1.55), ANGLE)
def test_angles_come_back(roll: float, pitch: float, yaw: float) -> None:
    assert Transform.from_rpy((0, 0, 0), roll, pitch, yaw).rpy() == pytest.approx(
        (roll, pitch, yaw), abs=1e-6
    )


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("yaw", [-1.0, 0.0, 2.5])
def test_angles_at_the_poles_give_the_same_rotation(pitch: float, yaw: float) -> None:
    there = Transform.from_rpy((0, 0, 0), 0.4, pitch, yaw)
    assert Transform.from_rpy((0, 0, 0), *there.rpy()).angle_to(there) < 1e-6


@given(st.floats(1e-12, 1e-3), st.floats(0, 1))
def test_small_angles_are_exact(angle: float, fraction: float) -> None:
    start = from_rpy(0.3, 0.2, 0.1)
    end = multiply(start, from_rpy(0.0, 0.0, angle))
    middle = Transform(rotation=slerp(start, end, fraction))
    assert middle.angle_to(Transform(rotation=start)) == pytest.approx(angle * fraction, abs=1e-15, rel=1e-3)
