"""Folders of interfaces with files that never end are rejected, without waiting and without reading them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.faults.limited import run_limited

IMPORTS = "from rwt_interfaces import Registry; from rwt_interfaces.errors import DefinitionError"
LOAD = """exec('''
try:
    Registry().add_directory({folder!r})
except DefinitionError as error:
    print(error)
''') or 0"""


@pytest.mark.parametrize("name", ["msg/Endless.msg", "package.xml"])
@pytest.mark.parametrize("kind", ["pipe", "device", "sparse"])
def test_a_file_that_never_ends_is_rejected(tmp_path: Path, name: str, kind: str) -> None:
    package = tmp_path / "my_robot"
    (package / "msg").mkdir(parents=True)
    (package / "msg" / "Whole.msg").write_text("uint8 x\n")
    path = package / name
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(2**40)
    ended = run_limited(LOAD.format(folder=str(tmp_path)), IMPORTS)
    assert ended.code == 0, ended.output
    assert ended.grown_bytes < 64 * 2**20
    if name.endswith(".msg"):
        expected = "characters at most" if kind == "sparse" else "not a regular file"
        assert f"{path}: " in ended.output and expected in ended.output
