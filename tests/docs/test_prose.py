"""Claims of the documentation: commands, events, what must be installed first."""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import tomllib
from importlib.metadata import distribution
from pathlib import Path

import pytest

from rwt import parts
from rwt.cli import COMMANDS, parser_for
from rwt.cli.parser import Parser, actions_of
from tests.docs.blocks import ALL_BLOCKS, PAGES, ROOT, Block, blocks_of

_FENCED = re.compile(r"^( *)```.*?^ *```$|<!--.*?-->", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`([^`]+)`")
_EVENT = re.compile(r"\bros\.on(?:ce|Any)?\((?:[\"']([^\"']+)[\"'])?")
_IMPORT = re.compile(
    r"^import .*? from [\"']([^.\"'][^\"']*)[\"']|src=\"node_modules/([^/\"]+)/", re.MULTILINE
)
_PIP = re.compile(r"pip install ((?:[^\s`)\"';:]|\"[^\"\s]+\"|'[^'\s]+'| (?=[\w.'\"]))+)")
_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

#: Pages whose commands and events are run by a test of their own.
_RUN_BY_OTHERS = {
    "docs/how-to/from-roslibpy.md": "test_migration.py runs each row of its table",
    "docs/contributing/command.md": "test_contributing.py adds the command that it names",
}


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def _prose(page: Path) -> str:
    return _FENCED.sub("", page.read_text(encoding="utf-8"))


_READ = [page for page in PAGES if _name(page) not in _RUN_BY_OTHERS]
_INLINE = [
    (_name(page), " ".join(code.split()))
    for page in _READ
    for code in _CODE.findall(_prose(page))
    if re.match(r"(?:\.venv/bin/)?rwt \S", " ".join(code.split()))
]


# -- commands ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("page", "line"), sorted(set(_INLINE)), ids=lambda text: text[:60])
def test_a_command_in_a_sentence_is_one(page: str, line: str) -> None:
    assert _mistake(line) == ""


def _mistake(line: str) -> str:
    """Return the error of a command line, in which only the command is required; empty if there is none."""
    words = shlex.split(line)[1:]
    if words[0].startswith("-"):
        return "" if words[0] in _options(parser_for(None)) else f"no option {words[0]}"
    if words[0] not in [command.name for command in COMMANDS]:
        return f"no command {words[0]}"
    parser = _choices(parser_for(words[0]))[words[0]]
    verbs = _choices(parser)
    if verbs and len(words) > 1 and words[1].isascii() and words[1].islower():
        if words[1] not in verbs or verbs[words[1]].unavailable:
            return f"no verb {words[1]} of {words[0]}"
        parser = verbs[words[1]]
    own = words[: words.index("--")] if "--" in words else words
    known = _options(parser)
    if any(action.option_strings == [] and action.nargs == "..." for action in actions_of(parser)):
        return ""  # It hands everything to a program with a parser of its own.
    options = [word.partition("=")[0] for word in own if re.match(r"--?[a-z]", word)]
    return "".join(f"no option {option}" for option in options if option not in known)


def _options(parser: argparse.ArgumentParser) -> set[str]:
    return {option for action in actions_of(parser) for option in action.option_strings}


def _choices(parser: Parser) -> dict[str, Parser]:
    found = [action.choices for action in actions_of(parser) if isinstance(action.choices, dict)]
    return next((each for each in found if all(isinstance(one, Parser) for one in each.values())), {})


_BESIDE = re.compile(r"\s+[#|&><]|\s{2,}")
"""Rest of a line behind a command: a comment, another command, a file."""


@pytest.mark.parametrize("page", _READ, ids=_name)
def test_a_command_in_a_block_that_is_not_run_is_one(page: Path) -> None:
    code = "\n".join(block.code for block in blocks_of(page) if not _is_run(block))
    lines = [_BESIDE.split(line)[0] for line in re.sub(r" *\\\n *", " ", code).splitlines()]
    # Options with a dot are LeRobot's; the command `hello` is that of an extension.
    own = [re.sub(r" --robot\.\S*", "", line) for line in lines if re.match(r"rwt (?!hello)\S", line)]
    assert [(line, mistake) for line in own if (mistake := _mistake(line))] == []


def test_processes_are_not_signalled_by_name() -> None:
    """Client commands have the name of the server's process."""
    by_name = re.compile(r"\b(?:pidof|pkill|killall)\b[^|\n]*\brwt\b")
    assert [_name(page) for page in PAGES if by_name.search(page.read_text(encoding="utf-8"))] == []


def test_programs_check_the_status_of_an_answer() -> None:
    """An error's text would be used as the answer."""
    fetching = [block for block in ALL_BLOCKS if "await fetch(" in block.code]
    assert fetching
    assert [block.name for block in fetching if ".ok)" not in block.code] == []


def test_the_first_robot_of_the_readme_is_short_and_needs_one_import() -> None:
    block = next(block for block in blocks_of(ROOT / "README.md") if "from rwt import Server" in block.code)
    lines = block.code.strip().splitlines()
    assert len(lines) <= 8 and sum(line.startswith(("import ", "from ")) for line in lines) == 1


@pytest.mark.parametrize(("program", "lines"), [("car.py", 45), ("drone.py", 60), ("arm.py", 50)])
def test_whole_robots_are_short(program: str, lines: int) -> None:
    page = blocks_of(ROOT / "docs/how-to/three-robots.md")
    block = next(block for block in page if block.value("file") == program)
    assert len(block.code.strip().splitlines()) <= lines
    assert not re.search(r"anyio|getattr|\.node\b(?!\()", block.code)
    tests = [block for block in page if block.value("run") == "pytest"]
    assert len(tests) == 3
    assert all(len(test.code.strip().splitlines()) <= 25 for test in tests)


# -- events --------------------------------------------------------------------------------------------------


def _is_run(block: Block) -> bool:
    return bool(block.value("run"))


@pytest.mark.parametrize("page", _READ, ids=_name)
def test_an_event_in_a_sentence_is_listened_to_in_a_block_that_runs(page: Path) -> None:
    run = "\n".join(block.code for block in blocks_of(page) if _is_run(block))
    claimed = {event for code in _CODE.findall(_prose(page)) for event in _EVENT.findall(code)}
    assert claimed <= set(_EVENT.findall(run))


# -- what must be installed first ----------------------------------------------------------------------------


_NEEDS_NPM = [
    block
    for block in ALL_BLOCKS
    if block.language in ("js", "html") and _is_run(block) and _IMPORT.search(block.code)
]


@pytest.mark.parametrize("block", _NEEDS_NPM, ids=[block.name for block in _NEEDS_NPM])
def test_a_program_for_node_names_its_packages_and_its_file(block: Block) -> None:
    text = block.page.read_text(encoding="utf-8")
    installed = {
        name.partition("@")[0]
        for line in re.findall(r"npm install ([\w@ .-]+)", text)
        for name in line.split()
        if not name.startswith("-")
    }
    imported = {one or other for one, other in _IMPORT.findall(block.code)}
    assert {name for name in imported if not name.startswith("node:")} <= installed
    if block.language == "js":
        # Node takes `import` in a file `.mjs`; a plain `.js` needs a package.json beside it.
        assert block.value("file").endswith(".mjs")
        assert f"`{block.value('file')}`" in _prose(block.page)


def _installs(text: str) -> list[str]:
    return [word.strip("\"'") for line in _PIP.findall(text) for word in line.split()]


def test_pages_install_from_a_clone_while_there_is_no_release() -> None:
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{_PROJECT['version']}] - unreleased" in changes, "released: pages may install it by its name"
    extras = _PROJECT["optional-dependencies"]
    wanted = {(_name(page), word) for page in PAGES for word in _installs(page.read_text(encoding="utf-8"))}
    assert ("docs/how-to/zenoh.md", ".[zenoh]") in wanted
    for page, word in sorted(wanted):
        name, _, extra = word.rstrip("]").partition("[")
        assert name != _PROJECT["name"], f"{page}: {word} is in no index"
        assert not extra or extra in extras, f"{page}: there is no extra {extra}"


@pytest.mark.parametrize("page", ["how-to/embed.md", "how-to/test-an-app.md", "start/robot-maker.md"])
def test_pages_that_install_a_robot_say_how_it_gets_its_dashboard(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert "pip install ." in text
    assert "npm ci --prefix web && npm run --prefix web build" in " ".join(text.split())


def test_error_messages_name_the_extra() -> None:
    named = {
        word
        for module in (ROOT / "src").rglob("*.py")
        for word in _installs(module.read_text(encoding="utf-8"))
        if "robot-web-tools" in word
    }
    extras = {found[1] for word in named if (found := re.match(r"robot-web-tools\[(\w+)\]", word))}
    # The text about a part that is not installed is made from its row.
    extras |= {row.extra for rows in parts.BUILT_IN.values() for row in rows.values() if row.extra}
    assert {"bson", "mcap", "mcp", "tls", "video", "webrtc", "zenoh"} == extras
    assert extras <= set(_PROJECT["optional-dependencies"])


def test_the_readme_says_what_make_needs() -> None:
    needs = re.search(
        r"Both commands need make.*?\n\n", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert needs is not None
    assert "the dashboard also needs Node 20 and npm" in " ".join(needs[0].split())
    assert "npm" in _programs("demo")
    assert not {"npm", "node"} & _programs("test")
    assert "npm" in _programs("test-all")


def _programs(target: str) -> set[str]:
    """The programs that make would run for a target in a fresh clone, but those of its own environment."""
    done = subprocess.run(
        ["make", "--dry-run", "--always-make", target], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return {line.split()[0] for line in done.stdout.splitlines() if not line.startswith(".venv/")}


def test_what_a_server_needs_was_not_compiled_here() -> None:
    compiled = []
    for requirement in _PROJECT["dependencies"]:
        name = re.split(r"[<>=; ]", requirement)[0]
        wheel = distribution(name).read_text("WHEEL") or ""
        # Wheels of an index say which systems they fit; one that was built here names this system alone.
        if re.search(r"^Tag: .*-linux_\w+$", wheel, re.MULTILINE):
            compiled.append(name)
    assert compiled == [], "the README says that no compiler is needed for `make demo`"
