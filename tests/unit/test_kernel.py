"""Compiled functions, with and without a folder in which they can be kept."""

from __future__ import annotations

import pytest
from numba.core.caching import CacheImpl

from softcal.kernel import kernel


@pytest.mark.parametrize("has_folder", [True, False])
def test_a_function_is_compiled_also_where_it_cannot_be_kept(has_folder: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not has_folder:
        monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    @kernel(error_model="numpy")
    def third(x: float) -> float:
        return x / 3.0

    assert third(1.5) == 0.5
    assert third.signatures
