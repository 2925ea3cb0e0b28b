"""Point clouds are read as a slow reader of the message's definition reads them, and thinned as they say."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_interfaces.point_clouds.records import cloud_of, every, one_per_voxel, read_points

#: `sensor_msgs/PointField`'s constants and the letters of Python's struct.
LETTERS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


@dataclass
class Field:
    name: str
    offset: int
    datatype: int = 7
    count: int = 1


@dataclass
class Cloud:
    """`sensor_msgs/PointCloud2`."""

    width: int = 0
    height: int = 1
    fields: Sequence[Field] = ()
    point_step: int = 0
    row_step: int = 0
    data: bytes = b""
    is_bigendian: bool = False
    is_dense: bool = True
    header: object = "a header"


XYZ = [Field("x", 0), Field("y", 4), Field("z", 8)]


def _cloud(points: Any, fields: Any = XYZ, **how: Any) -> Cloud:
    """Points of three floats each, as one row."""
    data = b"".join(struct.pack("<3f", *point) for point in points)
    return Cloud(len(points), 1, list(fields), 12, 12 * len(points), data, **how)


def _slowly(cloud: Cloud) -> list[list[dict[str, tuple[float, ...]]]]:
    """Every value by struct, by the comments of PointCloud2.msg and PointField.msg."""
    order = ">" if cloud.is_bigendian else "<"
    return [
        [
            {
                f.name: struct.unpack_from(
                    f"{order}{f.count}{LETTERS[f.datatype]}",
                    cloud.data,
                    row * cloud.row_step + column * cloud.point_step + f.offset,
                )
                for f in cloud.fields
            }
            for column in range(cloud.width)
        ]
        for row in range(cloud.height)
    ]


def _values(record: Any, name: str) -> tuple[float, ...]:
    return tuple(np.atleast_1d(record[name]).tolist())


@st.composite
def clouds(draw: st.DrawFn) -> Cloud:
    """Fields with gaps between them, rows with padding, bytes of anything."""
    fields, end = [], 0
    for number in range(draw(st.integers(1, 5))):
        datatype, count = draw(st.sampled_from(list(LETTERS))), draw(st.integers(1, 3))
        offset = end + draw(st.integers(0, 3))
        end = offset + struct.calcsize(LETTERS[datatype]) * count
        fields.append(Field(f"f{number}", offset, datatype, count))
    step = end + draw(st.integers(0, 5))
    width, height = draw(st.integers(0, 5)), draw(st.integers(0, 4))
    row_step = step * width + draw(st.integers(0, 7))
    data = draw(st.binary(min_size=row_step * height, max_size=row_step * height + 5))
    return Cloud(width, height, draw(st.permutations(fields)), step, row_step, data, draw(st.booleans()))


@given(clouds())
def test_reading_is_what_the_definition_says(cloud: Cloud) -> None:
    points = read_points(cloud)
    slow = _slowly(cloud)
    assume(cloud.width and cloud.height)
    assert points.shape == (cloud.height, cloud.width)
    for row, records in zip(slow, points, strict=True):
        for values, record in zip(row, records, strict=True):
            for name, expected in values.items():
                assert np.array_equal(_values(record, name), expected, equal_nan=True)


@given(clouds(), st.integers(1, 4))
def test_every_few_points_keep_all_their_bytes(cloud: Cloud, stride: int) -> None:
    assume(cloud.width and cloud.height)
    thin: Mapping[str, Any] = cloud_of(every(read_points(cloud), stride), cloud)
    rows = range(0, cloud.height, stride if cloud.height > 1 else 1)
    places = [r * cloud.row_step + c * cloud.point_step for r in rows for c in range(0, cloud.width, stride)]
    expected = b"".join(cloud.data[place : place + cloud.point_step] for place in places)
    assert thin["data"] == expected
    assert (thin["header"], thin["fields"]) == (cloud.header, cloud.fields)
    assert (thin["is_bigendian"], thin["is_dense"]) == (cloud.is_bigendian, cloud.is_dense)
    again = Cloud(**thin)
    assert again.width * again.height == len(places)
    assert again.row_step == again.width * again.point_step
    assert read_points(again).shape == (again.height, again.width)


@given(
    st.builds(
        Cloud,
        st.integers(0, 2**32 - 1),
        st.integers(0, 2**32 - 1),
        st.lists(
            st.builds(
                Field,
                st.sampled_from(["x", "y", "z", "", "\0"]),
                st.integers(0, 2**32 - 1) | st.integers(0, 20),
                st.integers(0, 10),
                st.integers(0, 2**32 - 1) | st.integers(0, 3),
            ),
            max_size=4,
        ),
        st.integers(0, 2**32 - 1) | st.integers(0, 40),
        st.integers(0, 2**32 - 1) | st.just(0),
        st.binary(max_size=60),
        st.booleans(),
    )
)
def test_whatever_comes_is_read_or_refused(cloud: Cloud) -> None:
    try:
        points = read_points(cloud)
        cloud_of(one_per_voxel(every(points, 2), 0.1), cloud)
    except InvalidCloud as error:
        assert str(error)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"fields": [Field("x", 0, 9)]}, "field x: datatype 9 is none of 1 to 8"),
        ({"fields": [Field("x", 9)]}, "field x ends at byte 13 of points of 12 bytes"),
        ({"fields": [Field("x", 0, 8, 2)]}, "field x ends at byte 16 of points of 12 bytes"),
        ({"fields": [Field("x", 0), Field("x", 4)]}, 'a field is called "x"'),
        ({"fields": [Field("", 0)]}, 'a field is called ""'),
        ({"data": bytes(23)}, "23 bytes are no cloud of 2x1 points of 12 bytes, 24 a row"),
        ({"row_step": 23}, "24 bytes are no cloud of 2x1 points of 12 bytes, 23 a row"),
        ({"height": 2}, "24 bytes are no cloud of 2x2 points"),
        ({"point_step": 0}, "points of 0 bytes; 1 to"),
        ({"point_step": 2**31}, "points of 2147483648 bytes; 1 to"),
    ],
)
def test_bad_clouds_are_refused(change: dict[str, Any], reason: str) -> None:
    good = _cloud([(1, 2, 3), (4, 5, 6)])
    assert read_points(good)["y"].tolist() == [[2, 5]]
    with pytest.raises(InvalidCloud, match=reason.replace("(", r"\(")):
        read_points(replace(good, **change))


def test_a_row_step_of_nothing_means_no_padding() -> None:
    assert read_points(replace(_cloud([(1, 2, 3), (4, 5, 6)]), row_step=0))["z"].tolist() == [[3, 6]]


places = st.lists(st.tuples(*[st.floats(-9, 9, width=32)] * 3), max_size=30)


@given(places, st.sampled_from([0.25, 1.0, 4.0]))
def test_one_point_of_each_cube_and_the_first(points: list[tuple[float, float, float]], size: float) -> None:
    cloud = _cloud(points)
    kept = one_per_voxel(read_points(cloud), size)
    firsts: dict[tuple[int, ...], tuple[float, ...]] = {}
    for point in points:
        firsts.setdefault(tuple(math.floor(value / size) for value in point), point)
    assert [(r["x"], r["y"], r["z"]) for r in kept[0]] == list(firsts.values())


def test_points_without_a_place_are_left_out() -> None:
    nowhere = [(math.nan, 0, 0), (0, math.inf, 0), (0, 0, -math.inf), (3e38, 0, 0)]
    kept = one_per_voxel(read_points(_cloud([*nowhere, (1, 1, 1)])), 0.1)
    assert kept.shape == (1, 1)
    assert kept[0, 0]["x"] == 1


def test_what_has_no_place_cannot_be_thinned_by_cubes() -> None:
    for fields in ([Field("x", 0), Field("y", 4)], [Field("x", 0), Field("y", 4), Field("z", 8, 1, 2)]):
        with pytest.raises(InvalidCloud, match="the points have no field z of one number"):
            one_per_voxel(read_points(_cloud([(1, 2, 3)], fields)), 0.1)


def test_points_without_fields_are_only_bytes() -> None:
    cloud = _cloud([(1, 2, 3), (4, 5, 6), (7, 8, 9)], [])
    assert cloud_of(every(read_points(cloud), 2), cloud)["data"] == cloud.data[:12] + cloud.data[24:]


def test_numbers_of_any_kind_are_places() -> None:
    fields = [Field("x", 0, 3), Field("y", 2, 3), Field("z", 4, 8)]
    data = struct.pack(">hhdhhd", 1, -2, 0.5, 1, -2, 0.6)
    kept = one_per_voxel(read_points(Cloud(2, 1, fields, 12, 24, data, True)), 1.0)
    assert [tuple(record) for record in kept[0]] == [(1, -2, 0.5)]
