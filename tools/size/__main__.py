"""Print the counted figures of the project, or one of the lists behind them.

Example: python -m tools.size --calls publish
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Final

from tools.size import calls, complexity, loaded
from tools.size.complexity import LONG_LINES, MANY_ATTRIBUTES, STEPS
from tools.size.layout import ROOT, Layout, source_files
from tools.size.source import LineCounts, count_lines, is_alias, rejected_docstrings, total
from tools.size.structure import (
    MOST_MODULES,
    SMALL_LINES,
    Module,
    Protocols,
    full_folders,
    shared_names,
    small_modules,
)

Figures = dict[str, float]
"""Figures by their names in the table."""

RECORDED: Final = Path(__file__).with_name("recorded.json")
"""Figures that must not grow, as `--record` wrote them."""

AREAS: Final[Mapping[str, tuple[str, ...]]] = {
    "protocol": ("rwt_protocol",),
    "delivery": ("rwt/delivery",),
    "composition": ("rwt/composition",),
    "gateways": (
        "rwt/gateways",
        "rwt/rosbridge",
        *(f"rwt/extensions/{each}" for each in ("foxglove", "http", "mcp")),
    ),
    "wires": ("rwt_transports/wires",),
}
"""Folders of `src` whose share of comments is counted."""


class Report:
    """Figures and lists of the packages.

    Args:
        layout: where the packages are.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout

    @cached_property
    def modules(self) -> list[Module]:
        """Modules of all packages, without deprecated aliases."""
        found = [Module.read(*each) for each in source_files(self._layout.packages)]
        return [each for each in found if not is_alias(each.text)]

    def figures(self) -> Figures:
        """Return all figures of the source that are only reported."""
        files = {path: count_lines(text) for path, text in self._texts(*self._sources())}
        found: Figures = {
            "lines": total(files.values()).lines,
            "lines of code, aliases not counted": total(files[each.path] for each in self.modules).code,
        }
        for project, packages in self._layout.projects.items():
            inside = _within(files, packages.values())
            found[f"lines of code of {'src' if project == '.' else project}"] = inside.code
        found["lines of tests"] = sum(text.count("\n") for _, text in self._texts(*self._layout.tests))
        found["comments, percent of the lines of src"] = _within(files, [self._layout.root / "src"]).commented
        for area, folders in AREAS.items():
            inside = _within(files, (self._layout.root / "src" / each for each in folders))
            found[f"comments, percent of the lines of {area}"] = inside.commented
        found["modules"] = len(self.modules)
        found["top-level packages in the wheel"] = len(self._layout.wheel)
        found["mentions of steps"] = sum(self._mentions.values())
        found["modules that mention steps"] = len(self._mentions)
        return found | self.structure()

    def structure(self) -> Figures:
        """Return the figures of the source that must not grow."""
        uses = Protocols(self.modules).uses(self._layout.packages)
        few = [each for each in uses if each.implementations <= 1]
        large = complexity.large_classes(self.modules)
        stateless = {each.name for each in large if not each.state}
        reasons = complexity.reasons().keys()
        return {
            "class names in several modules": len(shared_names(self.modules)),
            f"modules under {SMALL_LINES} lines with one importer": len(
                small_modules(self.modules, self.modules)
            ),
            "protocols": len(uses),
            "protocols with at most one implementation": len(few),
            "of these, without methods but properties": sum(each.data_only for each in few),
            f"classes with {MANY_ATTRIBUTES} and more attributes": len(large),
            "of these, without a named state": len(stateless),
            "of these, without a reason": len(stateless - reasons),
            "reasons without such a class": len(reasons - stateless),
            f"functions over {LONG_LINES} lines": len(complexity.long_functions(self.modules)),
            "functions that exist plain and in steps": sum(1 for _ in self._pairs()),
            "docstrings that begin with a rejected word": sum(1 for _ in self.docstrings()),
            f"folders with more than {MOST_MODULES} modules": len(full_folders(self.modules)),
        }

    def running(self) -> Figures:
        """Return the figures of servers that run: lines that are loaded, calls per message, import time."""
        startup, after = loaded.measure(self._layout)
        found: Figures = {
            "lines loaded at startup": startup.lines,
            "lines loaded after a client of each protocol": after.lines,
            "modules loaded after a client of each protocol": after.modules,
        }
        for name in calls.SCENARIOS:
            counts = calls.measure(self._layout, name)
            found[f"calls per message: {name}"] = counts.per_message(counts.steady)
            found[f"calls per message: {name}, with background"] = counts.per_message(counts.functions)
            found[f"files per message: {name}"] = counts.files
            found[f"classes per message: {name}"] = counts.classes
        seconds, cpu_seconds = loaded.import_seconds(self._layout)
        found["seconds of `from rwt import Server`"] = seconds
        found["CPU seconds of `from rwt import Server`"] = cpu_seconds
        return found

    def calls(self, name: str) -> Iterator[str]:
        """Yield the functions of a scenario, indented by the depth of the call."""
        counts = calls.measure(self._layout, name)
        for title, functions in (("calls per message", counts.steady), ("background", counts.background)):
            yield f"{calls.SCENARIOS[name].title}: {counts.per_message(functions)} {title}"
            for each in functions:
                where = f"{self._relative(Path(each.file))}:{each.line}"
                yield f"{each.calls / counts.messages:6.2f}  {'  ' * each.depth}{each.function}  {where}"
            yield ""

    def classes(self) -> Iterator[str]:
        """Yield the names of classes that several modules define, with the modules."""
        for name, modules in shared_names(self.modules).items():
            yield f"{name}  {' '.join(modules)}"

    def small(self) -> Iterator[str]:
        """Yield the small modules with one importer, by this importer."""
        found = small_modules(self.modules, self.modules)
        for module, importer in sorted(found, key=lambda each: (each[1], each[0].name)):
            yield f"{module.text.count(chr(10)):3}  {module.name}  imported by {importer}"

    def protocols(self) -> Iterator[str]:
        """Yield the protocols with the numbers of classes that name them, and that define their methods."""
        yield "named  structural  protocol"
        for use in Protocols(self.modules).uses(self._layout.packages):
            found = [".".join(each) for each in (*use.named, *use.structural)][:3]
            name = ".".join(use.protocol.id) + (" (data only)" if use.data_only else "")
            more = " …" if use.implementations > len(found) else ""
            yield f"{len(use.named):5}  {len(use.structural):10}  {name}  {' '.join(found)}{more}"

    def docstrings(self) -> Iterator[str]:
        """Yield the docstrings with a rejected first word."""
        for module in self.modules:
            for line, text in rejected_docstrings(module.tree):
                yield f"{self._relative(module.path)}:{line}: {text}"

    def folders(self) -> Iterator[str]:
        """Yield the folders with too many modules."""
        for folder, count in full_folders(self.modules).items():
            yield f"{count:3}  {self._relative(folder)}"

    def attributes(self) -> Iterator[str]:
        """Yield the classes with many attributes, with their state or the reason why they have none."""
        reasons = complexity.reasons()
        for each in complexity.large_classes(self.modules):
            state = f"state: {each.state}" if each.state else reasons.get(each.name, "no named state")
            yield f"{each.attributes:3}  {each.name}  {self._relative(each.path)}:{each.line}  {state}"

    def functions(self) -> Iterator[str]:
        """Yield the long functions."""
        for each in complexity.long_functions(self.modules):
            yield f"{each.lines:3}  {each.name}  {self._relative(each.path)}:{each.line}"

    def steps(self) -> Iterator[str]:
        """Yield the functions that exist plain and in steps, and the modules that mention steps."""
        yield from self._pairs()
        for path, count in sorted(self._mentions.items(), key=lambda each: -each[1]):
            yield f"{count:3}  {self._relative(path)}"

    def _pairs(self) -> Iterator[str]:
        for module in self.modules:
            for line, name in complexity.step_pairs(module):
                yield f"{self._relative(module.path)}:{line}: {name}"

    @cached_property
    def _mentions(self) -> Mapping[Path, int]:
        counts = {each.path: len(STEPS.findall(each.text)) for each in self.modules}
        return {path: count for path, count in counts.items() if count}

    def _sources(self) -> Iterator[Path]:
        return iter(dict.fromkeys(folder.parent for folder in self._layout.packages.values()))

    @staticmethod
    def _texts(*folders: Path) -> Iterator[tuple[Path, str]]:
        for folder in folders:
            for path in sorted(folder.rglob("*.py")):
                yield path, path.read_text(encoding="utf-8")

    def _relative(self, path: Path) -> Path:
        return path.relative_to(self._layout.root)


LISTS: Final[Mapping[str, tuple[Callable[[Report], Iterator[str]], str]]] = {
    "classes": (Report.classes, "list the class names that several modules define"),
    "small": (Report.small, "list the small modules with one importer"),
    "protocols": (Report.protocols, "list the protocols with their implementations"),
    "docstrings": (Report.docstrings, "list the docstrings with a rejected first word"),
    "attributes": (Report.attributes, "list the classes with many attributes"),
    "functions": (Report.functions, "list the long functions"),
    "steps": (Report.steps, "list the functions that exist plain and in steps"),
    "folders": (Report.folders, "list the folders with too many modules"),
}


def _within(files: Mapping[Path, LineCounts], folders: Iterable[Path]) -> LineCounts:
    """Add up the lines of the files in some folders."""
    folders = list(folders)
    return total(counts for path, counts in files.items() if any(map(path.is_relative_to, folders)))


def table(figures: Figures) -> Iterator[str]:
    """Yield one aligned line for each figure."""
    width = max(map(len, figures))
    for name, value in figures.items():
        yield f"{name:{width}}  {value:>9,}"


def grown(figures: Figures, recorded: Figures) -> Iterator[str]:
    """Yield a line for each figure that is larger than recorded, or that is not recorded."""
    for name, value in figures.items():
        if name not in recorded:
            yield f"{name}: {value:,} (not recorded)"
        elif value > recorded[name]:
            yield f"{name}: {value:,} (recorded: {recorded[name]:,})"


def main(argv: list[str] | None = None) -> int:
    """Print what the command line asks for; return 1 if a recorded figure has grown."""
    parser = argparse.ArgumentParser(prog="python -m tools.size", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to a file, too")
    parser.add_argument("--source", action="store_true", help="only print the figures of the source; fast")
    parser.add_argument("--root", type=Path, metavar="DIR", default=ROOT, help="checkout to count in")
    parser.add_argument("--calls", choices=calls.SCENARIOS, help="list the functions that are called")
    parser.add_argument("--ratchet", action="store_true", help="only print the figures that have grown")
    parser.add_argument("--record", action="store_true", help=f"write these figures to {RECORDED.name}")
    for name, (_, text) in LISTS.items():
        parser.add_argument(f"--{name}", action="store_true", help=text)
    arguments = parser.parse_args(argv)
    report = Report(Layout(arguments.root.resolve()))
    if arguments.record:
        RECORDED.write_text(json.dumps(report.structure(), indent=2) + "\n", encoding="utf-8")
        return 0
    if arguments.ratchet:
        lines = [*grown(report.structure(), json.loads(RECORDED.read_text(encoding="utf-8")))]
        print("\n".join(lines) or "no figure has grown")
        return 1 if lines else 0
    lists = [lines(report) for name, (lines, _) in LISTS.items() if getattr(arguments, name)]
    if arguments.calls:
        lists.append(report.calls(arguments.calls))
    for each in lists:
        print("\n".join(each))
    if lists:
        return 0
    figures = report.figures()
    if not arguments.source:
        figures |= report.running()
    print("\n".join(table(figures)))
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
