"""The patches for other projects add whole files, which are what the forge and the suite take."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from rosbridge_conformance import SUITE_VERSION
from rosbridge_conformance.suite.target import Target, find_client_target, find_target, with_known
from tests.release.test_forge import lint

ROOT = Path(__file__).parents[2]
PATCHES = sorted((ROOT / "docs" / "adopting").glob("*.patch"))


@pytest.fixture(params=PATCHES, ids=lambda patch: patch.stem)
def applied(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A project to which a patch has been applied."""
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    subprocess.run(["git", "apply", str(request.param)], cwd=tmp_path, check=True)
    return tmp_path


def test_patches_only_add_files() -> None:
    assert PATCHES
    for patch in PATCHES:
        lines = patch.read_text(encoding="utf-8").splitlines()
        assert sum(line.startswith("diff ") for line in lines) == lines.count("--- /dev/null")


def test_each_patch_says_to_which_commit_it_was_applied() -> None:
    page = (ROOT / "docs" / "adopting" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\|.*\]\((\w+)\.patch\) \|.*\| `\w+`, [0-9a-f]{40} of \d{4}-\d\d-\d\d \|$", page, re.M
    )
    assert sorted(rows) == [patch.stem for patch in PATCHES]


def test_the_workflow_is_one(applied: Path) -> None:
    lint("vendor.github-workflows", applied / ".github" / "workflows" / "conformance.yml")


def test_what_the_workflow_names_is_there(applied: Path) -> None:
    text = (applied / ".github" / "workflows" / "conformance.yml").read_text(encoding="utf-8")
    (target,) = re.findall(r"--target (\S+)", text)
    assert (find_client_target if "conformance client --target" in text else find_target)(target)
    (known,) = applied.rglob("known.toml")
    (named,) = re.findall(r"--expect (\S+)", text)
    assert named.endswith(str(known.relative_to(applied)))
    assert with_known(Target(), known, SUITE_VERSION) == Target()
    (pinned,) = set(re.findall(r"rosbridge-conformance~=(\d+)\.", text))
    assert pinned == SUITE_VERSION.split(".")[0]
