"""The page about the architecture is what the folders, the imports and the import rules say."""

from __future__ import annotations

import itertools
import re
import tomllib

from tools import generate_rooms

PAGE = generate_rooms.PAGE.read_text(encoding="utf-8")


def _section(title: str) -> str:
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def test_the_rooms_on_the_page_are_the_folders() -> None:
    assert generate_rooms.with_table(PAGE) == PAGE, "run python tools/generate_rooms.py"


def test_every_folder_says_its_question() -> None:
    found = generate_rooms.packages()
    assert len(found) > 50
    for name, init in found.items():
        assert len(generate_rooms.question(init)) > 15, name


def test_the_circles_that_remain_are_listed_with_a_reason() -> None:
    rows = [
        row.split("|")[1:3] for row in _section("Circles that remain").splitlines() if row.startswith("| `")
    ]
    listed = [tuple(sorted(re.findall(r"`([\w.]+)`", names))) for names, _ in rows]
    assert sorted(listed) == [*generate_rooms.circles()]
    assert all(len(reason.strip()) > 20 for _, reason in rows)


def test_the_picture_shows_every_package_at_its_layer() -> None:
    rules = tomllib.loads((generate_rooms.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "importlinter"
    ]
    contract = next(rule for rule in rules["contracts"] if rule["type"] == "layers")
    layers = [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]
    picture = PAGE.split("```text\n")[1].split("```")[0].splitlines()
    line_of = {name: number for number, line in enumerate(picture) for name in re.findall(r"rwt\w*", line)}
    assert set(line_of) == {name for layer in layers for name in layer}
    for upper, lower in itertools.pairwise(layers):
        assert max(line_of[name] for name in upper) <= min(line_of[name] for name in lower)
    section = _section("Packages and dependencies")
    table = re.findall(r"^\| `(rwt\w*)` \|", section, re.MULTILINE)
    assert sorted(table) == sorted(line_of)


def test_the_folders_of_the_server_are_in_picture_and_table() -> None:
    section = _section("Packages and dependencies")
    listed = {name.split(".")[0] for name in re.findall(r"^\| `rwt\.([\w.]+)` \|", section, re.MULTILINE)}
    drawn = set(re.findall(r"(\w+)/", section.split("```text\n")[1].split("```")[0])) - {"gate"}
    folders = {path.parent.name for path in (generate_rooms.ROOT / "src" / "rwt").glob("*/__init__.py")}
    assert drawn == folders
    assert listed == folders - {"observability", "settings"}
