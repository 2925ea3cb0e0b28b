"""A user's program finds the types of the packages, by the checkers that people use."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import ROOT

pytestmark = pytest.mark.timeout(700)  # A checker that has seen nothing yet reads all packages.

PROGRAM = Path(__file__).parent / "programs" / "typed_robot.py"
PYRIGHT = ROOT / "tests" / "clients" / "node" / "node_modules" / "pyright" / "index.js"

#: What each checker must find: a name that is not there, and a wrong type.
MISTAKES = {
    "geometry_msgs.Vector3(x=0.5)": "geometry_msgs.Vector3(q=0.5)",
    "calls[0].service, str": "calls[0].service, int",
}


def mypy(program: Path) -> tuple[bool, str]:
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "/dev/null", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=program.parent)
    return done.returncode == 0, done.stdout


def pyright(program: Path) -> tuple[bool, str]:
    (program.parent / "pyrightconfig.json").write_text(
        json.dumps({"typeCheckingMode": "strict", "include": [program.name]})
    )
    command = ["node", str(PYRIGHT), "--pythonpath", sys.executable, "--project", str(program.parent)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    return done.returncode == 0, done.stdout


def test_every_package_says_that_it_is_typed() -> None:
    packages = [folder.parent for folder in (ROOT / "src").glob("*/__init__.py")]
    assert [folder.name for folder in packages if not (folder / "py.typed").exists()] == []


@pytest.mark.parametrize("checker", [mypy, pyright])
def test_a_typed_program_passes_and_its_mistakes_are_found(checker: object, tmp_path: Path) -> None:
    assert callable(checker)
    text = PROGRAM.read_text(encoding="utf-8")
    right, wrong = tmp_path / "right" / "robot.py", tmp_path / "wrong" / "robot.py"
    for file in (right, wrong):
        file.parent.mkdir()
    right.write_text(text)
    passed, said = checker(right)
    assert passed, said
    for before, after in MISTAKES.items():
        assert before in text
        text = text.replace(before, after)
    wrong.write_text(text)
    passed, said = checker(wrong)
    assert not passed
    assert said.count("error: ") == len(MISTAKES), said
