"""Recordings of some kilobytes that unpack to gigabytes or to millions of records.

Memory and time are limited, and the commands report what they leave out.
"""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final

import lz4.frame
import pytest
import yaml
import zstandard
from mcap.opcode import Opcode
from rosbags.rosbag2 import StoragePlugin

from rwt.extensions.recording import open_recording
from rwt.extensions.recording.mcap_index import CHUNK_MESSAGES, HEAD, MAGIC
from tests.extensions.recording.robots import record_robot
from tests.extensions.recording.test_bags import write_bag
from tests.faults.limited import Ended, run_command, run_limited

GROWN_BYTES: Final = 400 * 2**20
"""Limit of the growth of a command: the libraries, the largest chunk, and two copies of its message."""

CLAIMED: Final = 1_000_000
BOMB_BYTES: Final = 3 * 2**28

PACK: Final[dict[str, Callable[[bytes], bytes]]] = {
    "lz4": lz4.frame.compress,
    "zstd": zstandard.compress,
    "bz2": bz2.compress,
}


def _record(opcode: int, content: bytes) -> bytes:
    return HEAD.pack(opcode, len(content)) + content


def _string(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _chunk(data: bytes, compression: str, claimed: int, times: tuple[int, int] = (1, 1)) -> bytes:
    head = struct.pack("<QQQI", *times, claimed, 0) + _string(compression)
    return _record(Opcode.CHUNK, head + struct.pack("<Q", len(data)) + data)


def _packed_zeros(compression: str, size: int) -> bytes:
    """Compressed zeros, made without having them."""
    if compression == "zstd":
        packer = zstandard.ZstdCompressor(level=1).compressobj()
        pieces = [packer.compress(bytes(2**24)) for _ in range(size // 2**24)]
        return b"".join(pieces) + packer.flush()
    if compression == "bz2":
        packing = bz2.BZ2Compressor()
        return b"".join(packing.compress(bytes(2**24)) for _ in range(size // 2**24)) + packing.flush()
    frame = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    head = frame.begin()
    data: bytes = head + b"".join(frame.compress(bytes(2**24)) for _ in range(size // 2**24)) + frame.flush()
    return data


def _cut_file(path: Path, *chunks: bytes) -> Path:
    """Write an MCAP file without an index."""
    path.write_bytes(MAGIC + _record(Opcode.HEADER, _string("ros2") + _string("")) + b"".join(chunks))
    return path


def _indexed_file(path: Path, *chunks: bytes, repeated: int = 1) -> Path:
    """Write an MCAP file with an index that names each chunk `repeated` times."""
    content = MAGIC + _record(Opcode.HEADER, _string("ros2") + _string(""))
    index = _record(Opcode.SCHEMA, struct.pack("<H", 1) + _string("std_msgs/msg/String") + _string("ros2msg")
                    + _string("string data\n"))  # fmt: skip
    index += _record(Opcode.CHANNEL, struct.pack("<HH", 0, 1) + _string("/words") + _string("cdr") + bytes(4))
    for chunk in chunks:
        where = struct.pack("<QQQQ", 1, 2, len(content), len(chunk)) + bytes(4) + bytes(8) + _string("zstd")
        index += _record(Opcode.CHUNK_INDEX, where + struct.pack("<QQ", len(chunk), 0)) * repeated
        content += chunk
    counted = struct.pack("<QHIIIIQQ", 1, 1, 1, 0, 0, len(chunks), 1, 2) + bytes(4)
    content += _record(Opcode.DATA_END, bytes(4))
    footer = struct.pack("<QQI", len(content), 0, 0)
    path.write_bytes(
        content + index + _record(Opcode.STATISTICS, counted) + _record(Opcode.FOOTER, footer) + MAGIC
    )
    return path


_PLAY: Final = "print(sum(1 for _ in open_recording([Path({path!r})]).messages())) or 0"
_IMPORTS: Final = "from pathlib import Path; from rwt.extensions.recording import open_recording"


def _read(path: Path) -> Ended:
    """Read all messages as a player does."""
    return run_limited(_PLAY.format(path=str(path)), _IMPORTS)


def _commands(path: Path) -> list[Ended]:
    to = str(path.with_name("whole.mcap"))
    words = (["bag", "info", str(path)], ["bag", "recover", str(path), "-o", to])
    return [*(run_command(each) for each in words), _read(path)]


def _check(*ended: Ended) -> None:
    for each in ended:
        assert each.code in (0, 1), each.output[-2000:]
        assert "Traceback" not in each.output, each.output[-2000:]
        assert each.grown_bytes < GROWN_BYTES, each.grown_bytes


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_that_unpacks_to_more_than_it_claims_is_left_out(tmp_path: Path, compression: str) -> None:
    packed = _packed_zeros(compression, BOMB_BYTES)
    ended = _commands(_cut_file(tmp_path / "run.mcap", _chunk(packed, compression, CLAIMED)))
    _check(*ended)
    assert f"more than {CLAIMED} bytes" in ended[1].output


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_of_empty_records_is_left_out(tmp_path: Path, compression: str) -> None:
    records = bytes(9 * 10_000_000)
    path = _cut_file(tmp_path / "run.mcap", _chunk(PACK[compression](records), compression, len(records)))
    ended = _commands(path)
    _check(*ended)
    assert "too many records" in ended[1].output


def test_a_chunk_of_millions_of_empty_messages_is_left_out(tmp_path: Path) -> None:
    records = _record(Opcode.MESSAGE, bytes(22)) * (CHUNK_MESSAGES + 1)
    path = _cut_file(tmp_path / "run.mcap", _chunk(zstandard.compress(records), "zstd", len(records)))
    ended = _commands(path)
    _check(*ended)
    assert "too many records" in ended[1].output


def test_chunks_of_one_time_are_not_unpacked_all_at_once(tmp_path: Path) -> None:
    size = 100 * 2**20
    message = _record(Opcode.MESSAGE, struct.pack("<HIQQ", 0, 0, 2, 2) + bytes(size))
    chunk = _chunk(zstandard.compress(message), "zstd", len(message))
    ended = _read(_indexed_file(tmp_path / "run.mcap", *[chunk] * 20))
    _check(ended)
    assert "left out" in ended.output


def test_an_index_that_repeats_a_chunk_reads_it_once(tmp_path: Path) -> None:
    message = _record(Opcode.MESSAGE, struct.pack("<HIQQ", 0, 0, 1, 1) + bytes(100 * 2**20))
    chunk = _chunk(zstandard.compress(message), "zstd", len(message))
    ended = _read(_indexed_file(tmp_path / "run.mcap", chunk, repeated=10_000))
    _check(ended)
    assert ended.output.startswith("1\n")


def test_a_chunk_in_the_place_of_the_index_is_not_unpacked(tmp_path: Path) -> None:
    path = _indexed_file(tmp_path / "run.mcap")
    content = path.read_bytes()
    bomb = _chunk(_packed_zeros("lz4", BOMB_BYTES), "lz4", CLAIMED)
    begin = content.index(_record(Opcode.DATA_END, bytes(4))) + HEAD.size + 4
    path.write_bytes(content[:begin] + bomb + content[begin:])
    _check(*_commands(path))


def test_a_sparse_file_is_not_searched_for_records(tmp_path: Path) -> None:
    path = _cut_file(tmp_path / "run.mcap")
    with path.open("rb+") as file:
        file.truncate(2**40)
    _check(*_commands(path))
    with path.open("rb+") as file:
        file.seek(0, 2)
        file.seek(len(MAGIC) + HEAD.size + 12)
        file.write(HEAD.pack(Opcode.CHUNK, 2**39))
    _check(*_commands(path))


# -- bags ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_a_chunk_of_a_bag_of_ros_1_is_unpacked_with_a_limit(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "run.bag"
    write_bag(path)
    content = path.read_bytes()
    packed, field = _packed_zeros(compression, BOMB_BYTES), f"compression={compression}".encode()
    chunk_at, data_at, end = _record_around(content, content.index(b"compression=none"))
    head = content[chunk_at + 4 : data_at].replace(
        struct.pack("<I", 16) + b"compression=none", struct.pack("<I", len(field)) + field
    )
    chunk = struct.pack("<I", len(head)) + head + struct.pack("<I", len(packed)) + packed
    # The index is behind the chunk, and moves with its length.
    index_at = content.index(b"index_pos=") + len(b"index_pos=")
    (position,) = struct.unpack_from("<Q", content, index_at)
    moved = struct.pack("<Q", position + len(chunk) - (end - chunk_at))
    path.write_bytes(content[:index_at] + moved + content[index_at + 8 : chunk_at] + chunk + content[end:])
    ended = _read(path)
    assert "bytes; --chunk-bytes allows more" in ended.output
    assert ended.grown_bytes < GROWN_BYTES


def _record_around(content: bytes, position: int) -> tuple[int, int, int]:
    """Return where the record of a bag begins that has this position, where its data, and where it ends."""
    end = len(b"#ROSBAG V2.0\n")
    while end <= position:
        begin = end
        (head_size,) = struct.unpack_from("<I", content, begin)
        data_at = begin + 4 + head_size
        (data_size,) = struct.unpack_from("<I", content, data_at)
        end = data_at + 4 + data_size
    return begin, data_at, end


def test_an_index_of_a_bag_that_is_read_again_and_again_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "run.bag"
    write_bag(path)
    content = path.read_bytes()
    at = content.index(b"chunk_count=") + len(b"chunk_count=")
    infos = content[_record_around(content, len(content) - 1)[0] :]
    path.write_bytes(content[:at] + struct.pack("<I", 2001) + content[at + 4 :] + infos * 2000)
    ended = _read(path)
    assert "index is larger than the file" in ended.output


def _compressed_folder(path: Path, plugin: StoragePlugin, mode: str) -> Path:
    write_bag(path, plugin)
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    information.update(compression_mode=mode, compression_format="zstd")
    file = path / str(information["relative_file_paths"][0])
    if mode == "FILE":
        packed = file.with_name(file.name + ".zstd")
        packed.write_bytes(zstandard.compress(file.read_bytes()))
        file.unlink()
        information["relative_file_paths"] = [packed.name]
        file = packed
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    return file


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_compressed_folder_is_read(tmp_path: Path, plugin: StoragePlugin) -> None:
    _compressed_folder(tmp_path / "run", plugin, "FILE")
    write_bag(tmp_path / "plain", plugin)
    with open_recording([tmp_path / "run"]) as recording, open_recording([tmp_path / "plain"]) as plain:
        assert list(recording.messages()) == list(plain.messages())
        assert recording.topics == plain.topics


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_compressed_file_of_a_folder_does_not_fill_the_disk(tmp_path: Path, plugin: StoragePlugin) -> None:
    file = _compressed_folder(tmp_path / "run", plugin, "FILE")
    file.write_bytes(_packed_zeros("zstd", BOMB_BYTES))
    ended = _read(tmp_path / "run")
    assert "--chunk-bytes allows more" in ended.output
    assert ended.grown_bytes < GROWN_BYTES


def test_messages_of_a_folder_are_unpacked_with_a_limit(tmp_path: Path) -> None:
    file = _compressed_folder(tmp_path / "run", StoragePlugin.SQLITE3, "MESSAGE")
    with sqlite3.connect(file) as database:
        for id, data in database.execute("SELECT id, data FROM messages").fetchall():
            database.execute("UPDATE messages SET data = ? WHERE id = ?", (zstandard.compress(data), id))
    write_bag(tmp_path / "plain", StoragePlugin.SQLITE3)
    with open_recording([tmp_path / "run"]) as recording, open_recording([tmp_path / "plain"]) as plain:
        assert list(recording.messages()) == list(plain.messages())
    with sqlite3.connect(file) as database:
        database.execute("UPDATE messages SET data = ?", (_packed_zeros("zstd", BOMB_BYTES),))
    ended = _read(tmp_path / "run")
    assert "--chunk-bytes allows more" in ended.output
    assert ended.grown_bytes < GROWN_BYTES


ENDLESS: Final = {
    "rows": "CREATE VIEW messages(id, topic_id, timestamp, data) AS WITH RECURSIVE n(i) AS"
    " (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, 1, i, x'' FROM n",
    "values": "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
    " data BLOB AS (zeroblob(900000000)))",
}


@pytest.mark.parametrize("statement", ENDLESS.values(), ids=ENDLESS)
def test_a_database_that_computes_its_messages_is_rejected(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "run"
    write_bag(path, StoragePlugin.SQLITE3)
    with sqlite3.connect(next(path.glob("*.db3"))) as database:
        database.execute("DROP TABLE messages")
        database.execute(statement)
        if statement == ENDLESS["values"]:
            database.execute("INSERT INTO messages(id, topic_id, timestamp) VALUES (1, 1, 1)")
    ended = _read(path)
    assert "views or computed columns" in ended.output
    assert ended.grown_bytes < GROWN_BYTES


def test_whole_recordings_are_read_as_before(tmp_path: Path) -> None:
    record_robot(tmp_path / "run.mcap")
    with open_recording([tmp_path / "run.mcap"]) as recording:
        assert len(list(recording.messages())) == 26
        assert not recording.damaged
