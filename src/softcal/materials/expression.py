"""The texts of laws: arithmetic of named symbols, read by a list of what is allowed and never run as code.

SymPy works numbers out exactly, however long they become, and differentiates whatever it is given. So a text is
measured in floats before SymPy sees it, with all its symbols filled in, and symbolic work has a limit of time.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from softcal.bounded_work import TimeUp, time_limit
from softcal.declare import shown
from softcal.errors import Fault, InputError, unknown

_OPERATIONS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_SIGNS: dict[type[ast.unaryop], Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
FUNCTIONS: dict[str, Callable[..., float]] = {
    "log": math.log,
    "exp": math.exp,
    "sqrt": math.sqrt,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "Rational": operator.truediv,
}
ALLOWED = f"numbers, + - * / **, brackets and {', '.join(FUNCTIONS)}"
LONGEST = 4000  # characters
LARGEST, LARGEST_POWER = 1e100, 100
MOST_BITS = 10_000  # of the numbers in it, worked out exactly
MOST_PARTS, DEEPEST = 2000, 40  # with all symbols filled in
MOST_SECONDS = 10.0  # of symbolic work on one law; softcal's own take half a second


@dataclass(frozen=True)
class Measure:
    """The measure of an expression with all symbols filled in.

    Attributes
    ----------
    value
        At rest; None where it depends on constants.
    bits
        Those of its numbers worked out exactly, at most.
    parts, depth
        Numbers, names and operations, and how deep they are nested; a chain of sums is one level.
    names
        The constants, variables and functions in it.
    """

    value: float | None = None
    bits: float = 0.0
    parts: int = 1
    depth: int = 1
    names: frozenset[str] = frozenset()


def measured(text: object, where: str, scope: Mapping[str, Measure | None]) -> tuple[Measure, list[Fault]]:
    """The measure of a text and its faults, without SymPy, which is slow to import.

    Parameters
    ----------
    text
        The text.
    where
        Place for error messages.
    scope
        Symbol -> its measure, or None for an abbreviation that is not yet filled in.
    """
    such = "text such as 'mu/2*(I1 - 3)'"
    if not isinstance(text, str):
        return Measure(), [Fault("this is not an expression", where, shown(text), such)]
    if len(text) > LONGEST:
        return Measure(), [Fault("this expression is too long", where, f"{len(text)} characters", f"{LONGEST}")]
    faults: list[Fault] = []
    try:
        measure = _measured(ast.parse(text.strip(), mode="eval").body, scope, faults)
    except (SyntaxError, ValueError, MemoryError):
        return Measure(), [Fault("this is not an expression", where, shown(text), such)]
    except RecursionError:
        return Measure(), [Fault("this expression is too long, or nested too deeply", where, shown(text))]
    if not faults and measure.parts > MOST_PARTS:
        got = f"{measure.parts} numbers, names and operations"
        faults.append(Fault("this is too long with its symbols filled in", got=got, allowed=f"{MOST_PARTS}"))
    if not faults and measure.depth > DEEPEST:
        got, allowed = f"{measure.depth} levels, with its symbols filled in", f"{DEEPEST}"
        faults.append(Fault("this expression is nested too deeply", got=got, allowed=allowed))
    return measure, [replace(fault, where=where) for fault in faults]


def _measured(node: ast.expr, scope: Mapping[str, Measure | None], faults: list[Fault]) -> Measure:
    """The measure of a part; of one with a fault, which is added to the faults, that of a symbol like any other."""

    def wrong(what: str, allowed: str = ALLOWED) -> Measure:
        faults.append(Fault(what, got=shown(ast.unparse(node)), allowed=allowed))
        return Measure()

    if isinstance(node, ast.Name):
        name = node.id
        if name in FUNCTIONS:
            faults.append(Fault("this function has no argument", got=f"'{name}'"))
        elif name not in scope:
            faults.append(unknown("the law has no such symbol", "", name, [one for one in scope if scope[one]]))
        elif scope[name] is None:
            what = "this symbol leads back to itself, or is explained only further down"
            faults.append(Fault(what, got=f"'{name}'", allowed="constants, variables, and symbols that stand above it"))
        return scope.get(name) or Measure()
    called = ""
    match node:
        case ast.Constant(int() | float() as number) if not isinstance(number, bool):
            if not abs(number) <= LARGEST:
                return wrong("this number is too large", f"up to {LARGEST:g}")
            return Measure(float(number), abs(math.log2(abs(number))) if number else 0.0)
        case ast.UnaryOp(op, operand) if type(op) in _SIGNS:
            function, inner = _SIGNS[type(op)], [operand]
        case ast.BinOp(left, op, right) if type(op) in _OPERATIONS:
            function, inner = _OPERATIONS[type(op)], [left, right]
        case ast.Call(ast.Name(called), inner, []) if called in FUNCTIONS:
            function = FUNCTIONS[called]
            if len(inner) != 1 + (called == "Rational"):
                return wrong("this function takes another number of arguments")
        case ast.Call(ast.Name(name)) if name not in FUNCTIONS:
            return wrong("there is no such function")
        case _:
            return wrong("this is not allowed in an expression")

    before = len(faults)
    parts = [_measured(one, scope, faults) for one in inner]
    if len(faults) > before:
        return Measure()
    are_whole = all(one.value is not None and not one.names and one.value.is_integer() for one in parts)
    if called == "Rational" and not are_whole:
        return wrong("Rational is of two whole numbers", "such as Rational(2, 3)")
    names = frozenset([called] if called else []).union(*(one.names for one in parts))
    bits = sum(one.bits for one in parts) + (function in (operator.add, operator.sub))
    # e to a multiple of a logarithm is a power too.
    if function is operator.pow or (called == "exp" and "log" in names):
        exponent = parts[-1]
        power = 2.0 ** min(exponent.bits, 64.0) if exponent.names else abs(exponent.value or 0.0)
        if power > LARGEST_POWER:
            return wrong("this power is too large", f"up to {LARGEST_POWER}")
        bits = parts[0].bits * (power + 1.0)
    if bits > MOST_BITS:
        return wrong("the numbers of this become too long", f"{MOST_BITS} bits")
    value = _value(function, [one.value for one in parts])
    if called == "exp" and value == 0.0:
        value = math.inf  # less than any float: as long as the inverse, which is larger
    at = " at rest" if names - set(FUNCTIONS) else ""
    if value is not None and math.isnan(value):
        return wrong(f"this is not a real number{at}", "real numbers")
    if value is not None and abs(value) > LARGEST:
        return wrong(f"this number is too large{at}", f"up to {LARGEST:g}, and its inverse")
    first, *others = parts
    # SymPy joins sums of sums, and products of products.
    level = 0 if isinstance(node, ast.BinOp) and function is not operator.pow else 1
    depth = max(first.depth + level, *(one.depth + 1 for one in others), 1)
    return Measure(value, bits, 1 + sum(one.parts for one in parts), depth, names)


def _value(function: Callable[..., float], of: list[float | None]) -> float | None:
    """The value of a function: infinite where it overflows, NaN where it is not real, None if an argument is."""
    if None in of:
        return None
    try:
        value = function(*of)
    except OverflowError:
        return math.inf
    except (ZeroDivisionError, ValueError):
        return math.nan
    return value if isinstance(value, float) else math.nan


def to_sympy(text: str, scope: Mapping[str, Any]) -> Any:
    """The SymPy expression of a text that has no faults; scope: symbol -> what it stands for."""
    import sympy

    def read(node: ast.AST) -> Any:
        match node:
            case ast.Constant(value):
                return sympy.Integer(value) if isinstance(value, int) else sympy.Float(value)
            case ast.Name(name):
                return scope[name]
            case ast.UnaryOp(op, operand):
                return _SIGNS[type(op)](read(operand))
            case ast.BinOp(left, op, right):
                return _OPERATIONS[type(op)](read(left), read(right))
            case ast.Call(ast.Name(name), arguments):
                values = [read(one) for one in arguments]
                # In floats, as nothing exact is then made of logarithms of numbers.
                if name != "Rational" and values[0].is_number:
                    values = [sympy.Float(values[0])]
                return getattr(sympy, name)(*values)
            case _:
                raise TypeError(ast.dump(node))

    return read(ast.parse(text.strip(), mode="eval").body)


@contextmanager
def limited(where: str) -> Generator[None]:
    """Symbolic work that has an end.

    Raises
    ------
    InputError
        Where it takes longer than MOST_SECONDS or is nested too deeply; where: of what.
    """
    try:
        with time_limit(MOST_SECONDS):
            yield
    except TimeUp:
        what = "the derivatives of this law take too long to work out"
        allowed, attempt = f"{MOST_SECONDS:g} s", "a shorter energy"
        raise InputError(Fault(what, where, allowed=allowed, attempt=attempt)) from None
    except (RecursionError, MemoryError):
        raise InputError(Fault("this law is nested too deeply for its derivatives", where)) from None
