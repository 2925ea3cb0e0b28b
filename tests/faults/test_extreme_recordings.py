"""Recordings whose bytes lie (cut, flipped, with lengths, times and definitions that nobody has room for) are
read as far as they go or refused in a line: by `rwt bag info`, `recover` and the player."""

from __future__ import annotations

import os
import resource
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin

from rwt.cli import parser_for
from rwt.cli.errors import CommandError
from rwt.extensions.recording import RecordingError, open_recording
from rwt.extensions.recording.playback import Player, PlayOptions
from rwt_graph import MemoryGraph, SimulatedClock
from rwt_interfaces import Registry
from tests.extensions.recording.robots import record_robot
from tests.extensions.recording.test_bags import write_bag
from tests.faults.server_log import Failures

FEW: Final = 40
EXAMPLES: Final = int(os.environ.get("SWEEP_EXAMPLES", FEW))
"""Damaged files; `make fuzz` asks for more."""

MOST_MEMORY: Final = 128 * 2**20
"""Bytes by which this process may grow for a recording of some kilobytes, with the libraries that read it."""


def _peak() -> int:
    """The most bytes that this process had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


LENGTHS: Final = (0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
"""Values written over a length, a time or any other field."""

_PARSER: Final = parser_for("bag")

FORMATS: Final = (
    "mcap",
    "mcap-json",
    "mcap-noetic",
    "mcap-plain",
    "ros1",
    "ros1-bz2",
    "ros2-sqlite3",
    "ros2-mcap",
)


def _write(path: Path, form: str) -> Path:
    """A small recording of a format; gives the file in which most of it stands."""
    match form.split("-"):
        case ["mcap", "plain"]:
            _channels(path / "run.mcap", [WORDS], chunked=False)
            return path / "run.mcap"
        case ["mcap", *kind]:
            distro = "noetic" if kind == ["noetic"] else "jazzy"
            record_robot(path / "run.mcap", distro, "json" if kind == ["json"] else "ros", messages=3)
            return path / "run.mcap"
        case ["ros1"]:
            write_bag(path / "run.bag")
            return path / "run.bag"
        case ["ros1", _]:
            _packed_bag(path / "run.bag")
            return path / "run.bag"
        case _:
            plugin = StoragePlugin.MCAP if form.endswith("mcap") else StoragePlugin.SQLITE3
            write_bag(path / "run", plugin)
            return next(each for each in (path / "run").iterdir() if each.suffix != ".yaml")


def _packed_bag(path: Path) -> None:
    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat.BZ2)
    with writer as bag:
        words = bag.add_connection("/words", "std_msgs/msg/String", msgdef="string data\n", md5sum="0" * 32)
        bag.write(words, 10**18, b"\1\0\0\0a")


Channel = tuple[str, str, str]
"""A topic, its type, and the definition."""

WORDS: Final[Channel] = ("/words", "std_msgs/msg/String", "string data\n")


def _channels(
    path: Path, channels: list[Channel], times: tuple[int, ...] = (1, 2), *, chunked: bool = True
) -> None:
    """An MCAP file with a message of each time on each topic."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=chunked)
        writer.start("ros2")
        for topic, kind, text in channels:
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for time in times:
                writer.add_message(channel, time, b"\0\1\0\0\2\0\0\0a\0", time)
        writer.finish()


@dataclass(frozen=True, slots=True)
class Read:
    """Output of the commands about a recording.

    Attributes:
        played: messages that the player published; None where it refused.
        said: what `rwt bag info` and `recover` printed.
    """

    played: int | None
    said: str


class Reader:
    """Reads recordings in every way that there is, and looks at how each way ends."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def read(self, path: Path) -> Read:
        """A recording by all the commands.

        Raises:
            AssertionError: one left a traceback, or something half made, or took memory without bound.
        """
        to = path.with_name("whole.mcap")
        peak = _peak()
        said = self._run("bag", "info", str(path)) + self._run("bag", "info", "--json", str(path))
        before = sorted(path.parent.iterdir())
        said += self._run("bag", "recover", str(path), "-o", str(to))
        recovered = [to] if to.exists() else []
        assert sorted(path.parent.iterdir()) == sorted([*before, *recovered])
        for whole in recovered:
            self._run("bag", "info", str(whole))
            whole.unlink()
        played = _played(path)
        assert _peak() - peak < MOST_MEMORY
        return Read(played, said)

    def _run(self, *words: str) -> str:
        arguments = _PARSER.parse_args(words)
        self._capsys.readouterr()
        try:
            code = int(arguments.run(arguments))
        except CommandError as refused:
            assert str(refused) and len(str(refused)) < 1000
            return str(refused)
        assert code in (0, 1), words
        captured = self._capsys.readouterr()
        return captured.out + captured.err


def _played(path: Path) -> int | None:
    """Return the number of played messages; None for a rejected recording. The graph is empty afterwards."""
    try:
        with open_recording([path]) as recording:
            graph = MemoryGraph(Registry(recording.distro), SimulatedClock())
            before = graph.topics(), graph.services(), graph.nodes()
            try:
                with Player(graph, recording, PlayOptions(paused=True)) as player:
                    player.burst(0)
                    return player.played
            finally:
                assert (graph.topics(), graph.services(), graph.nodes()) == before
    except (RecordingError, ValueError) as refused:
        assert isinstance(refused, RecordingError) or "ROS time ends" in str(refused), repr(refused)
        return None


@pytest.fixture
def reader(capsys: pytest.CaptureFixture[str]) -> Reader:
    return Reader(capsys)


def _message(count: int) -> str:
    return f"float64[{count}] numbers\n"


def _chain(depth: int) -> str:
    """A type that has one that has one …"""
    parts = [f"MSG: deep/T{number}\nT{number + 1} next\n" for number in range(1, depth)]
    return f"{'=' * 80}\n".join(["T1 next\n", *parts, f"MSG: deep/T{depth}\nuint8 end\n"])


HOSTILE_SCHEMAS: Final = {
    "a huge array": _message(2**31 - 1),
    "an array longer than memory": _message(2**63),
    "an array of 400 digits": f"float64[{'9' * 400}] numbers\n",
    "an array of 5000 digits": f"float64[{'9' * 5000}] numbers\n",
    "2000 nested types": _chain(2000),
    "a type in itself": f"T1 next\n{'=' * 80}\nMSG: deep/T1\nT1 next\n",
    "arrays of arrays": f"T1[60000] next\n{'=' * 80}\nMSG: deep/T1\nfloat64[60000] next\n",
    "20,000 fields": "".join(f"uint8 f{number}\n" for number in range(20_000)),
    "a constant beyond its type": "uint8 X=1e400\nuint8 Y=" + "9" * 5000 + "\nuint8 x\n",
    "no text": "\0\uffff\u202e\x1b[2J\n",
}


@pytest.mark.parametrize("schema", HOSTILE_SCHEMAS.values(), ids=HOSTILE_SCHEMAS)
def test_a_definition_that_nobody_has_room_for_costs_its_topic_alone(
    reader: Reader, tmp_path: Path, schema: str
) -> None:
    _channels(tmp_path / "run.mcap", [("/hostile", "deep/msg/T0", schema), WORDS])
    read = reader.read(tmp_path / "run.mcap")
    assert read.played is not None and read.played >= 2


TIMES: Final = (0, 1, 2**31 * 10**9 - 1, 2**31 * 10**9, 2**32 * 10**9, 2**63 - 1, 2**63, 2**64 - 1)


@pytest.mark.parametrize("times", [(each,) for each in TIMES] + [(0, each) for each in TIMES], ids=repr)
def test_times_that_ros_does_not_have_are_named(
    reader: Reader, tmp_path: Path, times: tuple[int, ...]
) -> None:
    _channels(tmp_path / "run.mcap", [WORDS], times)
    within = sum(each < 2**31 * 10**9 for each in times)
    assert reader.read(tmp_path / "run.mcap").played == (within or None)


BIG: Final[tuple[object, ...]] = (-1, 10**30, float("nan"), "9" * 5000, [[]])


@pytest.mark.parametrize(
    "key", ["starting_time", "duration", "message_count", "version", "relative_file_paths", "files"]
)
def test_metadata_of_rosbag2_may_say_anything(reader: Reader, tmp_path: Path, key: str) -> None:
    write_bag(tmp_path / "run", StoragePlugin.SQLITE3)
    file = tmp_path / "run" / "metadata.yaml"
    metadata = yaml.safe_load(file.read_text())
    inner = metadata["rosbag2_bagfile_information"]
    if isinstance(inner[key], dict):
        values: list[object] = [dict.fromkeys(inner[key], each) for each in BIG]
    else:
        values = [*BIG, ["../../x"]]
    for value in values:
        file.write_text(yaml.safe_dump({"rosbag2_bagfile_information": {**inner, key: value}}))
        reader.read(tmp_path / "run")


def test_a_chunk_that_would_unpack_to_more_than_there_is_memory_is_left_out(
    reader: Reader, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    record_robot(path, messages=3)
    content = path.read_bytes()
    head = content.index(b"\x04\0\0\0zstd") - 12  # the size unpacked, and the checksum, of the first chunk
    for size in LENGTHS:
        path.write_bytes(content[:head] + size.to_bytes(8, "little") + content[head + 8 :])
        reader.read(path)


def test_chunks_are_as_large_as_they_are_let(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    path, whole = tmp_path / "run.mcap", tmp_path / "whole.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1024)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/words", "cdr", schema)
        for size in (100, 3_000_000, 200):  # The large one is a chunk of its own, of some hundred bytes.
            text = (size + 1).to_bytes(4, "little") + b"x" * size + b"\0"
            writer.add_message(channel, size, b"\0\1\0\0" + text, size)
        writer.finish()
    assert path.stat().st_size < 10_000
    for options, count in (([], 3), (["--chunk-bytes", "1000000"], 1)):
        arguments = ["bag", "recover", str(path), "-o", str(whole), "--overwrite", *options]
        parsed = _PARSER.parse_args(arguments)
        assert parsed.run(parsed) == (count != 3)
        assert f"{count} messages of 1 topics" in capsys.readouterr().out
    assert "more than 1000000 bytes; --chunk-bytes allows more" in caplog.text


Damage = Callable[[bytes], bytes]


def _cut(at: float) -> Damage:
    return lambda content: content[: int(at * len(content))]


def _put(at: float, written: bytes) -> Damage:
    def damage(content: bytes) -> bytes:
        begin = int(at * len(content))
        return content[:begin] + written + content[begin + len(written) :]

    return damage


def _again(at: float, to: float, size: int) -> Damage:
    """A slice written a second time, elsewhere."""

    def damage(content: bytes) -> bytes:
        begin, end = int(at * len(content)), int(to * len(content))
        return content[:end] + content[begin : begin + size] + content[end:]

    return damage


def _lie(old: bytes, new: bytes) -> Damage:
    return lambda content: content.replace(old, new)


_places = st.floats(0.0, 1.0, exclude_max=True)
_damages = st.one_of(
    st.builds(_cut, _places),
    st.builds(_put, _places, st.binary(min_size=1, max_size=8)),
    st.builds(_put, _places, st.sampled_from([number.to_bytes(8, "little") for number in LENGTHS])),
    st.builds(_put, _places, st.sampled_from([number.to_bytes(8, "little")[:4] for number in LENGTHS])),
    st.builds(_again, _places, _places, st.integers(1, 400)),
    st.sampled_from([
        _lie(b"zstd", b"lz4\0"), _lie(b"zstd", b"none"), _lie(b"bz2", b"lz4"), _lie(b"ros2msg", b"ros1msg"),
        _lie(b"string data", b"string[9] b"), _lie(b"std_msgs/", b"std_msgs\0"),
        _lie(b"/map_name", b"/../../ \n"),
        _lie(b"/words", b"/\xff\xfe\x1b[2"), _lie(b"cdr", b"CDR"),
    ]),
)  # fmt: skip


@pytest.fixture(scope="module")
def wholes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {form: _write(tmp_path_factory.mktemp("whole"), form) for form in FORMATS}


@settings(
    max_examples=EXAMPLES,
    derandomize=EXAMPLES == FEW,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(form=st.sampled_from(FORMATS), damages=st.lists(_damages, min_size=1, max_size=3))
def test_a_damaged_recording_is_read_as_far_as_it_goes_or_refused(
    reader: Reader, wholes: dict[str, Path], form: str, damages: list[Damage]
) -> None:
    whole = wholes[form]
    content = whole.read_bytes()
    for damage in damages:
        content = damage(content)
    with TemporaryDirectory() as folder, Failures() as failures:
        if form.startswith("ros2"):
            path = Path(folder, "run")
            shutil.copytree(whole.parent, path)
            (path / whole.name).write_bytes(content)
        else:
            path = Path(folder, whole.name)
            path.write_bytes(content)
        reader.read(path)
        failures.check()
