"""The texts of laws are read by a list of what is allowed, and never run as code."""

from __future__ import annotations

import pytest

from softcal.materials.expression import expression_faults, to_sympy

KNOWN = ("mu", "I1", "J")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("mu/2*(I1 - 3)", 1.0),
        ("J**(-2/3)*I1", 1.25),
        ("-log(J) + sqrt(mu)**2", 2.0 - 2.0794415416798357),
        ("+2e-1", 0.2),
    ],
)
def test_arithmetic_is_read(text: str, value: float) -> None:
    import sympy

    assert expression_faults(text, "law", KNOWN) == []
    scope = {name: sympy.Symbol(name, positive=True) for name in KNOWN}
    at = {scope["mu"]: 2.0, scope["I1"]: 4.0, scope["J"]: 8.0}
    if text.startswith("J"):
        at[scope["I1"]] = 5.0
    assert float(to_sympy(text, scope).subs(at)) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("__import__('os').system('true')", "not allowed in an expression"),
        ("(lambda: 1)()", "not allowed in an expression"),
        ("mu.real", "not allowed in an expression"),
        ("mu[0]", "not allowed in an expression"),
        ("I1 if mu else 2", "not allowed in an expression"),
        ("True", "not allowed in an expression"),
        ("'a'", "not allowed in an expression"),
        ("f'{mu}'", "not allowed in an expression"),
        ("mu == 2", "not allowed in an expression"),
        ("~3", "not allowed in an expression"),
        ("print(mu)", "no such function; got 'print(mu)'"),
        ("log(x=1)", "not allowed in an expression"),
        ("log(1, 2)", "another number of arguments"),
        ("log", "this function has no argument"),
        ("kapa + mu", "no such symbol; got 'kapa'"),
        ("9**9**9", "power of a power"),
        ("J**1000", "power is too large"),
        ("1e300", "number is too large"),
        ("mu := 3", "not an expression"),
        ("mu*(I1 - 3", "not an expression"),
        ("-" * 3900 + "1", "nested too deeply"),
        ("2" * 5000, "too long; got 5000 characters"),
        (3, "not an expression; got 3"),
    ],
)
def test_everything_else_is_refused_in_one_sentence(text: object, told: str) -> None:
    (fault,) = expression_faults(text, "law", KNOWN)
    assert told in str(fault)
