"""The example that a module of tests is about, its `EXAMPLE`: the script that made its data, its truth, its project."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import pytest
from example_script import example_script

from softcal.project.project import Project, load


@pytest.fixture(scope="module")
def generator(request: pytest.FixtureRequest) -> ModuleType:
    return example_script(request.module.EXAMPLE / "generate.py")


@pytest.fixture(scope="module")
def truth(generator: ModuleType) -> dict[str, Any]:
    return generator.read_truth()


@pytest.fixture(scope="module")
def project(request: pytest.FixtureRequest) -> Project:
    return load(request.module.EXAMPLE / "project.yaml")
