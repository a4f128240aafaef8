"""What `pip install softcal` leaves out: packages that only some of its work needs, each an extra of softcal's."""

from __future__ import annotations

import importlib.util

from softcal.errors import Fault, InputError


def require_extra(extra: str, *modules: str, where: str, got: str = "") -> None:
    """Raise unless the modules that an extra brings can be imported.

    Raises
    ------
    InputError
        With the command that installs it.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            what = f"this needs {module}, which is not installed"
            raise InputError(Fault(what, where, got, attempt=f"pip install 'softcal[{extra}]'"))
