"""Show that each extension can be removed: its folder and its rows, in a copy of the project.

``python tools/without_extension.py`` tries all, ``python tools/without_extension.py foxglove`` one. In each
copy a server starts and answers a client, mypy checks the sources, and the tests of the core and of the other
extensions pass. Nightly, because it takes minutes for each.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
EXTENSIONS: Final = ROOT / "src" / "rwt" / "extensions"
WEBRTC: Final = "webrtc"
"""Extension in a distribution of its own."""

COPIED: Final = (
    *("src", "conformance", "examples", "tests", "docs"),
    *("rwt-webrtc", "rwt-rclpy", "rwt-lerobot", "rwt-mavlink"),
)

NEEDED_BY: Final = {
    "asgi": ("mcp",),
    "depth_cloud": ("demo",),
    "markers": ("demo",),
    "meshes": ("recording", "mcp"),
    "recording": ("mcp",),
    "video": (WEBRTC,),
    "zenoh": ("workers",),
}
"""Extensions that import another one, and are removed with it; a contract in pyproject.toml lists them."""

SERVE: Final = """
import anyio
from rwt import Server, connect

async def main():
    async with Server("ws://127.0.0.1:0") as server, connect(server.urls[0]) as robot:
        print(len(await robot.topics()))

anyio.run(main)
"""


def extensions() -> list[str]:
    """Return the names of the extensions."""
    return [*sorted(each.name for each in EXTENSIONS.iterdir() if (each / "__init__.py").is_file()), WEBRTC]


def without_rows(text: str, package: str) -> str:
    """Return `rwt/parts.py` without the rows that refer to a package."""
    one_line = re.compile(rf'^ +"[^"]+": (?:Command)?Row\([^\n]*"{package}\.[^\n]*\),\n', re.MULTILINE)
    begin, other = r'^( +)"[^"]+": (?:Command)?Row\(\n', r"(?:\1 +[^\n]*\n)*?"
    several = re.compile(
        rf'{begin}{other}\1 +[^\n]*"{package}\.[^\n]*\n{other}\1\),\n',
        re.MULTILINE,
    )
    return several.sub("", one_line.sub("", text))


def copy_without(names: tuple[str, ...], folder: Path) -> None:
    """Copy the project without some extensions and their tests."""
    ignored = shutil.ignore_patterns("__pycache__", "node_modules", "static", ".mypy_cache")
    for each in COPIED:
        shutil.copytree(ROOT / each, folder / each, ignore=ignored)
    shutil.copy2(ROOT / "pyproject.toml", folder)
    table = folder / "src" / "rwt" / "parts.py"
    text = table.read_text(encoding="utf-8")
    for name in names:
        if name == WEBRTC:
            shutil.rmtree(folder / "rwt-webrtc")
            text = without_rows(text, "rwt_webrtc")
        else:
            shutil.rmtree(folder / "src" / "rwt" / "extensions" / name)
            shutil.rmtree(folder / "tests" / "extensions" / name, ignore_errors=True)
            text = without_rows(text, rf"rwt\.extensions\.{name}")
    table.write_text(text, encoding="utf-8")


def remaining_tests(names: tuple[str, ...], folder: Path) -> Iterator[str]:
    """Yield the test files of the core and of other extensions that do not use the removed ones."""
    words = [
        r"rwt_webrtc|tests\.webrtc" if name == WEBRTC else rf"rwt\.extensions\.{name}\b" for name in names
    ]
    uses = re.compile("|".join(words))
    tests = folder / "tests"
    for file in sorted([*(tests / "core").rglob("test_*.py"), *(tests / "extensions").rglob("test_*.py")]):
        if "live" not in file.parts and not uses.search(file.read_text(encoding="utf-8")):
            yield str(file.relative_to(folder))


def check(name: str, *, tests: bool) -> bool:
    """Remove one extension in a copy; True if everything else works."""
    names = (name, *NEEDED_BY.get(name, ()))
    with tempfile.TemporaryDirectory(prefix="rwt-without-") as temporary:
        folder = Path(temporary)
        copy_without(names, folder)
        sources = [folder / "src", folder / "conformance", *folder.glob("rwt-*/src"), folder]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sources))}
        steps = {
            "server": [sys.executable, "-c", SERVE],
            "mypy": [sys.executable, "-m", "mypy", "src"],
        }
        if tests:
            steps["tests"] = [
                sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "not slow",
                *remaining_tests(names, folder),
            ]  # fmt: skip
        for step, command in steps.items():
            done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
            if done.returncode:
                print(
                    f"without {name}: {step} failed\n{done.stdout[-4000:]}{done.stderr[-2000:]}", flush=True
                )
                return False
    print(f"without {' and '.join(names)}: {', '.join(steps)} passed", flush=True)
    return True


def main() -> int:
    """Try the extensions of the command line, or all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"extensions, of {', '.join(extensions())}")
    parser.add_argument("--no-tests", action="store_true", help="start a server and run mypy only")
    options = parser.parse_args()
    results = [check(name, tests=not options.no_tests) for name in options.names or extensions()]
    return 0 if all(results) else 1


if __name__ == "__main__":
    raise SystemExit(main())
