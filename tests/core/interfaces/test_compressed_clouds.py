"""Compressed clouds: every number within its largest error, in its order, and damaged data is rejected."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces import Payload, Registry
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.point_clouds.compressed import compress, decompress
from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_interfaces.point_clouds.planes import MAGIC, pack, unpack
from rwt_interfaces.point_clouds.wish import COMPRESSED, PLANES, CloudWish

VECTORS: Sequence[Mapping[str, Any]] = json.loads(
    (Path(__file__).parents[3] / "docs/reference/point-clouds.vectors.json").read_text(encoding="utf-8")
)
TYPES = {1: "<i1", 2: "<u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
LASER = (("x", 7, 1), ("y", 7, 1), ("z", 7, 1), ("intensity", 7, 1))


def field(name: str, offset: int, datatype: int = 7, count: int = 1) -> SimpleNamespace:
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


def cloud(data: bytes, fields: Sequence[SimpleNamespace], step: int, width: int, **others: Any) -> Any:
    head = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=2), frame_id="laser")
    usual = {"header": head, "height": 1, "is_bigendian": False, "row_step": step * width, "is_dense": False}
    return SimpleNamespace(
        **usual | {"data": data, "fields": fields, "point_step": step, "width": width} | others
    )


def of_array(places: np.ndarray[Any, Any]) -> Any:
    """Return a cloud of rows of 32-bit floats."""
    names = [name for name, _, _ in LASER][: places.shape[1]]
    fields = [field(name, 4 * at) for at, name in enumerate(names)]
    return cloud(places.astype("<f4").tobytes(), fields, 4 * len(names), len(places))


def received(message: Mapping[str, Any]) -> Any:
    """Return a compressed cloud as an object."""
    fields = [SimpleNamespace(**each) for each in message["fields"]]
    return SimpleNamespace(**{**message, "fields": fields})


def numbers(found: Mapping[str, Any], columns: int) -> np.ndarray[Any, Any]:
    return np.frombuffer(found["data"], "<f4").reshape(-1, columns)


def ordered(count: int = 3000) -> np.ndarray[Any, Any]:
    """Return points around a sensor in the order of its turn, with noise of 2 cm."""
    turn = np.linspace(0, 2 * math.pi, count)
    reach = 8 + np.sin(5 * turn) + np.random.default_rng(4).normal(0, 0.02, count)
    return np.stack(
        [reach * np.cos(turn), reach * np.sin(turn), 0.1 * reach, 100 + 50 * np.sin(turn)], axis=1
    )


@pytest.mark.parametrize("precision", [0.0005, 0.001, 0.05])
def test_the_largest_error_is_kept_and_the_order(precision: float) -> None:
    sent = ordered().astype("<f4")
    found = numbers(decompress(received(compress(of_array(sent), CloudWish(precision=precision)))), 4)
    assert np.abs(found[:, :3].astype(float) - sent[:, :3]).max() <= precision
    assert np.abs(found[:, 3].astype(float) - sent[:, 3]).max() <= np.ptp(sent[:, 3]) / 256


@given(
    st.lists(st.tuples(*[st.floats(width=32, allow_nan=False, allow_infinity=False)] * 3), max_size=40),
    st.floats(1e-6, 100),
)
def test_the_largest_error_is_kept_of_any_numbers(places: list[tuple[float, ...]], precision: float) -> None:
    sent = np.array(places, "<f4").reshape(-1, 3)
    found = numbers(decompress(received(compress(of_array(sent), CloudWish(precision=precision)))), 3)
    assert found.shape == sent.shape
    assert not len(sent) or np.abs(found.astype(float) - sent.astype(float)).max() <= precision


@given(st.data())
def test_lossless_clouds_are_as_they_were(data: st.DataObject) -> None:
    kinds = data.draw(
        st.lists(st.tuples(st.sampled_from(sorted(TYPES)), st.integers(1, 3)), min_size=1, max_size=4)
    )
    fields, step = [], 0
    for number, (datatype, count) in enumerate(kinds):
        fields.append(field(f"f{number}", step, datatype, count))
        step += np.dtype(TYPES[datatype]).itemsize * count
    rows, width = data.draw(st.integers(0, 3)), data.draw(st.integers(0, 50))
    octets = data.draw(st.binary(min_size=step * rows * width, max_size=step * rows * width))
    sent = cloud(octets, fields, step, width, height=rows)
    assert decompress(received(compress(sent, CloudWish(precision=0))))["data"] == octets


def test_gaps_stay_gaps_and_cost_no_error() -> None:
    sent = ordered(200)
    sent[[0, 5, 6, 199], :3] = np.nan
    sent[7, 0] = np.inf
    found = numbers(decompress(received(compress(of_array(sent), CloudWish()))), 4)
    assert (np.isnan(found) == ~np.isfinite(sent)).all()
    assert np.nanmax(np.abs(found[:, :3] - np.where(np.isfinite(sent), sent, np.nan)[:, :3])) <= 0.001


def test_colours_and_integers_are_exact_beside_quantised_places() -> None:
    record = np.zeros(
        100, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<f4"), ("ring", "<u2"), ("t", "<f8")]
    )
    draw = np.random.default_rng(3)
    record["rgb"] = draw.integers(0, 2**24, 100, np.uint32).view("<f4")
    record["ring"], record["t"] = draw.integers(0, 64, 100), draw.normal(size=100)
    fields = [
        field(*each) for each in (("x", 0), ("y", 4), ("z", 8), ("rgb", 12), ("ring", 16, 4), ("t", 18, 8))
    ]
    found = decompress(received(compress(cloud(record.tobytes(), fields, 26, 100), CloudWish())))
    assert (
        np.frombuffer(found["data"], record.dtype)[["rgb", "ring", "t"]].tobytes()
        == record[["rgb", "ring", "t"]].tobytes()
    )


def test_big_endian_clouds_and_padded_rows_become_plain() -> None:
    sent = np.arange(12, dtype=">f4").reshape(2, 6)
    padded = b"".join(row.tobytes() + b"pad!" for row in sent)
    fields = [field("x", 0), field("y", 4), field("z", 8)]
    big = cloud(padded, fields, 12, 2, height=2, is_bigendian=True, row_step=28)
    found = decompress(received(compress(big, CloudWish())))
    assert (found["height"], found["width"], found["row_step"], found["is_bigendian"]) == (2, 2, 24, False)
    assert np.abs(numbers(found, 3) - sent.reshape(-1, 3)).max() <= 0.001


def test_a_viewer_gets_the_fields_and_points_that_it_requests() -> None:
    sent = of_array(ordered())
    wish = CloudWish(fields=("z", "x"), crop=(0, -20, -20, 20, 20, 20), stride=4)
    found = decompress(received(compress(sent, wish)))
    assert [(each.name, each.offset) for each in found["fields"]] == [("z", 0), ("x", 4)]
    every = ordered()[::4]
    expected = every[every[:, 0] >= 0]
    assert found["point_step"] == 8 and found["is_dense"] and found["width"] == len(expected)
    assert np.abs(numbers(found, 2) - expected[:, [2, 0]]).max() <= 0.001
    few = decompress(received(compress(sent, CloudWish(voxel=2.0))))
    assert 0 < few["width"] < 100


def test_a_cloud_without_an_order_is_sorted_if_that_is_permitted() -> None:
    sent = np.random.default_rng(1).permutation(ordered(20_000)).astype("<f4")
    kept = compress(of_array(sent), CloudWish())
    free = compress(of_array(sent), CloudWish(order="any"))
    assert len(free["compressed_data"]) < 0.7 * len(kept["compressed_data"])
    assert np.abs(numbers(decompress(received(kept)), 4)[:, :3] - sent[:, :3]).max() <= 0.001
    found = numbers(decompress(received(free)), 4)
    # Sorted alike, within the error: as many points in each slice.
    assert np.abs(np.sort(found[:, 0]) - np.sort(sent[:, 0])).max() <= 0.001
    in_order = compress(of_array(ordered(20_000)), CloudWish(order="any"))
    assert np.abs(numbers(decompress(received(in_order)), 4)[:, :3] - ordered(20_000)[:, :3]).max() <= 0.001


@pytest.mark.parametrize("extent", [1e-44, 3e38])
def test_clouds_of_any_extent_may_be_sorted(extent: float) -> None:
    sent = np.random.default_rng(1).choice([-extent, extent], (50, 3)).astype("<f4")
    found = decompress(received(compress(of_array(sent), CloudWish(precision=0, order="any"))))
    assert np.array_equal(np.sort(numbers(found, 3), axis=0), np.sort(sent, axis=0))


@pytest.mark.parametrize("fields", [(), ("x", "w")])
def test_clouds_without_the_fields_are_refused(fields: tuple[str, ...]) -> None:
    sent = of_array(ordered(10)) if fields else cloud(b"", (), 4, 0)
    with pytest.raises(InvalidCloud, match="no field"):
        compress(sent, CloudWish(fields=fields))


@pytest.mark.parametrize("distro", DISTROS)
def test_the_message_type_is_known(distro: str) -> None:
    message_type = Registry(DISTROS[distro]).message(COMPRESSED)
    message = compress(of_array(ordered(10)), CloudWish())
    head = {"frame_id": "laser"}
    payload = Payload.from_value(message_type, {**message, "header": head}, lambda: 0)
    value: Any = payload.value()
    assert value.format == PLANES
    assert numbers(decompress(value), 4).shape == (10, 4)


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_vectors_of_the_reference(vector: Mapping[str, Any]) -> None:
    message = {**vector["message"], "header": None}
    message["compressed_data"] = bytes.fromhex(message["compressed_data"])
    found = decompress(received(message))
    assert found["data"].hex() == vector["data"]


def bomb(content: int, points: int = 100) -> bytes:
    """Return data of one byte plane whose frame declares and has so many bytes."""
    whole = pack([np.zeros(points, "<i1")], [0.0])
    head = bytearray(whole[:26])
    head[17] = 1
    return bytes(head) + zstandard.compress(b"\0" * content)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "too few"),
        (bomb(100)[:25], "too few"),
        (b"RWPD" + bomb(100)[4:], "begins with"),
        (MAGIC + b"\x02" + bomb(100)[5:], "begins with"),
        (MAGIC + b"\x01\x02" + bomb(100)[6:], "begins with"),
        (bomb(100, 99), "99 points"),
        (bomb(100)[:12] + bytes(4) + bomb(100)[16:], "lag of 0"),
        (bomb(100)[:12] + b"\x65\0\0\0" + bomb(100)[16:], "lag of 101"),
        (bomb(100)[:16] + b"\x01" + bomb(100)[17:], "mode 1"),
        (bomb(100)[:17] + b"\x02" + bomb(100)[18:], "2 planes"),
        (bomb(100)[:18] + np.float64("nan").tobytes() + bomb(100)[26:], "step nan"),
        (bomb(1 << 30), "do not declare 100 bytes"),
        (bomb(100) + b"x", "damaged"),
        (bomb(100)[:-1], "damaged"),
        (bomb(100)[:26], "damaged"),
    ],
)
def test_damaged_data_is_rejected(data: bytes, reason: str) -> None:
    with pytest.raises(InvalidCloud, match=reason):
        unpack(data, ["<i1"], 100)


def test_a_big_endian_message_is_rejected() -> None:
    message = received(compress(of_array(ordered(10)), CloudWish()))
    message.is_bigendian = True
    with pytest.raises(InvalidCloud, match="big-endian"):
        decompress(message)


def test_larger_clouds_than_permitted_are_rejected_before_anything_is_read() -> None:
    message = received(compress(of_array(ordered(10)), CloudWish()))
    message.width = 2**32 - 1
    with pytest.raises(InvalidCloud, match="at most 1000 bytes"):
        decompress(message, 1000)
    message.width, message.fields = 10, [field(f"f{number}", 0) for number in range(300)]
    with pytest.raises(InvalidCloud, match="10 points of 300 numbers"):
        decompress(message)
    message.format = "zlib"
    with pytest.raises(InvalidCloud, match='in the format "zlib"'):
        decompress(message)
