"""Clouds in Draco's form: errors, order, what point_cloud_transport reads, and hostile data."""

from __future__ import annotations

import struct
import sys
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces.point_clouds.compressed import compress, decompress
from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_interfaces.point_clouds.wish import DRACO, PLANES, CloudWish

DracoPy = pytest.importorskip("DracoPy")

KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
POINT = np.dtype(
    [
        ("t", "<f8"),
        ("x", "<f4"),
        ("intensity", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("pad", "V3"),
        ("ring", "<u2"),
        ("rgb", "<f4"),
        ("class", "<i1"),
        ("pair", "<i4", (2,)),
    ]
)
"""A point with every kind of field, in an order and with a gap that no encoder would choose."""


def points(count: int = 3000) -> np.ndarray[Any, Any]:
    draw = np.random.default_rng(5)
    turn = np.linspace(0, 6.28, count)
    found = np.zeros(count, POINT)
    reach = 8 + np.sin(5 * turn) + draw.normal(0, 0.02, count)
    found["x"], found["y"], found["z"] = reach * np.cos(turn), reach * np.sin(turn), 0.1 * reach
    found["intensity"] = 100 + 50 * np.sin(turn)
    found["t"], found["ring"] = draw.normal(size=count), draw.integers(0, 2**16, count)
    found["rgb"] = draw.integers(0, 2**32, count, np.uint32).view("<f4")
    found["class"] = draw.integers(-128, 128, count)
    found["pair"] = draw.integers(-(2**31), 2**31, (count, 2))
    return found


def cloud(sent: np.ndarray[Any, Any], height: int = 1, *, is_bigendian: bool = False) -> Any:
    fields = []
    for name, (kind, offset, *_) in (sent.dtype.fields or {}).items():
        if kind.kind != "V" or kind.shape:
            count = kind.shape[0] if kind.shape else 1
            datatype = KINDS[kind.base.str[1:]]
            fields.append(SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count))
    step, width = sent.dtype.itemsize, len(sent) // height
    return SimpleNamespace(
        header=None,
        height=height,
        width=width,
        fields=fields,
        is_bigendian=is_bigendian,
        point_step=step,
        row_step=step * width,
        data=sent.tobytes(),
        is_dense=False,
    )


def received(message: Mapping[str, Any]) -> Any:
    return SimpleNamespace(**{**message, "fields": [SimpleNamespace(**each) for each in message["fields"]]})


def records(found: Mapping[str, Any]) -> np.ndarray[Any, Any]:
    names = {number: kind for kind, number in KINDS.items()}
    fields = found["fields"]
    formats = [f"({each.count},)<{names[each.datatype]}" for each in fields]
    kind = np.dtype(
        {
            "names": [each.name for each in fields],
            "formats": formats,
            "offsets": [each.offset for each in fields],
            "itemsize": found["point_step"],
        }
    )
    return np.frombuffer(found["data"], kind)


def by_draco(**members: Any) -> CloudWish:
    return CloudWish(format=DRACO, **members)


@pytest.mark.parametrize("precision", [0.0001, 0.001, 0.05])
def test_fields_keep_their_largest_errors_and_points_their_order(precision: float) -> None:
    sent = points()
    message = compress(cloud(sent, height=3), by_draco(precision=precision))
    found = decompress(received(message))
    assert (message["format"], found["height"], found["width"]) == (DRACO, 3, 1000)
    got = records(found)
    for axis in "xyz":
        assert np.abs(got[axis][:, 0].astype(float) - sent[axis]).max() <= precision
    error = np.abs(got["intensity"][:, 0].astype(float) - sent["intensity"]).max()
    assert 0 < error <= np.ptp(sent["intensity"]) / 256
    for name in ("t", "ring", "rgb", "class", "pair"):
        assert got[name].tobytes() == sent[name].tobytes()


def test_other_programs_find_each_attribute_at_its_field() -> None:
    """The plugin of point_cloud_transport copies the bytes of attribute i to the offset of field i."""
    sent = points()
    for order in ("keep", "any"):
        message = received(compress(cloud(sent), by_draco(order=order)))
        attributes = DracoPy.decode(message.compressed_data).attributes
        copied = np.zeros((len(sent), message.point_step), np.uint8)
        for field, attribute in zip(message.fields, attributes, strict=False):
            kind = {2: "u1", 4: "<u2", 9: "<f4"}[attribute["data_type"]]
            octets = attribute["data"].astype(kind, order="C").view(np.uint8)
            copied[:, field.offset : field.offset + octets.shape[1]] = octets
        names = [field.name for field in message.fields]
        assert names == ["x", "t", "intensity", "ring", "rgb", "class", "pair", "y", "z"]
        assert copied.tobytes() == decompress(message)["data"]


def test_points_may_be_sorted() -> None:
    sent = np.random.default_rng(1).permutation(points(20_000)[["x", "y", "z", "ring"]])
    kept, free = (compress(cloud(sent), by_draco(order=order)) for order in ("keep", "any"))
    assert len(free["compressed_data"]) < 0.8 * len(kept["compressed_data"])
    got = records(decompress(received(free)))
    # Points stay whole: the ring, which is exact, leads to the place.
    before, after = (np.lexsort([each[name].reshape(-1) for name in ("x", "ring")]) for each in (sent, got))
    assert (got["ring"][after, 0] == sent["ring"][before]).all()
    assert np.abs(np.sort(got["x"][:, 0]) - np.sort(sent["x"])).max() <= 0.001


@pytest.mark.parametrize(("order", "count"), [("keep", 50), ("any", 1)])
def test_equal_points_stay_apart_if_the_order_does(order: Any, count: int) -> None:
    sent = np.ones(50, [(axis, "<f4") for axis in "xyz"])
    assert len(records(decompress(received(compress(cloud(sent), by_draco(order=order)))))) == count


def test_points_without_a_place_are_left_out() -> None:
    sent = points(100)
    sent["x"][[0, 7]], sent["z"][99] = np.nan, np.inf
    sent["intensity"][50] = np.nan
    found = decompress(received(compress(cloud(sent, height=2), by_draco())))
    assert (found["height"], found["width"], found["is_dense"]) == (1, 97, True)
    kept = np.delete(sent, [0, 7, 99])
    assert records(found)["ring"][:, 0].tolist() == kept["ring"].tolist()
    assert records(found)["intensity"].tobytes() == kept["intensity"].tobytes()


def test_viewers_get_the_fields_that_they_request_of_big_endian_clouds_too() -> None:
    sent = points(200)[["x", "y", "z", "intensity", "ring"]].astype(
        [("x", ">f4"), ("y", ">f4"), ("z", ">f4"), ("intensity", ">f4"), ("ring", ">u2")]
    )
    wish = by_draco(fields=("ring", "z", "y", "x"), stride=2)
    found = decompress(received(compress(cloud(sent, is_bigendian=True), wish)))
    assert [(each.name, each.offset) for each in found["fields"]] == [
        ("x", 0),
        ("ring", 12),
        ("y", 4),
        ("z", 8),
    ]
    assert records(found)["ring"][:, 0].tolist() == sent["ring"][::2].tolist()
    assert np.abs(records(found)["y"][:, 0] - sent["y"][::2]).max() <= 0.001


@pytest.mark.parametrize(
    ("sent", "wish"),
    [
        (points(10), {"precision": 0}),
        (points(10), {"precision": 1e-7}),
        (points(10), {"fields": ("x", "y", "ring")}),
        (points(0), {}),
        (np.ones(9, [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]), {}),
        (np.ones(9, [*[(axis, "<f4") for axis in "xyz"], ("many", "<i4", (200,))]), {}),
        (np.ones(9, [(axis, "<f4") for axis in "xyz"] + [(f"f{at}", "<u1") for at in range(100)]), {}),
    ],
)
def test_clouds_that_draco_cannot_hold_have_the_other_form(
    sent: np.ndarray[Any, Any], wish: Mapping[str, Any]
) -> None:
    message = compress(cloud(sent), by_draco(**wish))
    assert message["format"] == PLANES
    assert decompress(received(message))["width"] == len(sent)


def test_without_the_library_clouds_have_the_other_form(monkeypatch: pytest.MonkeyPatch) -> None:
    draco = received(compress(cloud(points(10)), by_draco()))
    monkeypatch.delitem(sys.modules, "rwt_interfaces.point_clouds.draco", raising=False)
    monkeypatch.setattr("rwt_interfaces.point_clouds.compressed.find_spec", lambda name: None)
    assert compress(cloud(points(10)), by_draco())["format"] == PLANES
    with pytest.raises(InvalidCloud, match="needs DracoPy"):
        decompress(draco)


@given(
    st.lists(
        st.tuples(*[st.floats(width=32, allow_nan=False, allow_infinity=False)] * 4), min_size=1, max_size=40
    ),
    st.floats(1e-6, 100),
    st.sampled_from(["keep", "any"]),
)
def test_the_largest_error_is_kept_of_any_numbers(
    places: list[tuple[float, ...]], precision: float, order: Any
) -> None:
    sent = np.array(places, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("reflectivity", "<f4")])
    message = compress(cloud(sent), by_draco(precision=precision, order=order))
    got = records(decompress(received(message)))
    assert message["format"] == PLANES or order == "any" or got.shape == sent.shape
    before, after = (
        np.stack([each[axis].reshape(-1).astype(float) for axis in "xyz"], axis=1) for each in (sent, got)
    )
    distances = np.abs(before[:, None] - after[None]).max(axis=2)
    assert distances.min(axis=1).max() <= precision and distances.min(axis=0).max() <= precision


WHOLE: bytes = received(compress(cloud(points(100)[["x", "y", "z", "ring"]]), by_draco())).compressed_data
"""Header of 18 bytes, and two attributes of five: the numbers of the second are at byte 26."""


def changed(at: int, new: bytes) -> bytes:
    return WHOLE[:at] + new + WHOLE[at + len(new) :]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "too few for the header"),
        (WHOLE[:25], "too few for 2 attributes"),
        (changed(0, b"DRACA"), "begins with"),
        (changed(7, b"\1"), "begins with"),
        (changed(8, b"\2"), "begins with"),
        (changed(10, b"\x80"), "begins with"),
        (changed(11, struct.pack("<I", 2**32 - 1)), "4294967295 points of 2"),
        (changed(15, b"\2"), "100 points of 2"),
        (changed(16, b"\xff"), "of 255 attributes"),
        (changed(16, b"\0"), "of 0 attributes"),
        (changed(19, b"\xff"), "attribute 0 has 255 numbers"),
        (changed(18, b"\x0c"), "of type 12"),
        (changed(21, b"\x80"), "attribute 0"),
        (WHOLE[:40], "damaged"),
    ],
)
def test_damaged_data_is_rejected(data: bytes, reason: str) -> None:
    message = received(compress(cloud(points(100)[["x", "y", "z", "ring"]]), by_draco()))
    message.compressed_data = data
    with pytest.raises(InvalidCloud, match=reason):
        decompress(message)


def test_larger_clouds_than_permitted_are_rejected() -> None:
    message = received(compress(cloud(points(100)), by_draco()))
    with pytest.raises(InvalidCloud, match="at most 1000 bytes"):
        decompress(message, 1000)
