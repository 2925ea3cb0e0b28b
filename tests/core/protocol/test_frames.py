"""A frame is framed once for each kind of wire that it meets."""

from __future__ import annotations

from rwt_protocol.frames import Frame


class CountingFraming:
    """A framing that counts how often it is asked."""

    def __init__(self, mark: bytes) -> None:
        self.mark = mark
        self.asked = 0

    def __call__(self, frame: Frame) -> bytes:
        self.asked += 1
        return self.mark + frame.data


def test_parts_are_joined_and_counted() -> None:
    frame = Frame(b'{"msg":', memoryview(b"[1]"), b"}")
    assert (frame.data, frame.size, frame.binary) == (b'{"msg":[1]}', 11, False)


def test_framed_once_for_each_kind_of_wire() -> None:
    frame = Frame(b"x")
    plain, compressed, third = CountingFraming(b"p"), CountingFraming(b"c"), CountingFraming(b"t")
    for _ in range(3):
        assert [frame.framed(framing) for framing in (plain, compressed, third)] == [b"px", b"cx", b"tx"]
    assert (plain.asked, compressed.asked, third.asked) == (1, 1, 1)


def test_cut_once_for_each_size() -> None:
    cuts: list[int] = []

    def cut(frame: Frame, size: int) -> list[Frame]:
        cuts.append(size)
        return [frame]

    frame = Frame(b"x")
    for size in (10, 20, 10, 20):
        assert frame.pieces(size, cut) == [frame]
    assert cuts == [10, 20]
