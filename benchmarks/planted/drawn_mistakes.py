"""Mistakes drawn by rule from the sources: a factor dropped, an index moved, arguments exchanged.

They need nobody who thinks of them, so a seed that was never used is a set that nobody has seen.
Some change nothing that anybody could see (a limit that is never met, a starting value); the share
noticed is a lower bound for that reason too.
"""
from __future__ import annotations

import ast
import copy
import itertools
import random
import warnings
from collections.abc import Iterator
from pathlib import Path

from benchmarks.planted.chosen_tests import ROOMS, ROOT
from benchmarks.planted.mistake import Mistake

DROPPED = {"sqrt", "square", "log", "exp", "abs", "hypot", "log1p", "expm1", "sorted", "deg2rad",
           "rad2deg", "reversed", "transpose", "nan_to_num", "diag", "cumsum", "normalize"}
EXCHANGED = {"mean": "median", "median": "mean", "max": "min", "min": "max", "argmax": "argmin",
             "argmin": "argmax", "any": "all", "all": "any", "sum": "mean", "maximum": "minimum",
             "minimum": "maximum", "cos": "sin", "sin": "cos", "floor": "ceil", "ceil": "floor",
             "nanmean": "nanmedian", "var": "std", "std": "var", "ones": "zeros",
             "hypot": "maximum", "vstack": "hstack", "startswith": "endswith", "logsumexp": "max",
             "extend": "append"}
TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.Lt, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
OTHER: dict[type[ast.operator], type[ast.operator]] = {
    ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Add: ast.Sub, ast.Sub: ast.Add,
    ast.MatMult: ast.Mult, ast.FloorDiv: ast.Div}
TOLD = {"help", "metavar", "show_default", "strict", "dtype", "keepdims", "encoding",
        "default_factory", "copy", "rich_help_panel"}     # keywords that calculate nothing
WORDS_LENGTH = 200      # of the part changed, in a mistake's words


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """What may become of one part of a program, with words for it."""
    if isinstance(node, ast.BinOp):
        if type(node.op) in OTHER:
            yield "another operation", _with(node, op=OTHER[type(node.op)]())
        if isinstance(node.op, ast.Mult | ast.Add | ast.Sub | ast.Div | ast.Pow):
            yield "a term dropped", node.left
        if isinstance(node.op, ast.Mult | ast.Add):
            yield "a term dropped", node.right
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = node.value
        if value in (0, 1):
            yield "another small number", ast.Constant(1 - value)
        else:
            yield "half the number", ast.Constant(value // 2 if isinstance(value, int)
                                                  else value / 2)
            yield "twice the number", ast.Constant(2 * value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield "turned", ast.Constant(not node.value)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield "comparison turned", _with(node, ops=[TURNED[type(node.ops[0])]()])
    elif isinstance(node, ast.BoolOp):
        yield "and for or", _with(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
        yield "a condition dropped", node.values[0]
        yield "a condition dropped", node.values[-1]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign dropped", node.operand
    elif isinstance(node, ast.Attribute) and node.attr == "T":
        yield "not transposed", node.value
    elif isinstance(node, ast.IfExp):
        yield "always the one", node.body
        yield "always the other", node.orelse
    elif isinstance(node, ast.Call):
        yield from _changes_of_call(node)


def _changes_of_call(node: ast.Call) -> Iterator[tuple[str, ast.AST]]:
    name = (node.func.attr if isinstance(node.func, ast.Attribute)
            else node.func.id if isinstance(node.func, ast.Name) else "")
    if name in DROPPED and node.args:
        yield f"{name} dropped", node.args[0]
    if name in EXCHANGED:
        func = (_with(node.func, attr=EXCHANGED[name]) if isinstance(node.func, ast.Attribute)
                else ast.Name(EXCHANGED[name]))
        if not (isinstance(node.func, ast.Name) and name not in ("any", "all", "max", "min")):
            yield f"{EXCHANGED[name]} for {name}", _with(node, func=func)
    plain = [place for place, each in enumerate(node.args)
             if isinstance(each, ast.Name | ast.Attribute)]
    for first, second in itertools.pairwise(plain):
        args = list(node.args)
        args[first], args[second] = args[second], args[first]
        yield "arguments exchanged", _with(node, args=args)
    for place, keyword in enumerate(node.keywords):
        if keyword.arg and keyword.arg not in TOLD:
            kept = node.keywords[:place] + node.keywords[place + 1:]
            yield f"{keyword.arg} not given", _with(node, keywords=kept)


def _with(node: ast.AST, **fields: object) -> ast.AST:
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _guards(tree: ast.AST) -> Iterator[tuple[str, ast.expr, ast.AST]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and isinstance(node.body[0], ast.Raise | ast.Return
                                                   | ast.Continue):
            yield "guard off", node.test, ast.Constant(False)


def _annotations(tree: ast.AST) -> set[int]:
    """Parts that are no part of a calculation."""
    roots: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            roots += [*node.decorator_list, *filter(None, [node.returns])]
        elif isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
            roots.append(node.annotation)
        elif isinstance(node, ast.Raise | ast.Import | ast.ImportFrom):
            roots.append(node)
    return {id(part) for root in roots for part in ast.walk(root)}


def _replaced(lines: list[str], old: ast.expr, new: ast.AST) -> tuple[str, str] | None:
    """The lines of a part of a program as they are and as they would be."""
    first, last = old.lineno - 1, (old.end_lineno or old.lineno) - 1
    head = lines[first].encode()[:old.col_offset].decode()
    tail = lines[last].encode()[old.end_col_offset:].decode()
    text = ast.unparse(ast.fix_missing_locations(copy.deepcopy(new)))
    if isinstance(new, ast.BinOp | ast.BoolOp | ast.Compare | ast.IfExp | ast.UnaryOp):
        text = f"({text})"
    return "\n".join(lines[first:last + 1]), head + text + tail


def mistakes_of(file: Path) -> list[Mistake]:
    """Every mistake that the rules make in one file; each old text stands there once."""
    text = file.read_text(encoding="utf-8")
    tree, lines = ast.parse(text), text.split("\n")
    aside = _annotations(tree)
    parts = [(what, node, new) for node in ast.walk(tree)
             if isinstance(node, ast.expr) and id(node) not in aside for what, new in changes(node)]
    found = {}
    for what, node, new in [*parts, *_guards(tree)]:
        old, changed = _replaced(lines, node, new)
        first = node.lineno - 1
        while text.count(old) > 1 and first > 0:    # as many lines before as make it unique
            first -= 1
            old, changed = f"{lines[first]}\n{old}", f"{lines[first]}\n{changed}"
        if old == changed or text.count(old) != 1 or not _compiles(text.replace(old, changed)):
            continue
        words = f"{what}: {' '.join(ast.unparse(node).split())[:WORDS_LENGTH]}"
        mistake = Mistake(str(file.relative_to(ROOT)), old, changed, words)
        found[mistake.name] = mistake
    return list(found.values())


def _compiles(text: str) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            compile(text, "", "exec")
        except (SyntaxError, SyntaxWarning):
            return False
    return True


def drawn_mistakes(number: int, seed: int, only: str = "") -> list[Mistake]:
    """Mistakes from all folders, each file as often as it is long, each kind alike within it."""
    files = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))
             if only in str(path.relative_to(ROOT))]
    if not files:
        raise ValueError(f"no source file whose name holds {only!r}")
    drawn = random.Random(seed)
    lengths = [path.stat().st_size for path in files]
    known: dict[Path, dict[str, list[Mistake]]] = {}
    found: dict[str, Mistake] = {}
    for _ in range(20 * number):        # short files run out
        file = drawn.choices(files, lengths)[0]
        if file not in known:
            kinds: dict[str, list[Mistake]] = {}
            for mistake in mistakes_of(file):
                kinds.setdefault(mistake.what.partition(":")[0], []).append(mistake)
            known[file] = kinds
        if known[file]:
            mistake = drawn.choice(drawn.choice(sorted(known[file].items()))[1])
            found[mistake.name] = mistake
        if len(found) == number:
            break
    return list(found.values())
