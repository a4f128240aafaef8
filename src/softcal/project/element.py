"""The element of a body, as a project file names it."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from softcal.mechanics.elements import ELEMENTS
from softcal.project.section import fault_error


def _known(name: str) -> str:
    if name not in ELEMENTS:
        fault = ELEMENTS.unknown(name)
        raise fault_error(fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
    return name


Element = Annotated[str, AfterValidator(_known)]
