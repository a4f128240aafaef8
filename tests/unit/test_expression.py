"""The texts of laws are read by a list of what is allowed, and never run as code."""

from __future__ import annotations

import math
import time

import pytest

from softcal.errors import Fault, InputError
from softcal.materials import expression
from softcal.materials.expression import Measure, limited, measured, to_sympy

KNOWN = ("mu", "I1", "J")
SCOPE = {
    "mu": Measure(names=frozenset({"mu"})),
    "I1": Measure(3.0, names=frozenset({"I1"})),
    "J": Measure(1.0, names=frozenset({"J"})),
    "pi": Measure(3.14159),
    "below": None,
}


def faults_of(text: object) -> list[Fault]:
    return measured(text, "law", SCOPE)[1]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("mu/2*(I1 - 3)", 1.0),
        ("J**(-2/3)*I1", 1.25),
        ("-log(J) + sqrt(mu)**2", 2.0 - 2.0794415416798357),
        ("+2e-1", 0.2),
        ("exp(mu*(J**(-2/3)*I1 - 3 - 2*log(J)))", math.exp(-4) / 8**4),
        ("exp(mu*(I1 - 3)**2)*(mu*I1)**30", math.exp(2) * 8**30),
    ],
)
def test_arithmetic_is_read(text: str, value: float) -> None:
    import sympy

    assert faults_of(text) == []
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
        ("9**9**9", "power is too large"),
        ("0*2**(99*99*99*99*99*99)", "power is too large"),
        ("3**(99*99*99*99*(99+99))", "power is too large"),
        ("2**(mu*99*99)", "power is too large"),
        ("3**((J - 1)*10**9)", "power is too large"),
        ("((((10**99)**99)**99)**99)", "become too long"),
        ("((1.0000001*mu)**99)**99*(mu*10000001/10000000)**99**1*((10000001/10000000*J)**99)**99", "become too long"),
        ("exp(mu - 10**9*log(J + 2))", "power is too large"),
        ("exp(-10**9*log(3))", "power is too large"),
        ("exp(-1000)", "number is too large"),
        ("exp(exp(exp(exp(J))))", "number is too large at rest"),
        ("10**60*10**60", "number is too large"),
        ("sqrt(-1)", "not a real number; got 'sqrt(-1)'"),
        ("log(1 - J)", "not a real number at rest"),
        ("1/(I1 - 3)", "not a real number at rest"),
        ("(-8)**(1/3)", "not a real number"),
        ("Rational(mu, 2)", "Rational is of two whole numbers"),
        ("Rational(1, 0)", "not a real number"),
        ("below + 1", "leads back to itself, or is explained only further down; got 'below'"),
        ("1e400", "number is too large"),
        ("2j", "not allowed in an expression"),
        ("I1 // 2", "not allowed in an expression"),
        ("I1 < J < 2", "not allowed in an expression"),
        ("[I1 for mu in J]", "not allowed in an expression"),
        ("await mu", "not allowed in an expression"),
        ("*mu", "not an expression"),
        ("log(*mu)", "not allowed in an expression"),
        ("mu\nJ", "not an expression"),
        ("mu\x00", "not an expression"),
        ("oo", "no such symbol; got 'oo'"),
        ("zoo", "no such symbol"),
        ("Piecewise((1, J > 0))", "no such function"),
        ("log(" * 45 + "mu" + ")" * 45, "nested too deeply"),
        ("log(" * 790 + "mu" + ")" * 790, "not an expression"),
        ("1+" * 1100 + "mu", "is too long"),
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
    (fault,) = faults_of(text)
    assert told in str(fault)
    assert str(fault).startswith("law: ")


def test_symbols_are_measured_filled_in() -> None:
    scope = dict(SCOPE)
    for k in range(25):
        before = "mu" if k == 0 else f"a{k - 1}"
        scope[f"a{k}"], faults = measured(f"exp({before})*{before}", "law", scope)
        assert not faults or "filled in" in str(faults[0])
    _, (fault,) = measured("a24*J", "law, energy", scope)
    assert "law, energy: this is too long with its symbols filled in" in str(fault)
    scope["n"], _ = measured("999999999999", "law", scope)
    _, (fault,) = measured("7**n", "law", scope)
    assert "power is too large; got '7 ** n'" in str(fault)


def test_functions_of_numbers_are_not_worked_out_exactly() -> None:
    assert str(to_sympy("exp(2)", {})) == "7.38905609893065"
    assert str(to_sympy("2/3", {})) == "2/3"


def test_symbolic_work_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    import sympy

    monkeypatch.setattr(expression, "MOST_SECONDS", 0.3)
    start = time.process_time()
    letters = sympy.symbols("a:8")
    with pytest.raises(InputError, match="law w: the derivatives of this law take too long"), limited("law w"):
        sympy.expand(sum(letters) ** 40)
    assert time.process_time() - start < 5.0
    with limited("law w"):
        assert sympy.expand(sum(letters[:2]) ** 2)


def test_nothing_of_the_limit_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expression, "MOST_SECONDS", 0.0)
    with pytest.raises(InputError), limited("law"):
        run_for(60.0)
    run_for(0.5)


def run_for(seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass
