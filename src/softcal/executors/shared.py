"""Objects that many calls share: pickled once, named by their hash, and opened once in each worker."""

from __future__ import annotations

import copyreg
import hashlib
import io
import pickle
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from softcal.catalogue import Catalogue
from softcal.errors import CalibrationError

_KEPT = 4  # objects that a worker keeps opened
_open: OrderedDict[str, object] = OrderedDict()
one_at_a_time = threading.RLock()
"""Lock of every call: the solvers share their state among the threads of a process."""


@dataclass(frozen=True)
class Parcel:
    """A pickled object, and the hash of its bytes."""

    data: bytes
    digest: str

    def read(self) -> bytes:
        """The bytes."""
        return self.data


@dataclass(frozen=True)
class ParcelFile:
    """A parcel in a file that the workers of this machine read."""

    path: Path
    digest: str

    def read(self) -> bytes:
        """The bytes."""
        return self.path.read_bytes()


class UnableError(Exception):
    """A call that its machine could not do, such as for a full disk: another may."""


def packed(what: object) -> Parcel:
    """An object as bytes, with the laws, elements, actuators and sensors that are not softcal's own.

    Raises
    ------
    CalibrationError
        Where it cannot be pickled.
    """
    registered = {name: family.registered for name, family in _families().items()}
    # The members first, by themselves: the object may need them as it is unpickled.
    data = pickle.dumps((_pickled(registered), _pickled(what)))
    return Parcel(data, hashlib.sha256(data).hexdigest())


def call(shared: Parcel | ParcelFile, function: Callable[..., Any], *args: Any) -> Any:
    """function(object, *args) with the shared object, one call at a time in this process.

    Raises
    ------
    UnableError
        Where this machine cannot do it: no memory, a full disk.
    """
    with one_at_a_time:
        try:
            if shared.digest not in _open:
                registered, what = pickle.loads(shared.read())
                for name, members in pickle.loads(registered).items():
                    for member in members:
                        _families()[name].add(member)
                _open[shared.digest] = pickle.loads(what)
                while len(_open) > _KEPT:
                    _open.popitem(last=False)
            _open.move_to_end(shared.digest)
            return function(_open[shared.digest], *args)
        except (OSError, MemoryError) as error:
            raise UnableError(str(error) or type(error).__name__) from error


def _families() -> dict[str, Catalogue[Any]]:
    from softcal.materials.catalogue import LAWS
    from softcal.mechanics.elements import ELEMENTS
    from softcal.sensing.sensor import SENSORS
    from softcal.twin.actuated import ACTUATORS

    return {"law": LAWS, "element": ELEMENTS, "actuator": ACTUATORS, "sensor": SENSORS}


def _pickled(what: object) -> bytes:
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer)
    # Frozen mappings have no pickle of their own; a table of this pickler's leaves that of the process alone.
    pickler.dispatch_table = {**copyreg.dispatch_table, MappingProxyType: lambda one: (MappingProxyType, (dict(one),))}
    try:
        pickler.dump(what)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise CalibrationError(
            f"What is calibrated cannot be handed to other processes: {error}. Try: one worker, or the class in a "
            "module that Python can import."
        ) from error
    return buffer.getvalue()
