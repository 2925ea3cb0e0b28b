"""Print the counted figures of the project, or one of the lists behind them.

Example: python -m tools.size --calls publish
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Final

from tools.generate_rooms import MOST_MODULES
from tools.size import calls, loaded
from tools.size.layout import Layout, source_files
from tools.size.source import count_lines, rejected_docstrings, total
from tools.size.structure import (
    SMALL_LINES,
    Module,
    Protocols,
    full_folders,
    shared_names,
    small_modules,
)

Figures = dict[str, float]
"""Figures by their names in the table."""


class Report:
    """Figures and lists of the packages.

    Args:
        layout: where the packages are.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout

    @cached_property
    def modules(self) -> list[Module]:
        """Modules of all packages but rclpy."""
        return [Module.read(*each) for each in source_files(self._layout.packages)]

    @cached_property
    def rclpy(self) -> list[Module]:
        """Modules of rclpy."""
        return [Module.read(*each) for each in source_files(self._layout.rclpy)]

    def figures(self) -> Figures:
        """Return all figures of the source."""
        source = total(count_lines(each.text) for each in self.modules)
        rclpy = total(count_lines(each.text) for each in self.rclpy)
        uses = Protocols(self.modules + self.rclpy).uses(self._layout.packages)
        few = [each for each in uses if each.implementations <= 1]
        return {
            "lines without rclpy": source.lines,
            "lines of code without rclpy": source.code,
            "lines of rclpy": rclpy.lines,
            "lines of code of rclpy": rclpy.code,
            "comment lines, percent of lines": round(100 * source.comments / source.lines, 1),
            "modules": len(self.modules),
            "top-level packages in the wheel": len(self._layout.wheel),
            "class names in several modules": len(shared_names(self.modules)),
            f"modules under {SMALL_LINES} lines with one importer": len(
                small_modules(self.modules, self.modules + self.rclpy)
            ),
            "protocols": len(uses),
            "protocols with at most one implementation": len(few),
            "of these, without methods but properties": sum(each.data_only for each in few),
            "docstrings that begin with a rejected word": sum(1 for _ in self.docstrings()),
            f"folders with more than {MOST_MODULES} modules": len(full_folders(self.modules + self.rclpy)),
        }

    def running(self) -> Figures:
        """Return the figures of servers that run: lines that are loaded, and calls per message."""
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
        found = small_modules(self.modules, self.modules + self.rclpy)
        for module, importer in sorted(found, key=lambda each: (each[1], each[0].name)):
            yield f"{module.text.count(chr(10)):3}  {module.name}  imported by {importer}"

    def protocols(self) -> Iterator[str]:
        """Yield the protocols with the numbers of classes that name them, and that define their methods."""
        yield "named  structural  protocol"
        for use in Protocols(self.modules + self.rclpy).uses(self._layout.packages):
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
        for folder, count in full_folders(self.modules + self.rclpy).items():
            yield f"{count:3}  {self._relative(folder)}"

    def _relative(self, path: Path) -> Path:
        return path.relative_to(self._layout.root)


LISTS: Final[Mapping[str, tuple[Callable[[Report], Iterator[str]], str]]] = {
    "classes": (Report.classes, "list the class names that several modules define"),
    "small": (Report.small, "list the small modules with one importer"),
    "protocols": (Report.protocols, "list the protocols with their implementations"),
    "docstrings": (Report.docstrings, "list the docstrings with a rejected first word"),
    "folders": (Report.folders, "list the folders with too many modules"),
}


def table(figures: Figures) -> Iterator[str]:
    """Yield one aligned line for each figure."""
    width = max(map(len, figures))
    for name, value in figures.items():
        yield f"{name:{width}}  {value:>9,}"


def main() -> None:
    """Print what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m tools.size", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to a file, too")
    parser.add_argument("--source", action="store_true", help="only print the figures of the source; fast")
    parser.add_argument("--calls", choices=calls.SCENARIOS, help="list the functions that are called")
    for name, (_, text) in LISTS.items():
        parser.add_argument(f"--{name}", action="store_true", help=text)
    arguments = parser.parse_args()
    report = Report(Layout())
    lists = [lines(report) for name, (lines, _) in LISTS.items() if getattr(arguments, name)]
    if arguments.calls:
        lists.append(report.calls(arguments.calls))
    for lines in lists:
        print("\n".join(lines))
    if lists:
        return
    figures = report.figures()
    if not arguments.source:
        figures |= report.running()
    print("\n".join(table(figures)))
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
