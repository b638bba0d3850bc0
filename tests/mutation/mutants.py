"""Small mistakes in a module, one at a time: each mutant is the module's source with a single thing changed."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
}
_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
}
_CALLS = {"min": "max", "max": "min", "abs": "float"}


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        line: where, from 1.
        was, now: the expression or statement before and after.
        tree: the whole module, changed.
    """

    line: int
    was: str
    now: str
    tree: ast.Module

    def __str__(self) -> str:
        return f"{self.was}  ->  {self.now}"


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of a module, in the order of its lines."""
    tree = ast.parse(source)
    passive = _annotations(tree)
    places = [(node, k) for k, node in enumerate(ast.walk(tree)) if hasattr(node, "lineno") and node not in passive]
    for place, k in sorted(places, key=lambda found: (found[0].lineno, found[0].col_offset)):
        for change in _changes(place):
            yield _mutant(ast.parse(source), k, change)


def _mutant(tree: ast.Module, k: int, change: ast.AST) -> Mutant:
    """`tree` with `change` in the place of its node number `k`."""
    place: Any = next(node for number, node in enumerate(ast.walk(tree)) if number == k)
    was, line = _text(place), place.lineno
    return Mutant(line, was, _text(change), ast.fix_missing_locations(_Replace(place, change).visit(tree)))


class _Replace(ast.NodeTransformer):
    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> Any:
        return self._new if node is self._old else self.generic_visit(node)


def _text(node: ast.AST) -> str:
    """The first line of it."""
    return ast.unparse(node).splitlines()[0]


def _annotations(tree: ast.Module) -> set[ast.AST]:
    """Nodes of annotations: they do nothing."""
    parts = [getattr(holder, name, None) for holder in ast.walk(tree) for name in ("annotation", "returns")]
    return {node for part in parts if part is not None for node in ast.walk(part)}


def _changes(node: Any) -> Iterator[ast.AST]:
    """What can be wrong in one place."""
    if isinstance(node, ast.Compare):
        yield from _other_comparisons(node)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        yield ast.BinOp(node.left, _OPERATORS[type(node.op)](), node.right)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield ast.Constant(node.value + 1 if isinstance(node.value, int) else 1.25 * node.value + (node.value == 0.0))
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _CALLS:
        yield ast.Call(ast.Name(_CALLS[node.func.id]), node.args, node.keywords)
    elif isinstance(node, ast.If):
        yield from _other_checks(node)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Assign | ast.AugAssign) and node.col_offset > 0:
        yield ast.Pass()
    elif isinstance(node, ast.Attribute) and node.attr.startswith("CATEGORY_"):
        yield ast.Attribute(node.value, f"CATEGORY_{(int(node.attr[-1]) + 1) % 3}")


def _other_comparisons(node: ast.Compare) -> Iterator[ast.AST]:
    for k, op in enumerate(node.ops):
        for other in _COMPARISONS.get(type(op), ()):
            yield ast.Compare(node.left, [*node.ops[:k], other(), *node.ops[k + 1 :]], node.comparators)


def _other_checks(node: ast.If) -> Iterator[ast.AST]:
    """The check is left out: never, and always."""
    yield ast.If(ast.Constant(False), node.body, node.orelse)
    yield ast.If(ast.Constant(True), node.body, node.orelse)
