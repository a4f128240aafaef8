"""The texts of laws: arithmetic of named symbols, read by a list of what is allowed and never run as code."""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping
from typing import Any

from softcal.declare import shown
from softcal.errors import Fault, unknown

# Function -> number of its arguments.
FUNCTIONS = {"log": 1, "exp": 1, "sqrt": 1, "sinh": 1, "cosh": 1, "tanh": 1, "Rational": 2}
ALLOWED = f"numbers, + - * / **, brackets and {', '.join(FUNCTIONS)}"
LONGEST = 4000  # characters
# SymPy works numbers out exactly: larger ones, and powers of powers, would take it forever.
LARGEST, LARGEST_POWER = 1e12, 100

_OPERATIONS = (ast.Add, ast.Sub, ast.Mult, ast.Div)
_SIGNS = (ast.UAdd, ast.USub)


def expression_faults(text: object, where: str, known: Collection[str]) -> list[Fault]:
    """What is wrong with a text in the symbols `known`, as far as it shows without SymPy, which is slow to import."""
    such = "text such as 'mu/2*(I1 - 3)'"
    if not isinstance(text, str):
        return [Fault("this is not an expression", where, shown(text), such)]
    if len(text) > LONGEST:
        return [Fault("this expression is too long", where, f"{len(text)} characters", f"{LONGEST}")]
    try:
        return _faults(ast.parse(text.strip(), mode="eval").body, where, known)
    except (SyntaxError, ValueError, MemoryError):
        return [Fault("this is not an expression", where, shown(text), such)]
    except RecursionError:
        return [Fault("this expression is nested too deeply", where, shown(text))]


def _faults(part: ast.AST, where: str, known: Collection[str]) -> list[Fault]:
    """Those of a part, or else of the parts in it."""
    if isinstance(part, ast.Name):
        what = "this function has no argument" if part.id in FUNCTIONS else "the law has no such symbol"
        fault = unknown(what, where, part.id, known)
        return [] if part.id in known else [fault]
    if wrong := _wrong(part):
        return [Fault(wrong, where, shown(ast.unparse(part)), ALLOWED)]
    inner = part.args if isinstance(part, ast.Call) else ast.iter_child_nodes(part)
    return [fault for one in inner if isinstance(one, ast.expr) for fault in _faults(one, where, known)]


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
                return -read(operand) if isinstance(op, ast.USub) else read(operand)
            case ast.BinOp(left, op, right):
                return _combined(op, read(left), read(right))
            case ast.Call(ast.Name(name), arguments):
                return getattr(sympy, name)(*(read(one) for one in arguments))
            case _:
                raise TypeError(ast.dump(node))

    return read(ast.parse(text.strip(), mode="eval").body)


def _combined(op: ast.operator, left: Any, right: Any) -> Any:
    match op:
        case ast.Add():
            return left + right
        case ast.Sub():
            return left - right
        case ast.Mult():
            return left * right
        case ast.Div():
            return left / right
        case _:
            return left**right


def _wrong(part: ast.AST) -> str:
    """What is wrong with one part of a parsed text by itself; "" where nothing is."""
    match part:
        case ast.Constant(value) if isinstance(value, int | float) and not isinstance(value, bool):
            return "" if abs(value) <= LARGEST else "this number is too large"
        case ast.UnaryOp(op) if isinstance(op, _SIGNS):
            return ""
        case ast.BinOp(_, ast.Pow(), exponent):
            return _wrong_power(exponent)
        case ast.BinOp(_, op) if isinstance(op, _OPERATIONS):
            return ""
        case ast.Call(ast.Name(name), arguments, []) if name in FUNCTIONS:
            return "" if len(arguments) == FUNCTIONS[name] else "this function takes another number of arguments"
        case ast.Call(ast.Name(name)) if name not in FUNCTIONS:
            return "there is no such function"
        case _:
            return "this is not allowed in an expression"


def _wrong_power(exponent: ast.AST) -> str:
    parts = list(ast.walk(exponent))
    if any(isinstance(part, ast.Pow) for part in parts):
        return "a power of a power is not allowed in an expression"
    numbers = (part.value for part in parts if isinstance(part, ast.Constant))
    large = any(isinstance(number, int | float) and abs(number) > LARGEST_POWER for number in numbers)
    return "this power is too large" if large else ""
