"""Every key of the project file has an example in the reference, which its declaration takes, and a meaning."""

from __future__ import annotations

import re
from typing import Any

import pytest
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from scripts.reference import (
    MEANINGS,
    attributes,
    described,
    entries,
    example,
    examples,
    keys,
    kind_text,
    mappings,
    meanings,
)

KEYS = [(kind, name, annotation) for kind in described() for name, annotation, _ in entries(kind)]
# Of `sensors` only those of a user have a class to read them: test_own_sensor.py.
LEAVES = [one for one in KEYS if not mappings(one[2]) and one[1] != "sensors"]


@pytest.mark.parametrize(("kind", "name", "annotation"), LEAVES, ids=lambda one: getattr(one, "__name__", None))
def test_an_example_is_what_the_key_takes(kind: type, name: str, annotation: Any):
    value = examples()[kind, name]
    TypeAdapter(annotation).validate_python(value)
    assert example(kind, name).startswith(f"{name}: ")


def test_no_example_is_of_a_key_that_does_not_exist():
    assert examples().keys() <= {(kind, name) for kind, name, _ in KEYS}


@pytest.mark.parametrize(("kind", "name", "annotation"), KEYS, ids=lambda one: getattr(one, "__name__", None))
def test_a_key_has_a_meaning_that_repeats_neither_its_name_nor_its_kind(kind: type, name: str, annotation: Any):
    meaning = meanings()[kind, name].replace("`", "").casefold()
    repeated = (name, name.replace("_", " "), kind_text(annotation))
    assert meaning not in ("", *(one.replace("`", "").casefold() for one in repeated))


def test_every_listed_meaning_is_of_a_key_that_no_docstring_describes():
    classes = {kind.__name__: kind for kind in described()}
    for name, values in YAML(typ="safe").load(MEANINGS).items():
        of_class = {key for key, *_ in entries(classes[name])}
        assert values.keys() <= of_class - attributes(classes[name]).keys(), name


def test_the_headings_of_the_reference_are_short_and_every_link_leads_to_one():
    headings = [one.replace("`", "").replace(".", "").casefold() for one in re.findall(r"(?m)^#+ (.*)$", keys())]
    assert len(headings) == len({*headings})
    assert max(map(len, headings)) <= 26
    assert {*re.findall(r"\]\(#([^)]*)\)", keys())} <= {*headings}
