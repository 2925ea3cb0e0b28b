"""Make a release of what is committed: changelog, version, tag.

    python -m tools.make_release 0.2.0 [--dry-run]
    python -m tools.make_release --notes 0.2.0

The first looks whether the repository is fit for it, builds and checks all files, commits the new version
with its date, tags it, and pushes both; the forge publishes what is tagged. If anything is not fit, nothing
has changed. The second prints the section of the changelog.
"""

from __future__ import annotations

import argparse
import datetime
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from tools.build_release import ReleaseError, build_release

ROOT = Path(__file__).parents[1]
CHANGELOG = ROOT / "CHANGELOG.md"
PROJECTS = tuple(
    ROOT / folder / "pyproject.toml"
    for folder in (".", "rwt-webrtc", "rwt-rclpy", "rwt-lerobot", "rwt-lerobot/plugin", "rwt-mavlink")
)
BRANCH = "main"

_VERSION = re.compile(r"\d+\.\d+\.\d+(?:(?:a|b|rc)\d+)?")
_HEADING = re.compile(r"^## \[([^\]]+)\](?: - (\S+))?$", re.MULTILINE)


def main() -> int:
    """Make the release that is asked for, or say why it cannot be made."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("version", help="such as 0.2.0 or 0.2.0rc1")
    parser.add_argument("--dry-run", action="store_true", help="look and build; commit, tag and push nothing")
    parser.add_argument("--notes", action="store_true", help="print the changes of this version, and no more")
    arguments = parser.parse_args()
    try:
        if arguments.notes:
            print(notes(CHANGELOG.read_text(encoding="utf-8"), arguments.version))
        else:
            make_release(arguments.version, dry_run=arguments.dry_run)
    except ReleaseError as error:
        sys.stderr.write(f"make_release: {error}\n")
        return 1
    return 0


def make_release(version: str, *, dry_run: bool) -> None:
    """Look, build, commit, tag and push.

    Raises:
        ReleaseError: the version is none, or is there already; files are not committed, or not on the main
            branch; the changelog says nothing of the version; a build or a check failed.
    """
    if not _VERSION.fullmatch(version):
        raise ReleaseError(f"{version!r} is no version; write one like 0.2.0 or 0.2.0rc1")
    if git("status", "--porcelain"):
        raise ReleaseError("files are changed and not committed; commit them, or take them back")
    if (branch := git("branch", "--show-current")) != BRANCH:
        raise ReleaseError(f"the branch is {branch!r}; releases are made from {BRANCH!r}")
    if git("tag", "--list", f"v{version}"):
        raise ReleaseError(f"the tag v{version} is there already; choose the next version")
    changes = dated(CHANGELOG.read_text(encoding="utf-8"), version, datetime.date.today())
    projects = {each: with_version(each.read_text(encoding="utf-8"), version) for each in PROJECTS}
    with tempfile.TemporaryDirectory() as folder:
        build_release(Path(folder) / "dist")
    if dry_run:
        print(f"{version} can be released; nothing was changed")
        return
    CHANGELOG.write_text(changes, encoding="utf-8")
    for project, text in projects.items():
        project.write_text(text, encoding="utf-8")
    git("commit", "--all", "--message", f"Release {version}")
    git("tag", "--sign", f"v{version}", "--message", f"Robot Web Tools without ROS {version}")
    git("push", "--atomic", "origin", BRANCH, f"v{version}")
    print(f"v{version} is pushed; the forge builds, checks and publishes it")


def notes(changelog: str, version: str) -> str:
    """Return a version's section of the changelog, without its heading.

    Raises:
        ReleaseError: it has no such section, or an empty one.
    """
    for heading in _HEADING.finditer(changelog):
        if heading[1] == version:
            following = _HEADING.search(changelog, heading.end())
            text = changelog[heading.end() : following.start() if following else None].strip()
            if text:
                return text
    raise ReleaseError(f"CHANGELOG.md says nothing under `## [{version}]`; write what changes for users")


def dated(changelog: str, version: str, day: datetime.date) -> str:
    """The changelog with the day at the version's heading.

    Raises:
        ReleaseError: as `notes` does, or the version has been released.
    """
    notes(changelog, version)
    found = next(heading for heading in _HEADING.finditer(changelog) if heading[1] == version)
    if found[2] != "unreleased":
        raise ReleaseError(f"CHANGELOG.md has {version} as of {found[2]}; it can be released once")
    return f"{changelog[: found.start()]}## [{version}] - {day.isoformat()}{changelog[found.end() :]}"


def with_version(project: str, version: str) -> str:
    """Return the text of a pyproject.toml with this version, also in its dependency on ours."""
    project = re.sub(r'^version = "[^"]*"$', f'version = "{version}"', project, count=1, flags=re.MULTILINE)
    return re.sub(r'"(robot-web-tools|rwt-lerobot|rwt-webrtc)==[^"]*"', rf'"\1=={version}"', project)


def git(*arguments: str) -> str:
    """Run git and return its output.

    Raises:
        ReleaseError: it failed; the text has what it said.
    """
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        raise ReleaseError(f"`git {' '.join(arguments)}` failed: {done.stderr.strip()}")
    return done.stdout.strip()


if __name__ == "__main__":
    raise SystemExit(main())
