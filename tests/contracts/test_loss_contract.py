"""What every loss promises, whichever it is; a new one is registered, and so joins the list and inherits the tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from loss_checks import CHECKS, loss_of

from softcal.calibration.problem.loss import LOSSES, Loss, SumOfSquares
from softcal.calibration.problem.losses.papers import RelativeSquares


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", LOSSES)
def test_every_loss_keeps_the_promise(name: str, check: Callable[[Loss], None]) -> None:
    check(loss_of(LOSSES[name]))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_so_does_what_a_search_goes_by(check: Callable[[Loss], None]) -> None:
    check(RelativeSquares())


def test_every_loss_but_the_surrogates_is_registered() -> None:
    """Those of robots: the loss of coupon tests serves these alone."""
    found = [*Loss.__subclasses__(), *SumOfSquares.__subclasses__()]
    mine = [one for one in found if one.__module__.startswith("softcal.") and one is not SumOfSquares]
    own = [one for one in mine if not one.__module__.startswith("softcal.plugins.coupons.")]
    assert len(own) == 4
    assert {one.name for one in own} == {name for name in LOSSES if LOSSES[name] in own} | {"relative squares"}
