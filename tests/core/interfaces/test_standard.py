"""The data behind the standard interfaces."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rwt_interfaces import standard
from rwt_interfaces.definitions.parser import format_message, parse_message
from rwt_interfaces.distro import DISTROS, Distro
from rwt_interfaces.registry import Registry
from tools import generate_standard

ROOT = Path(__file__).parents[3]
DATA = Path(standard.__file__).parent
BOTH = pytest.mark.parametrize("distro", DISTROS.values(), ids=DISTROS)


@BOTH
def test_generated_files_are_what_the_tool_writes(distro: Distro) -> None:
    written = {
        path.name.partition(".")[0]: path.read_text("utf-8")
        for path in (DATA / distro.name).glob("*.generated.txt")
    }
    assert written == generate_standard.generate(distro.name)


@pytest.mark.parametrize(
    "path", sorted(DATA.glob("*/*.txt")), ids=lambda path: f"{path.parent.name}/{path.name}"
)
def test_a_data_file_is_sections_of_plain_definitions(path: Path) -> None:
    text = path.read_text("utf-8")
    sections = standard.split(text)
    assert "".join(f"=== {kind}/{name}\n{body}" for (kind, name), body in sections.items()) == text
    assert "#" not in text


@BOTH
def test_a_written_file_does_not_hide_a_generated_section(distro: Distro) -> None:
    for generated in (DATA / distro.name).glob("*.generated.txt"):
        package = generated.name.partition(".")[0]
        for folder in ("both", distro.name):
            written = DATA / folder / f"{package}.txt"
            if written.is_file():
                assert (
                    not standard.split(written.read_text()).keys()
                    & standard.split(generated.read_text()).keys()
                )


@BOTH
def test_every_standard_message_is_written_as_it_would_be_formatted_again(distro: Distro) -> None:
    registry = Registry(distro)
    for name in registry.names("msg"):
        definition = registry.definition(name)
        again = parse_message(format_message(definition), name, distro=distro)
        assert again == definition


def test_renamed_packages_have_the_same_content_under_their_own_name() -> None:
    for copy, original in standard.RENAMED.items():
        assert standard.package("jazzy", copy) == standard.package("jazzy", original) != {}
    registry = Registry()
    assert registry.service("rosapi_msgs/Nodes") is not registry.service("rosapi/Nodes")
    details = registry.service("rosapi_msgs/MessageDetails").response.definition
    assert details.fields[0].type.name == "rosapi_msgs/TypeDef"


def test_a_package_that_does_not_exist_is_empty() -> None:
    assert standard.package("jazzy", "none") == {}
    assert standard.package("jazzy", "../noetic/std_msgs") == {}


def test_importing_reads_no_data() -> None:
    program = (
        "import rwt_interfaces.registry as r, rwt_interfaces.standard as s\n"
        "registry = r.Registry()\n"
        "assert s._texts.cache_info().currsize == 0\n"
        "registry.message('std_msgs/String')\n"
        "assert s._texts.cache_info().currsize == 1\n"
    )
    subprocess.run(
        [sys.executable, "-c", program], check=True, timeout=20, env={"PYTHONPATH": str(ROOT / "src")}
    )
