"""Sentences on the importance of parameters, and Sobol indices as text."""

from __future__ import annotations

import math

from softcal.analysis.importance import ImportanceStudy
from softcal.analysis.sobol import Index

NEGLIGIBLE = 0.01
"""Share of the variance below which a parameter is not worth a word."""
_SHOWN = 1e-3  # no index is written to more
_NAMED = 3  # parameters of a sentence


def index_text(index: Index) -> str:
    """An index with its error; an upper bound if it cannot be distinguished from zero."""
    if not index.is_known or index.most < _SHOWN:
        return f"< {_up(index.most, _places(index.most))}"
    places = _places(index.error)
    return f"{index.value:.{places}f} ± {_up(index.error, places)}"


def importance_sentences(study: ImportanceStudy) -> tuple[str, ...]:
    """Sentences on the parameters that decide each output, act only together, or have no effect worth a word."""
    found: list[str] = []
    for name, output in study.outputs.items():
        shares = {label: one for label, one in output.first.items() if one.is_known and one.value >= NEGLIGIBLE}
        largest = sorted(shares, key=lambda label: -shares[label].value)
        named = ", ".join(f"{label} {_percent(shares[label])}" for label in largest[:_NAMED])
        more = f" and {len(largest) - _NAMED} others" if len(largest) > _NAMED else ""
        found.append(f"Of the variance of the {name} over the bounds, these explain alone: {named}{more}." if named else
                     f"No parameter alone explains {100 * NEGLIGIBLE:g} % of the variance of the {name}.")  # fmt: skip
        pairs = [one for one in output.pairs if one.index.is_known and one.index.value >= NEGLIGIBLE]
        for one in sorted(pairs, key=lambda pair: -pair.index.value)[:_NAMED]:
            found.append(f"In the {name}, {' and '.join(one.labels)} act together: a further {_percent(one.index)}.")
        for label, total in output.total.items():
            if not output.first[label].is_known and total.value - total.error > NEGLIGIBLE:
                found.append(f"{label} acts on the {name} only together with others: {_percent(total)}.")
    inert = [
        label
        for label in study.ranges
        if study.outputs and all(output.total[label].most < NEGLIGIBLE for output in study.outputs.values())
    ]
    if inert:
        share = f"{100 * NEGLIGIBLE:g} %"
        found.append(f"Of no output does {' or '.join(inert)} explain {share} over these bounds, alone or with others.")
    return tuple(found)


def _percent(index: Index) -> str:
    places = max(0, _places(index.error) - 2)
    return f"{100 * index.value:.{places}f} ± {_up(100 * index.error, places)} %"


def _places(error: float) -> int:
    """Decimals that show one digit of an error."""
    return max(1, -math.floor(math.log10(max(error, _SHOWN))))


def _up(value: float, places: int) -> str:
    return f"{math.ceil(round(value * 10**places, 6)) / 10**places:.{places}f}"
