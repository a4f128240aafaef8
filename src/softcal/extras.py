"""Packages that `pip install softcal` leaves out since only some work needs them, each an extra of softcal's."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

from softcal.errors import Fault, InputError


def missing(extra: str, *modules: str) -> Fault | None:
    """The first of an extra's modules that is not installed, with the command that installs it; None where all are."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            what = f"this needs {module}, which is not installed"
            return Fault(what, attempt=f"pip install 'softcal[{extra}]'")
    return None


def require_extra(extra: str, *modules: str, where: str, got: str = "") -> None:
    """Raise unless the modules that an extra brings can be imported.

    Parameters
    ----------
    extra
        Name of the extra.
    modules
        Modules that it brings.
    where, got
        Of the fault.

    Raises
    ------
    InputError
        With the command that installs it.
    """
    if (fault := missing(extra, *modules)) is not None:
        raise InputError(replace(fault, where=where, got=got))
