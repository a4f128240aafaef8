"""Every key of the project file has an example in the reference, which its declaration takes."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter

from scripts.reference import described, entries, example, examples, mappings

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
