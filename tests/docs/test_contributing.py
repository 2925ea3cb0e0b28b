"""The pages of `docs/contributing`, followed step by step in a copy of the project, cost what they say."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, Block, blocks_of
from tests.docs.processes import LIMIT, Running, commands_folder

pytestmark = pytest.mark.timeout(90)

_FOLDER = ROOT / "docs" / "contributing"
_PAGES = sorted(page for page in _FOLDER.glob("*.md") if page.name not in ("README.md", "release.md"))
"""The pages about what can be added."""
_COPIED = ("src", "conformance")
_PUT = re.compile(r'(after|before|replace) "(.*)" in (\S+)')
_ROW = re.compile(r"^\| \[[^]]*\]\((\S+)\) \| (\d+) \|", re.MULTILINE)

_FIELDS = (
    "from dataclasses import fields; from rwt_interfaces.distro import Distro; print(len(fields(Distro)))"
)


class Copy:
    """A copy of the project in which the steps of one page are made.

    Attributes:
        folder: where it is.
        touched: the files that were created or changed, without cases and tests.
    """

    def __init__(self, folder: Path, commands: Path) -> None:
        self.folder = folder
        self.touched: set[str] = set()
        self._commands = commands
        for name in _COPIED:
            # With the times of the files, so that what is compiled already need not be compiled again.
            shutil.copytree(ROOT / name, folder / name)
        shutil.copy2(ROOT / "pyproject.toml", folder)

    def make(self, block: Block) -> None:
        """Make one step."""
        step = block.value("step")
        kind, _, name = step.partition(" ")
        if kind in ("create", "case"):
            assert not (self.folder / name).exists(), f"{block.name}: {name} is there already"
            (self.folder / name).parent.mkdir(exist_ok=True)
            (self.folder / name).write_text(block.code, encoding="utf-8")
        else:
            put = _PUT.fullmatch(step)
            assert put is not None, f"{block.name}: {step!r} is not a step"
            name = put[3]
            _put(self.folder / name, put[1], put[2], block)
        if kind != "case":
            self.touched.add(name)

    def run(self, block: Block) -> Running:
        """Return the output of a page's block, run in the copy."""
        script = {"python": ["show.py", sys.executable], "sh": ["show.sh", "sh", "-eu"]}[block.language]
        (self.folder / script[0]).write_text(block.code, encoding="utf-8")
        command = [*script[1:], script[0]]
        packages = (self.folder / "src", self.folder / "conformance", self.folder)
        return Running(command, self.folder, self._commands, packages=packages)

    def output(self, *command: str) -> str:
        """Return the output of a program run in the copy."""
        done = subprocess.run(
            [sys.executable, *command],
            cwd=self.folder,
            env={"PYTHONPATH": str(self.folder / "src")},
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


def _put(file: Path, where: str, line: str, block: Block) -> None:
    """Put a block of code where a step says."""
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    found = [number for number, each in enumerate(lines) if each.strip() == line]
    assert len(found) == 1, f"{block.name}: {line!r} is {len(found)} times in {file}"
    begin = found[0] + (where == "after")
    lines[begin : begin + (where == "replace")] = block.code
    file.write_text("".join(lines), encoding="utf-8")


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path / "project", commands_folder(tmp_path / "commands"))


def _steps(page: Path) -> tuple[list[Block], list[Block]]:
    """The blocks that change the project, and those that show what came of it."""
    blocks = [block for block in blocks_of(page) if block.value("step")]
    shown = [block for block in blocks if block.value("step") == "run"]
    return [block for block in blocks if block not in shown], shown


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: page.stem)
def test_page(page: Path, copy: Copy) -> None:
    changes, shown = _steps(page)
    assert shown and all(block.values("prints") for block in shown), "a page shows what came of its steps"
    for block in shown:
        with copy.run(block) as running, pytest.raises(AssertionError):
            for text in block.values("prints"):
                running.wait_for(text)
    for block in changes:
        copy.make(block)
    files = dict(_ROW.findall((_FOLDER / "README.md").read_text(encoding="utf-8")))
    assert len(copy.touched) == int(files[page.name]), sorted(copy.touched)
    written = sorted(name for name in copy.touched if name.endswith(".py"))
    copy.output("-m", "ruff", "check", "--no-cache", *written)
    copy.output("-m", "ruff", "format", "--no-cache", "--check", *written)
    for block in shown:
        with copy.run(block) as running:
            for text in block.values("prints"):
                running.wait_for(text)
            running.expect_end()


def test_a_difference_is_one_field(copy: Copy) -> None:
    before = int(copy.output("-c", _FIELDS))
    for block in _steps(_FOLDER / "distribution.md")[0]:
        copy.make(block)
    assert int(copy.output("-c", _FIELDS)) == before + 1


def test_every_page_is_in_the_table() -> None:
    listed = [name for name, _ in _ROW.findall((_FOLDER / "README.md").read_text(encoding="utf-8"))]
    assert sorted(listed) == [page.name for page in _PAGES]


def test_the_layers_are_those_that_are_checked() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = [each["layers"] for each in contracts["contracts"] if each["type"] == "layers"]
    listed = [block for block in blocks_of(_FOLDER / "README.md") if block.language == "text"]
    assert [block.code.splitlines() for block in listed] == layers
