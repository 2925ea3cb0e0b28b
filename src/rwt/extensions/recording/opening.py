"""Opens recordings of any format, several as one; the libraries of a format are loaded by its first file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rwt.extensions.recording.errors import RecordingUnreadable, require
from rwt.extensions.recording.recording import CHUNK_BYTES, MergedRecording, Recording


def open_recording(paths: Sequence[Path], chunk_bytes: int = CHUNK_BYTES) -> Recording:
    """Open a recording: MCAP files, ROS 1 bags, or folders of rosbag2; several are played together.

    Args:
        chunk_bytes: maximum unpacked size of a chunk or of a compressed message.

    Raises:
        RecordingUnreadable: one is not a recording, or they speak different versions of ROS.
        ExtraMissing: the extra ``mcap`` is not installed.
    """
    opened: list[Recording] = []
    try:
        opened.extend(_open(path, chunk_bytes) for path in paths)
        if not opened:
            raise RecordingUnreadable("no recording was named")
        return opened[0] if len(opened) == 1 else MergedRecording(opened)
    except BaseException:
        for recording in opened:
            recording.close()
        raise


def _open(path: Path, chunk_bytes: int) -> Recording:
    if not path.exists():
        raise RecordingUnreadable(f"{path}: there is no such file")
    if path.is_dir():
        return _open_folder(path, chunk_bytes)
    if path.suffix == ".bag":
        return _open_bag(path, chunk_bytes)
    if path.suffix == ".db3":
        raise RecordingUnreadable(f"{path} is a part of a rosbag2 recording: name its folder instead")
    return _open_mcap(path, chunk_bytes)


def _open_bag(path: Path, chunk_bytes: int) -> Recording:
    require("rosbags")
    from rwt.extensions.recording.bags import BagRecording

    return BagRecording(path, chunk_bytes)


def _open_mcap(path: Path, chunk_bytes: int) -> Recording:
    require("mcap")
    from rwt.extensions.recording.mcap_files import McapRecording

    return McapRecording(path, chunk_bytes)


def _open_folder(path: Path, chunk_bytes: int) -> Recording:
    if not (path / "metadata.yaml").exists():
        raise RecordingUnreadable(f"{path} is no recording: a folder of rosbag2 has a file metadata.yaml")
    require("rosbags")
    from rwt.extensions.recording.bags import FolderRecording, Rosbag2Folder

    folder = Rosbag2Folder(path, chunk_bytes)
    try:
        if folder.storage == "mcap":
            parts = [_open_mcap(file, chunk_bytes) for file in folder.files]
        else:
            parts = [_open_bag(folder.path, chunk_bytes)]
        return FolderRecording(path, parts, folder, chunk_bytes)
    except BaseException:
        folder.close()
        raise
