"""Build everything that a release publishes, prove that it can be built again bit for bit, and check it.

    python -m tools.build_release [--out dist]

Wheels and source distributions of `robot-web-tools`, `rwt-webrtc`, `rwt-rclpy`, `rwt-lerobot`,
`rwt-mavlink`, `lerobot_robot_rosbridge` and `rosbridge-conformance`, and the npm package of the elements, are
built twice, from two copies of what is committed, in folders with other names and at other times; the two
must be equal. Then `twine`, `check-wheel-contents`, `pyroma` and `publint` look at them, and `SHA256SUMS` is
written beside them. Nothing is published.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path

ROOT = Path(__file__).parents[1]
DISTRIBUTIONS: Mapping[str, Path] = {
    "robot-web-tools": Path(),
    "rwt-webrtc": Path("rwt-webrtc"),
    "rwt-rclpy": Path("rwt-rclpy"),
    "rwt-lerobot": Path("rwt-lerobot"),
    "rwt-mavlink": Path("rwt-mavlink"),
    "lerobot_robot_rosbridge": Path("rwt-lerobot/plugin"),
    "rosbridge-conformance": Path("conformance"),
}
"""Each distribution with its folder, relative to the top of the repository."""

OURS = ("rwt", "rosbridge_conformance", "lerobot_robot_rosbridge")
"""Prefixes of the names that may be at the top level of site-packages."""


LEAST_RATING = "10"
"""Minimum rating by `pyroma` of each distribution, of 10."""

UNASKED = "Url,AuthorEmail"
"""Excluded checks of pyroma: the repository's address, which the first release adds, and an author's."""


class ReleaseError(Exception):
    """Something is not fit to be published; the text says what, and what to do."""


def main() -> int:
    """Build, compare, check, and say what there is."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="where the files go (default dist)")
    out: Path = parser.parse_args().out
    try:
        files = build_release(out)
    except ReleaseError as error:
        sys.stderr.write(f"build_release: {error}\n")
        return 1
    for file in files:
        print(f"{file.stat().st_size / 1e6:8.2f} MB  {file.name}")
    print(f"the same bytes twice; checked; sums in {out / 'SHA256SUMS'}")
    return 0


def build_release(out: Path, installed: Path | None = None) -> list[Path]:
    """Build every distribution into a folder, which is emptied first.

    Args:
        out: the folder.
        installed: what npm has installed by the lock file of the page; without it, npm installs it here.

    Raises:
        ReleaseError: a build failed, two builds differ, or a check found something.
    """
    # Both builds are of one commit, even if another is made meanwhile.
    commit, when = output("git", "log", "-1", "--format=%H %ct").split()
    with tempfile.TemporaryDirectory() as folder:
        first = build_once(Path(folder) / "first", commit, when, installed)
        installed = installed or Path(folder) / "first" / "source" / "web" / "node_modules"
        second = build_once(Path(folder) / "second of another length", commit, when, installed)
        if sums(first) != sums(second):
            odd = sorted(set(sums(first).items()) ^ set(sums(second).items()))
            raise ReleaseError(f"two builds of the same commit differ: {sorted({name for name, _ in odd})}")
        for file in first:
            if file.suffix == ".whl":
                check_top_level(file)
        python = [file for file in first if file.suffix != ".tgz"]
        check("twine", "check", "--strict", *map(str, python))
        check("check_wheel_contents", *(str(file) for file in python if file.suffix == ".whl"))
        for file in python:
            if file.suffix == ".gz":
                check("pyroma", "--min", LEAST_RATING, "--skip-tests", UNASKED, "--file", str(file))
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        files = [Path(shutil.copy2(file, out)) for file in first]
    lines = (f"{digest}  {name}\n" for name, digest in sums(files).items())
    (out / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")
    return files


def build_once(folder: Path, commit: str, when: str, installed: Path | None = None) -> list[Path]:
    """The files of one build, from a copy of a commit.

    Args:
        installed: what npm has installed by the same lock file, which serves for this build, too.
    """
    copy = folder / "source"
    copy.mkdir(parents=True)
    with tarfile.open(fileobj=BytesIO(run("git", "archive", commit))) as archive:
        archive.extractall(copy, filter="data")
    # The robot's page is part of the wheel: installing it needs no Node.
    web = str(copy / "web")
    if installed is None:
        run("npm", "ci", "--prefix", web, "--no-audit", "--no-fund", "--loglevel=error")
    else:
        shutil.copytree(installed, copy / "web" / "node_modules", symlinks=True, copy_function=link)
    run("npm", "run", "--silent", "--prefix", web, "build")
    widgets = folder / "widgets"
    out = folder / "out"
    out.mkdir()
    run("node", f"{web}/package_widgets.mjs", str(widgets))
    run("npm", "pack", "--silent", "--pack-destination", str(out), str(widgets))
    run("node", f"{web}/node_modules/publint/src/cli.js", "--strict", str(widgets))
    for where in DISTRIBUTIONS.values():
        run(
            *(
                sys.executable,
                "-m",
                "build",
                "--no-isolation",
                "--outdir",
                str(out),
                str(copy / where),
            ),
            environment={"SOURCE_DATE_EPOCH": when},
        )
    return sorted(out.iterdir())


def link(source: str, target: str) -> None:
    """Give a file a second name; on another file system, where it can have none, copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def check_top_level(wheel: Path) -> None:
    """Let nothing but our packages land at the top of site-packages."""
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.split("/")[0] for name in archive.namelist()}
    foreign = {top for top in tops if not top.startswith(OURS) and not top.endswith(".dist-info")}
    if foreign:
        raise ReleaseError(f"{wheel.name} would put {sorted(foreign)} at the top of site-packages")


def sums(files: Iterable[Path]) -> dict[str, str]:
    """The SHA-256 of each file by its name."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(files)}


def check(module: str, *arguments: str) -> None:
    """Run a checker of files; what it finds is an error."""
    run(sys.executable, "-m", module, *arguments)


def output(*command: str) -> str:
    """Return a command's output, stripped."""
    return run(*command).decode().strip()


def run(*command: str, environment: Mapping[str, str] | None = None) -> bytes:
    """Run a command at the top of the repository; returns its standard output.

    Raises:
        ReleaseError: it failed; the text has what it said.
    """
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, **(environment or {})}, capture_output=True)
    if done.returncode != 0:
        said = (done.stdout + done.stderr).decode(errors="replace").strip()
        raise ReleaseError(f"`{' '.join(command)}` failed:\n{said}")
    return done.stdout


if __name__ == "__main__":
    raise SystemExit(main())
