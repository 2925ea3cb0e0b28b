"""Write docs/reference/api/ from the docstrings of the packages' exports: a page for each, and an index.

Run it after a change of a public name or its docstring: ``python tools/generate_api.py``. A test compares.
"""

from __future__ import annotations

import ast
import dataclasses
import enum
import importlib
import inspect
import itertools
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType

import msgspec
from pydantic import BaseModel

from rwt_protocol.error_text import annotation_of, expected

ROOT = Path(__file__).parents[1]
TARGET = ROOT / "docs" / "reference" / "api"

_SECTION = re.compile(r"^(Args|Attributes|Raises|Returns|Yields):$")
_ENTRY = re.compile(r"^([\w*, .]+): (.*)$")
_NOTE = "This page is made from the program by `tools/generate_api.py`.\n"


class _Written(str):
    """An annotation as its source has it."""

    def __repr__(self) -> str:
        return str(self)


PACKAGES = (
    "rwt",
    "rwt.cli",
    "rwt.extensions.foxglove",
    "rwt.extensions.dashboard",
    "rwt.extensions.http",
    "rwt.extensions.testing",
    "rwt.extensions.tf_stream",
    "rwt.rosapi",
    "rwt.rosbridge",
    "rwt_client",
    "rwt_graph",
    "rwt_graph.backend",
    "rwt_interfaces",
    "rwt_lerobot",
    "rwt_mavlink",
    "rwt_protocol",
    "rwt_rclpy",
    "rwt_tf2",
    "rwt_transports",
    "rwt_webrtc.media",
)
"""Packages with a public API, each of which has a page."""

SOURCES = (
    ROOT / "src",
    ROOT / "rwt-lerobot" / "src",
    ROOT / "rwt-mavlink" / "src",
    ROOT / "rwt-rclpy" / "src",
    ROOT / "rwt-webrtc" / "src",
)


def pages() -> Mapping[str, str]:
    """Every page by its file's name."""
    index = ["# Packages\n", _NOTE, "| package | what it is |", "|---|---|"]
    for name in PACKAGES:
        first = _plain(inspect.getdoc(importlib.import_module(name)) or "").split("\n\n")[0]
        index.append(f"| [`{name}`]({name}.md) | {' '.join(first.split())} |")
    made = {f"{name}.md": _joined(_linked(_page(importlib.import_module(name)), name)) for name in PACKAGES}
    return {"README.md": _joined(index), **made}


@cache
def _homes() -> Mapping[str, tuple[str, ...]]:
    """The packages with a section for a class or alias, by its name; the one that defines it comes first."""
    found: dict[str, list[str]] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            # Constants and functions are left out: their names are words, and occur as such.
            if re.fullmatch(r"[A-Z]\w*[a-z]\w*", name):
                home = str(getattr(getattr(module, name), "__module__", ""))
                found.setdefault(name, []).append(package)
                if f"{home}.".startswith(f"{package}."):
                    found[name].sort(key=lambda each: (each != package, each))
    return {name: tuple(packages) for name, packages in found.items()}


def _link(name: str, package: str) -> str:
    """The name as a link to its section, on the page of the package if it is there; without one, as code."""
    homes = _homes().get(name, ())
    if not homes:
        return f"`{name}`"
    page = "" if package in homes else f"{homes[0]}.md"
    return f"[`{name}`]({page}#{name.lower()})"


def _linked(lines: Iterable[str], package: str) -> Iterator[str]:
    """Lines of a page with types as links; after a signature, a line with links to its types."""
    code, heading = False, ""
    for line in itertools.chain.from_iterable(each.split("\n") for each in lines):
        if line.startswith("```"):
            code = not code
        if code or line.startswith(("```", "#", ">", "    ")):
            heading = line if line.startswith("#") else heading
            yield line
        elif signature := re.fullmatch(r"`((?:(?:class|exception) )?\w+\(.*)`", line):
            own = set(re.findall(r"\w+", heading))
            names = dict.fromkeys(name for name in re.findall(r"\w+", signature[1]) if name in _homes())
            links = [_link(name, package) for name in names if name not in own]
            yield line
            if links:
                yield f"\nTypes: {', '.join(links)}"
        else:
            yield re.sub(r"(?<!\[)`(\w+)`", lambda found: _link(found[1], package), line)


def _joined(lines: Iterable[str]) -> str:
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip("\n") + "\n"


def _page(package: ModuleType) -> Iterator[str]:
    yield f"# `{package.__name__}`\n"
    yield _NOTE
    yield from _text(inspect.getdoc(package) or "")
    for name in package.__all__:
        yield f"\n## `{name}`\n"
        yield from _entry(package.__name__, name, getattr(package, name))


def _entry(package: str, name: str, value: object) -> Iterator[str]:
    if isinstance(value, type):
        yield from _class(value)
    elif inspect.isroutine(value):
        yield f"`{name}{_signature(value)}`\n"
        yield from _text(inspect.getdoc(value) or "")
    elif isinstance(value, ModuleType):
        yield from _text(inspect.getdoc(value) or "")
    else:
        yield from _text(_constants(package).get(name) or _constants("").get(name, ""))


def _class(cls: type) -> Iterator[str]:
    bases = [base.__name__ for base in cls.__bases__ if base.__module__.startswith("rwt")]
    if issubclass(cls, BaseModel):
        yield f"`class {cls.__name__}({', '.join(bases) or 'BaseModel'})`\n"
    elif issubclass(cls, Exception):
        yield f"`exception {cls.__name__}({', '.join(base.__name__ for base in cls.__bases__)})`\n"
    elif issubclass(cls, enum.Enum):
        yield f"`enum {cls.__name__}`\n"
    else:
        yield f"`class {cls.__name__}{_signature(cls)}`\n"
    yield from _text(inspect.cleandoc(cls.__doc__ or ""))
    if issubclass(cls, BaseModel):
        yield "\n| member | takes | default |\n|---|---|---|"
        for name, field in cls.model_fields.items():
            default = "needed" if field.is_required() else f"`{_default(field.get_default())}`"
            yield f"| `{name}` | {expected(annotation_of(field)).replace('|', chr(92) + '|')} | {default} |"
    elif issubclass(cls, enum.Enum):
        yield "\n" + ", ".join(f"`{member.name}`" for member in cls) + "."
    for name, member in _members(cls):
        yield f"\n### `{cls.__name__}.{name}`\n"
        if not isinstance(member, property):
            yield f"`{name}{_signature(member)}`\n"
        yield from _text(inspect.getdoc(member) or "")


def _members(cls: type) -> Iterator[tuple[str, object]]:
    """The methods and properties that a class has, or has from one of ours that is not public."""
    fields = {field.name for field in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()
    for name, member in vars(cls).items():
        found = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        shown = inspect.isfunction(found) or isinstance(found, property)
        if shown and not name.startswith("_") and name not in fields and inspect.getdoc(found):
            yield name, found


def _signature(value: object) -> str:
    """The signature as the source has it, without self; of a msgspec structure, its members."""
    if isinstance(value, type) and issubclass(value, msgspec.Struct):
        return f"({', '.join(value.__struct_fields__)})"
    if not callable(value):
        return "(…)"
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):
        return "(…)"
    parameters = [
        parameter.replace(
            annotation=_annotation(parameter.annotation),
            default=parameter.default
            if parameter.default is parameter.empty
            else _Written(_default(parameter.default)),
        )
        for parameter in signature.parameters.values()
        if parameter.name not in ("self", "cls")
    ]
    result = _annotation(signature.return_annotation) if not isinstance(value, type) else signature.empty
    return str(signature.replace(parameters=parameters, return_annotation=result))


def _annotation(annotation: object) -> object:
    if annotation is inspect.Parameter.empty:
        return annotation
    return _Written(annotation if isinstance(annotation, str) else inspect.formatannotation(annotation))


def _default(value: object) -> str:
    if isinstance(value, enum.Enum):
        return f"{type(value).__name__}.{value.name}"
    text = repr(value)
    return "…" if " at 0x" in text or len(text) > 60 else text


@cache
def _constants(package: str) -> Mapping[str, str]:
    """The docstrings of what is assigned at the top of a package's modules; of all of them without a name."""
    found: dict[str, str] = {}
    folder = package.replace(".", "/")
    for path in sorted(path for source in SOURCES for path in (source / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        tree = ast.parse(source)
        for body in (tree.body, *(node.orelse for node in tree.body if isinstance(node, ast.If))):
            for node, after in itertools.zip_longest(body, body[1:]):
                targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
                doc = _doc_of(node, after, source.splitlines())
                if isinstance(targets[0], ast.Name) and doc:
                    found.setdefault(targets[0].id, doc)
    return found


def _doc_of(node: ast.stmt, after: ast.stmt | None, lines: list[str]) -> str:
    """The string after an assignment, or the comment with ``#:`` before it."""
    if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
        return inspect.cleandoc(str(after.value.value))
    above = itertools.takewhile(lambda line: line.startswith("#:"), reversed(lines[: node.lineno - 1]))
    return "\n".join(reversed([line.removeprefix("#:").strip() for line in above]))


def _text(doc: str) -> Iterator[str]:
    """A docstring as Markdown: sections as lists, examples as code."""
    for block in _plain(doc).split("\n\n"):
        lines = block.strip("\n").splitlines()
        if not lines:
            continue
        if lines[0].startswith(">>> "):
            yield "<!-- not run: an example of the docstring -->\n```pycon"
            yield from lines
            yield "```\n"
        elif section := _SECTION.match(lines[0]):
            yield f"{section[1]}:\n"
            yield from _list(textwrap.dedent("\n".join(lines[1:])).splitlines())
            yield ""
        else:
            yield from lines
            yield ""


def _list(lines: list[str]) -> Iterator[str]:
    for line in lines:
        entry = _ENTRY.match(line)
        if entry:
            yield f"- `{entry[1]}`: {entry[2]}"
        else:
            yield ("  " if line.startswith(" ") else "- ") + line.strip()


def _plain(doc: str) -> str:
    """Roles and literals of reStructuredText as code."""
    doc = re.sub(r":\w+:`~?(?:[^`<]*\.)?([^`.]+)`", r"`\1`", doc)
    return re.sub(r"``([^`]+)``", r"`\1`", doc)


def main(arguments: list[str]) -> int:
    """Write the pages, or say which are not current."""
    made = pages()
    if "--check" in arguments:
        there = {path.name: path.read_text(encoding="utf-8") for path in TARGET.glob("*.md")}
        stale = sorted(name for name in {*made, *there} if made.get(name) != there.get(name))
        for name in stale:
            print(f"docs/reference/api/{name} is not current: run python tools/generate_api.py")
        return 1 if stale else 0
    TARGET.mkdir(parents=True, exist_ok=True)
    for path in TARGET.glob("*.md"):
        if path.name not in made:
            path.unlink()
    for name, text in made.items():
        (TARGET / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
