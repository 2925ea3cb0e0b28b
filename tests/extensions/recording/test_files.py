"""Recorded files read by independent readers, and files that are cut, damaged or not recordings."""

from __future__ import annotations

import errno
import json
import os
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rwt.extensions.recording import (
    COMPRESSIONS,
    Compression,
    RecordingNotWritten,
    RecordingOptions,
    RecordingUnreadable,
    RecordingWriter,
    Split,
    channel_form,
    open_recording,
    record_graph,
)
from rwt.extensions.recording.channels import json_schema
from rwt.extensions.recording.mcap_files import McapRecording, recover
from rwt.extensions.recording.mcap_index import MAGIC
from rwt_graph import Node
from rwt_interfaces import JAZZY, Registry
from tests.extensions.recording.robots import OWN, START_NS, graph_at, record_chunks, record_robot, rows

STRING = Registry(JAZZY).message("std_msgs/String")
TEXT = channel_form("/text", STRING, "ros")


def write(writer: RecordingWriter, *times_ns: int) -> None:
    """Write an empty text at each time."""
    channel = writer.add_channel(TEXT)
    for time_ns in times_ns:
        writer.write(channel, time_ns, time_ns, STRING.to_cdr(STRING.struct()))


def test_mcap_ros2_reads_every_message(path: Path) -> None:
    record_robot(path)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    assert len(decoded) == 26
    assert decoded[0][1].data == "hall"
    odometry = [message for topic, message in decoded if topic == "/odom"]
    assert [round(each.pose.pose.position.x * 3) for each in odometry] == list(range(20))
    image = next(message for topic, message in decoded if topic == "/camera")
    assert (image.encoding, bytes(image.data)) == ("rgb8", bytes(range(12)))


def test_rosbags_reads_the_ros_1_file_by_its_own_definitions(path: Path) -> None:
    record_robot(path, "noetic")
    store = get_typestore(Stores.EMPTY)
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros1"
        found = []
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros1msg", "ros1")
            if schema.name not in {name.replace("/msg/", "/") for name in store.fielddefs}:
                name = schema.name.replace("/", "/msg/")
                store.register(get_types_from_msg(schema.data.decode(), name))
            found.append(store.deserialize_ros1(message.data, schema.name.replace("/", "/msg/")))
    assert len(found) == 26
    first: Any = found[0]
    assert first.data == "hall"


def test_rosbags_opens_the_ros_2_file(path: Path) -> None:
    record_robot(path)
    with AnyReader([path]) as reader:
        assert {each.topic: each.msgcount for each in reader.connections} == {
            "/camera": 5, "/map_name": 1, "/odom": 20,
        }  # fmt: skip
        connection = next(each for each in reader.connections if each.topic == "/map_name")
        assert connection.msgdef.format is MessageDefinitionFormat.MSG
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        assert [each.durability.name for each in connection.ext.offered_qos_profiles] == ["TRANSIENT_LOCAL"]
        assert reader.start_time == START_NS + 3_500_000_000
        messages = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages()]
    assert len(messages) == 26


def test_json_channels_are_objects_with_an_inline_schema(path: Path) -> None:
    record_robot(path, encoding="json")
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        schemas = {schema.name: json.loads(schema.data) for schema in summary.schemas.values()}
        messages = {channel.topic: json.loads(each.data) for _, channel, each in reader.iter_messages()}
    odometry = schemas["nav_msgs/msg/Odometry"]
    assert odometry["type"] == "object"
    assert "$ref" not in json.dumps(odometry)
    position = odometry["properties"]["pose"]["properties"]["pose"]["properties"]["position"]["properties"]
    assert position["x"] == {"type": "number"}
    data = schemas["sensor_msgs/msg/Image"]["properties"]["data"]
    assert data == {"type": "string", "contentEncoding": "base64"}
    assert messages["/odom"]["pose"]["pose"]["position"]["y"] is None


def test_a_schema_says_how_long_an_array_is() -> None:
    schema = json.loads(json_schema(Registry(JAZZY).message("geometry_msgs/PoseWithCovariance")))
    covariance = schema["properties"]["covariance"]
    assert (covariance["minItems"], covariance["maxItems"]) == (36, 36)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_every_compression_reads_back(path: Path, compression: Compression) -> None:
    graph, clock = graph_at()
    with (
        Node(graph, "robot") as node,
        record_graph(graph, path, OWN, RecordingOptions(compression=compression)),
    ):
        text = node.advertise("/text", "std_msgs/String")
        clock.advance(0.3)
        text.publish({"data": "a" * 1000})
    assert [row[0] for row in rows(path)] == ["/text"]


@pytest.mark.parametrize(
    ("split", "count"), [(Split(seconds=1.0), 3), (Split(size=1), 4)], ids=["time", "size"]
)
def test_a_recording_splits_by_size_and_by_time(tmp_path: Path, split: Split, count: int) -> None:
    times = [0, 900_000_000, 10**9, 2_500_000_000]
    with RecordingWriter(tmp_path / "run.mcap", JAZZY, RecordingOptions(split=split)) as writer:
        write(writer, *times)
    assert writer.paths[0] == tmp_path / "run_0000.mcap"
    assert len(writer.paths) == count
    with open_recording(writer.paths) as recording:
        assert [each.log_time for each in recording.messages()] == times


def test_names_with_the_time_never_collide(tmp_path: Path) -> None:
    pattern = tmp_path / "run_%Y.mcap"
    first, second = (RecordingWriter(pattern, JAZZY, RecordingOptions(dated=True)) for _ in range(2))
    with first, second:
        year = time.strftime("%Y")
        assert first.paths == (tmp_path / f"run_{year}.mcap",)
        assert second.paths == (tmp_path / f"run_{year}_0001.mcap",)
    with RecordingWriter(pattern, JAZZY, RecordingOptions(dated=True, split=Split(size=1))) as third:
        assert third.paths == (tmp_path / f"run_{year}_0000.mcap",)
    with RecordingWriter(pattern, JAZZY) as plain:
        assert plain.paths == (pattern,)


def test_the_oldest_files_are_removed(tmp_path: Path) -> None:
    options = RecordingOptions(split=Split(seconds=1.0, keep=2))
    with RecordingWriter(tmp_path / "run.mcap", JAZZY, options) as writer:
        write(writer, *range(0, 5 * 10**9, 10**9))
    assert sorted(tmp_path.iterdir()) == [tmp_path / "run_0003.mcap", tmp_path / "run_0004.mcap"]
    assert writer.paths == tuple(sorted(tmp_path.iterdir()))


def test_a_later_file_that_is_there_ends_the_recording_with_a_word(tmp_path: Path) -> None:
    (tmp_path / "run_0001.mcap").write_bytes(b"of yesterday")
    writer = RecordingWriter(tmp_path / "run.mcap", JAZZY, RecordingOptions(split=Split(seconds=1.0)))
    write(writer, *range(0, 3 * 10**9, 10**9))
    with pytest.raises(RecordingNotWritten, match=r"run_0001\.mcap is there already"):
        writer.close()
    assert (tmp_path / "run_0001.mcap").read_bytes() == b"of yesterday"


def test_whatever_goes_wrong_while_writing_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    writer = RecordingWriter(tmp_path / "run.mcap", JAZZY)
    write(writer, -1)
    with pytest.raises(RecordingNotWritten, match="internal error, see the log"):
        writer.close()
    assert "argument out of range" in caplog.text


def test_a_file_that_is_there_is_not_overwritten_unless_told(path: Path) -> None:
    path.write_bytes(b"precious")
    with pytest.raises(RecordingNotWritten, match=r"run\.mcap is there already"):
        RecordingWriter(path, JAZZY)
    assert path.read_bytes() == b"precious"
    RecordingWriter(path, JAZZY, RecordingOptions(overwrite=True)).close()
    assert path.read_bytes().startswith(MAGIC)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of several chunks."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    record_chunks(path)
    return path


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.floats(0.0, 1.0, exclude_max=True))
def test_a_cut_file_is_read_as_far_as_its_chunks_are_whole(tmp_path: Path, whole: Path, at: float) -> None:
    content = whole.read_bytes()
    length = max(len(MAGIC), int(at * len(content)))
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[:length])
    with McapRecording(path) as recording:
        times = [each.log_time for each in recording.messages()]
        assert not recording.complete
    assert times == list(range(len(times)))
    # A chunk of this file holds three messages of 400 kB.
    assert len(times) >= min(9, length // 1_250_000 * 3)


def test_a_damaged_chunk_is_left_out(tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "damaged.mcap"
    content = whole.read_bytes()
    place = content.index(b"DDDDDDDD")
    path.write_bytes(content[:place] + b"?" + content[place + 1 : -40])
    with McapRecording(path) as recording:
        assert recording.recovery is not None
        assert recording.recovery.damaged == 1
        assert [each.log_time for each in recording.messages()] == [0, 1, 2, 6, 7, 8]


def _damaged(path: Path, whole: Path, how: str) -> Path:
    """A file with an index, the second chunk of which cannot be read."""
    content = bytearray(whole.read_bytes())
    place = content.index(b"DDDDDDDD")
    with McapRecording(whole) as recording:
        begin = recording.index.chunk_indexes[1].chunk_start_offset
    assert begin < place
    if how == "content":
        content[place] = ord("?")
    elif how == "size":
        content[begin + 25 : begin + 33] = (2**40).to_bytes(8, "little")
    else:
        content[begin + 37 : begin + 41] = (2**31).to_bytes(4, "little")  # the length of its compression
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("how", ["content", "size", "record"])
def test_of_a_file_with_an_index_a_damaged_chunk_is_left_out(
    tmp_path: Path, whole: Path, caplog: pytest.LogCaptureFixture, how: str
) -> None:
    path, to = _damaged(tmp_path / "damaged.mcap", whole, how), tmp_path / "to.mcap"
    with McapRecording(path) as recording:
        assert (recording.complete, recording.damaged) == (True, 0)
        for _ in range(2):
            assert [each.log_time for each in recording.messages()] == [0, 1, 2, 6, 7, 8]
            assert [each.log_time for each in recording.messages(None, 2, 8)] == [2, 6, 7]
        assert recording.damaged == 1
    assert caplog.text.count("is left out") == 1
    assert recover(path, to).damaged == 1
    assert [row[2] for row in rows(to)] == [0, 1, 2, 6, 7, 8]
    with open_recording([path, to]) as both:
        assert len(list(both.messages())) == 12
        assert both.damaged == 1


def test_a_file_may_be_recovered_into_itself(tmp_path: Path, whole: Path) -> None:
    path = _damaged(tmp_path / "run.mcap", whole, "content")
    recover(path, path, overwrite=True)
    assert [row[2] for row in rows(path)] == [0, 1, 2, 6, 7, 8]
    assert list(tmp_path.iterdir()) == [path]


def test_a_recovery_that_fails_leaves_what_was_there(
    tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, to = tmp_path / "run.mcap", tmp_path / "to.mcap"
    path.write_bytes(whole.read_bytes())
    to.write_bytes(b"precious")
    before = path.read_bytes()
    with pytest.raises(RecordingNotWritten, match=r"to\.mcap is there already"):
        recover(path, to)

    def fail(_file: int) -> None:
        raise OSError(errno.EIO, "the disk is broken")

    monkeypatch.setattr(os, "fsync", fail)
    for each in (path, to):
        with pytest.raises(RecordingNotWritten, match="the disk is broken"):
            recover(path, each, overwrite=True)
    assert (path.read_bytes(), to.read_bytes()) == (before, b"precious")
    assert sorted(tmp_path.iterdir()) == [path, to]


def test_recover_makes_a_complete_file(tmp_path: Path, whole: Path) -> None:
    path, to = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    content = whole.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    found = recover(path, to)
    assert found.recovery is not None
    with McapRecording(to) as recording:
        assert recording.complete
        assert recording.recovery is None
    with pytest.raises(RecordingNotWritten):
        recover(path, to)
    assert len(rows(to)) == 3


def test_a_file_without_chunks_or_index_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "loose.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("ros2", "")
        schema = writer.register_schema(TEXT.schema_name, TEXT.schema_encoding, TEXT.schema)
        channel = writer.register_channel("/text", "cdr", schema)
        for time in (5, 3, 4):
            writer.add_message(channel, time, b"\0\1\0\0\1\0\0\0\0", time)
    for ending in (b"", b"\x05\0\0"):
        path.write_bytes(path.read_bytes() + ending)
        with McapRecording(path) as recording:
            assert [each.log_time for each in recording.messages(["/text"], 4)] == [4, 5]
            assert [each.log_time for each in recording.messages(None, 0, 4)] == [3]
            assert (recording.start_ns, recording.end_ns, recording.topics[0].count) == (3, 5, 3)


def test_what_is_not_a_recording_is_refused_by_name(tmp_path: Path) -> None:
    text, part, folder = tmp_path / "notes.txt", tmp_path / "run_0.db3", tmp_path / "bag"
    text.write_text("no recording")
    part.write_bytes(b"SQLite")
    folder.mkdir()
    for path, why in (
        (text, "is not a recording"),
        (part, "name its folder"),
        (folder, r"has a file metadata\.yaml"),
        (tmp_path / "gone.mcap", "no such file"),
        (tmp_path / "gone.bag", "no such file"),
    ):
        with pytest.raises(RecordingUnreadable, match=why):
            open_recording([path])
    broken = tmp_path / "broken.bag"
    broken.write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(RecordingUnreadable, match=r"broken\.bag is not a bag that can be read"):
        open_recording([broken])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_recording_does_not_begin_on_a_full_disk(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    path.symlink_to("/dev/full")
    with pytest.raises(RecordingNotWritten, match=r"full\.mcap: cannot be written: the disk is full"):
        RecordingWriter(path, JAZZY, RecordingOptions(overwrite=True))


def test_what_was_written_before_the_disk_was_full_is_readable(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = 3_000_000

    def write(file: int, data: memoryview) -> int:
        nonlocal room
        if not room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = os_write(file, data[:room])
        room -= count
        return count

    os_write = os.write
    writer = RecordingWriter(path, JAZZY, RecordingOptions(compression="none"))
    monkeypatch.setattr("rwt.extensions.recording.writer.os.write", write)
    channel = writer.add_channel(TEXT)
    for number in range(50):
        writer.write(channel, number, number, bytes(400_000))
    for _ in range(2):
        with pytest.raises(RecordingNotWritten, match="the disk is full; what was written until then can be"):
            writer.close()
    writer.write(channel, 99, 99, b"late")
    assert writer.dropped == 1
    with McapRecording(path) as recording:
        assert not recording.complete
        assert recording.recovery is not None
        assert recording.recovery.lost_bytes == 0
        assert [each.log_time for each in recording.messages()] == [0, 1, 2, 3, 4, 5]
