"""The tutorial "An arm in your browser in five minutes", by the command line. Needs MuJoCo."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final
from urllib.request import urlopen

import pytest

if find_spec("mujoco") is None:  # Not imported here: it reads MUJOCO_GL, which the model sets.
    pytest.skip("MuJoCo is not installed", allow_module_level=True)

PAGE: Final = Path(__file__).parents[2] / "docs" / "how-to" / "lerobot.md"


def _steps() -> list[str]:
    """Return the commands of the tutorial's second block, each on a line."""
    part = PAGE.read_text(encoding="utf-8").split("## An arm in your browser")[1].split("\n## ")[0]
    blocks = re.findall(r"```sh\n(.*?)```", part, re.S)
    assert "rwt lerobot mujoco" in blocks[0]
    steps: list[str] = blocks[1].replace("\\\n", "").strip().splitlines()
    return steps


def test_the_tutorial(tmp_path: Path) -> None:
    # The verb by itself: a checkout that is not installed has no entry points.
    command = [
        sys.executable, "-c",
        ("import sys; from rwt_lerobot.commands.mujoco import add_mujoco_verb;"
        "from rwt.cli.parser import Parser, add_commands; parser = Parser(prog='rwt');"
        "add_mujoco_verb(add_commands(parser));"
        "given = parser.parse_args(['mujoco', 'ws://127.0.0.1:0']); sys.exit(given.run(given))"),
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as server:
        assert server.stdout is not None
        url = server.stdout.readline().split()[-1]
        try:
            with urlopen(url.replace("ws", "http", 1) + "/arm") as page:
                assert "shoulder_pan" in page.read().decode()
            printed = [
                subprocess.run(
                    step.replace("rwt", f"{sys.executable} -m rwt.cli", 1),
                    shell=True,
                    capture_output=True,
                    text=True,
                    timeout=60,
                    env={**os.environ, "RWT_URL": url},
                )
                for step in _steps()
            ]
        finally:
            server.terminate()
    assert [each.returncode for each in printed] == [0, 0, 0], [each.stderr for each in printed]
    assert "shoulder_pan" in printed[0].stdout
    assert "SUCCEEDED" in printed[1].stdout
    assert "success" in printed[2].stdout
