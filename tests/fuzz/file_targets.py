"""Files of strangers: recordings and folders of interfaces, with the libraries that read them."""

from __future__ import annotations

import atexit
import shutil
import struct
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from rwt.extensions.recording import RecordingError, open_recording
from rwt.extensions.recording.mcap_files import recover
from rwt.extensions.recording.mcap_index import HEAD, MAGIC
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry

CHUNK_BYTES = 1 << 20
"""Limit of an unpacked chunk."""
COMPRESSIONS = ("", "lz4", "zstd")


@cache
def _folder() -> Path:
    folder = Path(mkdtemp(prefix="fuzz-files-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def recordings(data: bytes) -> None:
    """An MCAP file: as it is, or with a chunk of which the content, or what is compressed, is given.

    The first byte chooses: 0 the whole file; else the compression, and, from 128, content that is given
    compressed, after its size.
    """
    path = _folder() / "run.mcap"
    path.write_bytes(data[1:] if data[0] == 0 else _file(data[0], data[1:]))
    try:
        with open_recording([path], CHUNK_BYTES) as recording:
            read = sum(len(message.data) for message in recording.messages())
        assert read <= 64 * CHUNK_BYTES
        recover(path, path.with_name("whole.mcap"), overwrite=True, chunk_bytes=CHUNK_BYTES)
    except RecordingError as error:
        assert str(error)


def _file(choice: int, content: bytes) -> bytes:
    """Return a file whose only chunk has the content."""
    compression = COMPRESSIONS[choice % 128 % 3]
    size, packed = len(content), content
    if choice & 0x80:
        size = int.from_bytes(content[:4], "little")
        packed = content[4:]
    elif compression == "lz4":
        packed = lz4.frame.compress(content)
    elif compression == "zstd":
        packed = zstandard.compress(content)
    head = struct.pack("<QQQI", 1, 9, size, 0) + _string(compression) + struct.pack("<Q", len(packed))
    return MAGIC + record(Opcode.HEADER, _string("ros2") + _string("")) + record(Opcode.CHUNK, head + packed)


def record(opcode: int, content: bytes) -> bytes:
    """Return a record of an MCAP file."""
    return HEAD.pack(opcode, len(content)) + content


def _string(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def interface_folders(data: bytes) -> None:
    """A folder of packages: files divided by a zero byte, each a name, a line feed and its text."""
    root = _folder() / "packages"
    shutil.rmtree(root, ignore_errors=True)
    for each in data.split(b"\0")[:16]:
        name, _, text = each.partition(b"\n")
        parts = [part for part in name.decode("utf-8", "replace").split("/") if part.strip(".")][:6]
        if not parts:
            continue
        path = root.joinpath(*(part[:100] for part in parts))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text)
        except OSError:
            continue  # A name that is a folder already, or that no file can have.
    registry = Registry()
    try:
        registry.add_directory(str(root))
    except InterfaceError as error:
        assert 0 < len(str(error)) < 4000
        return
    for known in ("my_msgs/Thing", "my_msgs/Other"):
        try:
            registry.message(known)
        except InterfaceError as error:
            assert 0 < len(str(error)) < 4000
