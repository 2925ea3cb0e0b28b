"""Places where a module can be changed by one small fault, and the faults."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_COMPARED: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_COMPUTED: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.FloorDiv,
    ast.FloorDiv: ast.Mult,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}


@dataclass(frozen=True)
class Mutant:
    """One change of one module.

    Attributes:
        module: file of the module, relative to the root of the source.
        line: line of the changed statement, where a tracer reports it.
        number: position among the changes of the module, in the order of its text.
        fault: the expression or statement before and after.
    """

    module: str
    line: int
    number: int
    fault: str

    @property
    def name(self) -> str:
        """Label in reports."""
        return f"{self.module}:{self.line} [{self.number}] {self.fault}"


def mutants(root: Path, module: str) -> list[Mutant]:
    """Return all changes of a module."""
    tree = ast.parse((root / module).read_text(encoding="utf-8"))
    return [
        Mutant(module, line, number, f"{_short(node)} -> {_short(changed)}")
        for number, (line, node, changed, _) in enumerate(_changes(tree))
    ]


def mutated(root: Path, mutant: Mutant) -> ast.Module:
    """Return the tree of a module with one change."""
    tree = ast.parse((root / mutant.module).read_text(encoding="utf-8"))
    for number, (_, _, changed, put) in enumerate(_changes(tree)):
        if number == mutant.number:
            put(changed)
            return ast.fix_missing_locations(tree)
    raise LookupError(mutant.name)


def _short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


_Change = tuple[int, ast.AST, ast.AST, Callable[[ast.AST], None]]


def _changes(tree: ast.Module) -> Iterator[_Change]:
    """Yield the line, a node, what replaces it, and a function that puts that in its place."""
    yield from _of_children(tree, 0)


def _of_children(node: ast.AST, line: int) -> Iterator[_Change]:
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "type_params", "type_comment"):
            continue
        for index, child in enumerate(value if isinstance(value, list) else [value]):
            if not isinstance(child, ast.AST) or _is_documentation(child) or _is_for_types(child):
                continue
            at = child.lineno if isinstance(child, ast.stmt) else line

            def put(
                new: ast.AST, at: int = index if isinstance(value, list) else -1, name: str = field
            ) -> None:
                if at < 0:
                    setattr(node, name, new)
                else:
                    getattr(node, name)[at] = new

            for changed in _replacements(child):
                yield at, child, ast.copy_location(changed, child), put
            yield from _of_children(child, at)


def _is_documentation(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_for_types(node: ast.AST) -> bool:
    """True if a type checker alone reads the node."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        return True
    if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
        return True
    called = node.func if isinstance(node, ast.Call) else None
    return isinstance(called, ast.Name) and called.id in ("cast", "TypeVar", "overload")


def _replacements(node: ast.AST) -> Iterator[ast.AST]:
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=compared) if type(operator) in _COMPARED:
            yield ast.Compare(left, [_COMPARED[type(operator)]()], compared)
        case ast.BoolOp(op=ast.And(), values=values):
            yield ast.BoolOp(ast.Or(), values)
        case ast.BoolOp(op=ast.Or(), values=values):
            yield ast.BoolOp(ast.And(), values)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield operand
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _COMPUTED:
            yield ast.BinOp(left, _COMPUTED[type(operator)](), right)
        case ast.AugAssign(target=target, op=operator, value=value) if type(operator) in _COMPUTED:
            yield ast.AugAssign(target, _COMPUTED[type(operator)](), value)
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=str(value)) if value:
            yield ast.Constant(f"X{value}")
        case ast.Constant(value=bytes(value)) if value:
            yield ast.Constant(b"X" + value)
        case ast.Return(value=ast.AST() as value) if not (
            isinstance(value, ast.Constant) and value.value is None
        ):
            yield ast.Return(ast.Constant(None))
        case ast.Expr(value=ast.Call() | ast.Await()) | ast.Raise():
            yield ast.Pass()
        case ast.Break():
            yield ast.Continue()
        case ast.Continue():
            yield ast.Break()
        case ast.If(test=test, body=body, orelse=orelse) if not isinstance(
            test, ast.Compare | ast.BoolOp | ast.UnaryOp
        ):
            yield ast.If(ast.UnaryOp(ast.Not(), test), body, orelse)
