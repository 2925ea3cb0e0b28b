"""Counted figures: lines by kind, imports, protocols, and calls per message."""

from __future__ import annotations

import ast
from pathlib import Path
from types import ModuleType

import pytest

from tools.size import calls, complexity, loaded
from tools.size.__main__ import grown
from tools.size.calls import CallCounter, CallCounts, FunctionCalls
from tools.size.layout import Layout, source_files
from tools.size.source import LineCounts, count_lines, is_alias, rejected_docstrings
from tools.size.structure import Module, Protocols, shared_names, small_modules

SOURCE = '''"""A module.

More of it.
"""

# A comment.
LIMIT = 3  # with a comment
"""An attribute."""


def run(
    text: str = """two
lines""",
) -> None:
    """What it does."""

    # Another comment.
    print(text)  # noqa: T201
'''


def test_lines_by_kind() -> None:
    assert count_lines(SOURCE) == LineCounts(lines=18, code=7, comments=3)
    assert count_lines("") == LineCounts()
    assert count_lines('x = "# none"') == LineCounts(lines=1, code=1)


def test_a_docstring_beside_code_is_no_code_and_its_line_is() -> None:
    assert count_lines('class E(Exception): """An error."""\n') == LineCounts(lines=1, code=1)


def test_a_module_is_an_alias_if_its_docstring_says_so() -> None:
    assert is_alias('"""Deprecated alias of `rwt.tls`."""')
    assert not is_alias(SOURCE) and not is_alias("")


def test_docstrings_that_begin_with_a_rejected_word() -> None:
    assert list(rejected_docstrings(ast.parse(SOURCE))) == [(15, "What it does.")]


def modules(folder: Path, **sources: str) -> list[Module]:
    for name, text in sources.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    return [Module.read(name, folder / f"{name}.py") for name in sources]


def test_small_modules_with_one_importer(tmp_path: Path) -> None:
    found = modules(
        tmp_path,
        used_once="",
        used_twice="",
        large="\n" * 80,
        one="import used_once\nfrom used_twice import x\nimport large",
        two="def f():\n    import used_twice",
    )
    assert [(module.name, importer) for module, importer in small_modules(found, found)] == [
        ("used_once", "one")
    ]


def test_names_of_classes_in_several_modules(tmp_path: Path) -> None:
    found = modules(
        tmp_path, one="class A: ...\nclass B: ...", two="class B: ...\nclass C:\n    class A: ..."
    )
    assert shared_names(found) == {"A": ["one", "two"], "B": ["one", "two"]}


def test_protocols_and_their_implementations(tmp_path: Path) -> None:
    found = modules(
        tmp_path,
        api="from typing import Protocol\n"
        "class Closes(Protocol):\n    def close(self): ...\n"
        "class Opens(Closes, Protocol):\n    def open(self): ...\n"
        "class HasName(Protocol):\n    @property\n    def name(self): ...\n",
        package="from api import Closes as Base",
        named="import package\nclass File(package.Base): ...\nclass Log(File): ...",
        structural="class Door:\n    def close(self): ...\n"
        "    def __init__(self):\n        self.open = self.name = 1",
    )
    uses = {use.protocol.id[1]: use for use in Protocols(found).uses(["api"])}
    assert list(uses) == ["HasName", "Opens", "Closes"]
    assert uses["Closes"].named == (("named", "File"), ("named", "Log"))
    assert uses["Closes"].structural == (("structural", "Door"),)
    assert uses["Opens"].implementations == uses["HasName"].implementations == 1
    assert [use.data_only for use in uses.values()] == [True, False, False]


LARGE = """
class State(Enum): ...
class Order(Enum): ...
class Mode(Enum): ...
FIRST: Final = State.FIRST
MODES = {{Mode.ON: {{Mode.OFF}}, Mode.OFF: {{Mode.ON}}}}
class Named:
    def run(self):
        self._state: State = first()
        {fourteen}
class Nameless:
    order = Order.FIRST
    def run(self):
        self._order = Order.FIRST
        {fourteen}
class Through:
    def run(self):
        self._state = FIRST
        {fourteen}
class Tabled:
    def run(self):
        self._mode = Mode.ON
        {fourteen}
class Small:
    def __init__(self):
        {fourteen}
"""


def test_classes_with_many_attributes_and_their_states(tmp_path: Path) -> None:
    fourteen = "; ".join(f"self.x{number}, other.y = 1, 2" for number in range(14))
    found = complexity.large_classes(modules(tmp_path, large=LARGE.format(fourteen=fourteen)))
    assert [(each.name, each.attributes, each.state) for each in found] == [
        ("large.Named", 15, "State"),
        ("large.Nameless", 15, ""),
        ("large.Tabled", 15, "Mode"),
        ("large.Through", 15, "State"),
    ]


def test_long_functions_without_their_docstrings(tmp_path: Path) -> None:
    body = '    """Docstring.\n\n    Its end.\n    """\n' + "    pass\n" * 49
    found = modules(tmp_path, long=f"def fifty():\n{body}def longer():\n{body}    pass\n")
    assert [(each.name, each.lines) for each in complexity.long_functions(found)] == [("longer", 51)]


def test_functions_that_exist_plain_and_in_steps(tmp_path: Path) -> None:
    text = (
        "def read(): ...\ndef _read(): ...\ndef _read_in_steps(): ...\ndef write_in_steps(): ...\n"
        "class C:\n    def write(self): ...\n    def _write_in_steps(self): ..."
    )
    (module,) = modules(tmp_path, pairs=text)
    assert list(complexity.step_pairs(module)) == [(2, "_read"), (6, "write")]


def test_the_ratchet_names_figures_that_have_grown() -> None:
    recorded = {"protocols": 3.0, "modules": 5.0}
    assert list(grown({"protocols": 4, "modules": 5, "classes": 1}, recorded)) == [
        "protocols: 4 (recorded: 3.0)",
        "classes: 1 (not recorded)",
    ]


def test_the_packages_are_those_of_the_wheels() -> None:
    layout = Layout()
    assert layout.packages.keys() >= {*layout.wheel, "rwt_rclpy", "rwt_lerobot", "rwt_mavlink"}
    assert all((folder / "__init__.py").is_file() for folder in layout.packages.values())
    assert "rwt.server" in dict(source_files(layout.packages))


def test_distributions_in_folders_count(tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text('[tool.hatch.build.targets.wheel]\npackages = ["src/rwt"]\n')
    package = tmp_path / "rwt-rclpy" / "src" / "rwt_rclpy"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (tmp_path / "rwt-rclpy" / "pyproject.toml").touch()
    (tmp_path / "rwt-rclpy" / "tests").mkdir()
    layout = Layout(tmp_path)
    assert layout.projects == {
        ".": {"rwt": tmp_path / "src" / "rwt"},
        "rwt-rclpy": {"rwt_rclpy": package},
    }
    assert layout.packages == {"rwt": tmp_path / "src" / "rwt", "rwt_rclpy": package}
    assert layout.wheel == ("rwt",)
    assert layout.tests == (tmp_path / "rwt-rclpy" / "tests",)


def test_calls_are_counted_in_the_order_of_the_first_with_their_depth(tmp_path: Path) -> None:
    path = tmp_path / "ours.py"
    text = "def outer():\n    for _ in steps(): inner()\ndef inner(): ...\ndef steps():\n    yield\n    yield"
    ours = ModuleType("ours")
    exec(compile(text, str(path), "exec"), vars(ours))
    with CallCounter([tmp_path]) as counter:
        for _ in range(2):
            ours.outer()
        ast.parse("")
    counts = counter.counts(2)
    assert counts.functions == (
        FunctionCalls(str(path), 1, "outer", 0, 2),
        FunctionCalls(str(path), 4, "steps", 1, 6),
        FunctionCalls(str(path), 3, "inner", 1, 4),
    )
    assert counts.per_message(counts.functions) == 6.0


def test_functions_that_run_for_few_messages_are_background() -> None:
    steady, background = FunctionCalls("a.py", 1, "f", 0, 180), FunctionCalls("b.py", 1, "g", 0, 179)
    counts = CallCounts(200, (background, steady))
    assert (counts.steady, counts.background) == ((steady,), (background,))
    assert (counts.files, counts.classes) == (1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", calls.SCENARIOS)
def test_calls_per_message_of_a_server(name: str) -> None:
    counts = calls.measure(Layout(), name)
    assert counts.messages == calls.MESSAGES
    assert counts.steady[0].depth == 0
    assert counts.files > 5 < counts.classes


@pytest.mark.slow
def test_lines_that_a_server_loads() -> None:
    startup, after = loaded.measure(Layout())
    assert 0 < startup.modules <= after.modules
    assert startup.modules < startup.lines <= after.lines
