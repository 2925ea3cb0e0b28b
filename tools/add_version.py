"""Add the pages of a version to the site, beside those of other versions.

    make site VERSION=0.2.0
    make site VERSION=0.2.0 ARGS=--push

The pages are built as `make docs` builds them, and committed to a folder of their own on the branch gh-pages,
which has them all; `latest` and the site's own address lead to the newest version that is no candidate. With
`--push` the branch is pushed, which the forge does when a version is tagged. Show it: `.venv/bin/mike serve`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from packaging.version import InvalidVersion, Version

from tools.build_release import ReleaseError

ROOT = Path(__file__).parents[1]
PROGRAMS = Path(sys.executable).parent
BRANCH = "gh-pages"
LATEST = "latest"


def main() -> int:
    """Add the version that is asked for, or say why it cannot be added."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("python -m tools.add_version", description=__doc__, formatter_class=form)
    parser.add_argument("version", help="such as 0.2.0 or 0.2.0rc1")
    parser.add_argument("--push", action="store_true", help="fetch the branch first, and push it")
    arguments = parser.parse_args()
    try:
        add_version(arguments.version, push=arguments.push)
    except ReleaseError as error:
        sys.stderr.write(f"add_version: {error}\n")
        return 1
    print(f"{arguments.version} is on the branch {BRANCH}{', which is pushed' if arguments.push else ''}")
    return 0


def add_version(version: str, *, push: bool, root: Path = ROOT) -> None:
    """Build the pages, and commit them to the branch of the site.

    Args:
        root: the folder of mkdocs.yml, in a repository.

    Raises:
        ReleaseError: the version is none, or the pages cannot be built, committed or pushed.
    """
    try:
        wanted = Version(version)
    except InvalidVersion as error:
        raise ReleaseError(f"{version!r} is no version; write one like 0.2.0 or 0.2.0rc1") from error
    remote = ["--push"] if push else []
    if push and "refs/heads/" in _run(root, "git", "ls-remote", "--heads", "origin", BRANCH):
        _run(root, "git", "fetch", "origin", f"{BRANCH}:{BRANCH}")
    newest = is_newest(wanted, versions(root))
    aliases = [LATEST] if newest else []
    _run(root, *_mike("deploy", *remote, "--update-aliases", str(wanted), *aliases))
    if newest:
        _run(root, *_mike("set-default", *remote, LATEST))


def versions(root: Path = ROOT) -> list[str]:
    """The versions that the branch of the site has."""
    if not _run(root, "git", "branch", "--list", BRANCH).strip():
        return []
    listed = json.loads(_run(root, *_mike("list", "--json")))
    return [each["version"] for each in listed]


def is_newest(wanted: Version, others: Iterable[str]) -> bool:
    """True if `latest` should lead to a version: it is not a candidate, and no later one exists."""
    released = [each for each in map(Version, others) if not each.is_prerelease]
    return not wanted.is_prerelease and all(wanted >= each for each in released)


def _mike(*arguments: str) -> tuple[str, ...]:
    command, *rest = arguments
    return (str(PROGRAMS / "mike"), command, "--branch", BRANCH, *rest)


def _run(root: Path, *command: str) -> str:
    """Run a command and return its output.

    Raises:
        ReleaseError: it failed; the text has what it said.
    """
    path = f"{PROGRAMS}{os.pathsep}{os.environ.get('PATH', '')}"  # mike looks for mkdocs there.
    environment = {**os.environ, "PATH": path, "NO_MKDOCS_2_WARNING": "1", "SITE_VERSIONS": "mike"}
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        said = (done.stdout + done.stderr).strip()
        raise ReleaseError(f"`{' '.join(command)}` failed:\n{said}")
    return done.stdout


if __name__ == "__main__":
    raise SystemExit(main())
