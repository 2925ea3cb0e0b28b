"""Versions of the site lie beside each other, and the newest release is what its address leads to."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from packaging.version import Version

from tools.add_version import BRANCH, add_version, is_newest
from tools.build_release import ReleaseError

ROOT = Path(__file__).parents[2]


def git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with two pages, and for the rest with the settings of this project's site."""
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    before, _, after = settings.partition("nav:\n")
    assert after
    own = before.replace("hooks:\n  - tools/site_hooks.py\n", "")
    (tmp_path / "mkdocs.yml").write_text(f"{own}nav:\n  - README.md\n  - more.md\n", encoding="utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "README.md").write_text("# Start\n\n[More](more.md)\n", encoding="utf-8")
    (tmp_path / "docs" / "more.md").write_text("# More\n", encoding="utf-8")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "config", "user.name", "Test")
    git(tmp_path, "config", "user.email", "test@example.org")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message", "Begin")
    return tmp_path


def on_site(project: Path, path: str) -> str:
    return git(project, "show", f"{BRANCH}:{path}")


def test_versions_lie_beside_each_other(project: Path) -> None:
    origin = project.parent / f"{project.name}-origin"
    git(project, "init", "--quiet", "--bare", str(origin))
    git(project, "remote", "add", "origin", str(origin))
    add_version("0.1.0", push=False, root=project)
    (project / "docs" / "more.md").write_text("# Much more\n", encoding="utf-8")
    add_version("0.2.0rc1", push=False, root=project)
    assert json.loads(on_site(project, "versions.json")) == [
        {"version": "0.2.0rc1", "title": "0.2.0rc1", "aliases": []},
        {"version": "0.1.0", "title": "0.1.0", "aliases": ["latest"]},
    ]
    add_version("0.2.0", push=True, root=project)
    listed = json.loads(on_site(project, "versions.json"))
    assert {each["version"]: each["aliases"] for each in listed} == {
        "0.2.0": ["latest"],
        "0.2.0rc1": [],
        "0.1.0": [],
    }
    assert "Much more" in on_site(project, "0.2.0/more.html")
    assert "Much more" not in on_site(project, "0.1.0/more.html")
    assert "latest/" in on_site(project, "index.html")
    # The chooser of the theme reads versions.json where a page says this.
    page = on_site(project, "0.1.0/index.html")
    settings = json.loads(
        page.partition('<script id="__config" type="application/json">')[2].partition("<")[0]
    )
    assert settings["version"] == {"provider": "mike", "default": "latest"}
    assert git(origin, "rev-parse", BRANCH) == git(project, "rev-parse", BRANCH)


def test_a_page_with_a_mistake_adds_nothing(project: Path) -> None:
    (project / "docs" / "more.md").write_text("[Nowhere](nowhere.md)\n", encoding="utf-8")
    with pytest.raises(ReleaseError, match=r"nowhere\.md"):
        add_version("0.1.0", push=False, root=project)
    assert git(project, "branch", "--list", BRANCH) == ""


def test_what_is_no_version_is_refused(project: Path) -> None:
    with pytest.raises(ReleaseError, match="'next' is no version"):
        add_version("next", push=False, root=project)


@pytest.mark.parametrize(
    ("version", "others", "newest"),
    [
        ("0.1.0", [], True),
        ("0.10.0", ["0.9.0"], True),
        ("0.9.1", ["0.10.0", "0.9.0"], False),
        ("0.2.0rc1", [], False),
        ("0.1.0", ["0.2.0rc1"], True),
        ("0.2.0", ["0.2.0"], True),
    ],
)
def test_what_latest_leads_to(version: str, others: list[str], newest: bool) -> None:
    assert is_newest(Version(version), others) is newest
