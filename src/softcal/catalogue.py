"""Extensible families, such as laws: their members by name, softcal's own and those registered from outside."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import Distribution, EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from softcal.errors import Fault, InputError, ParameterError, unknown

T = TypeVar("T")
M = TypeVar("M")


PLUGINS = Path(__file__).parent / "plugins"
_MEMBER = "catalogue_member"  # of a function that was registered, which is what an entry point names
_OTHER = "another name, or where this is a new version of it another process: restart the kernel of a notebook"


@dataclass(frozen=True)
class FunctionMember:
    """A member that is a function, with what its family must know of it.

    Attributes
    ----------
    name : str
        By which it is known.
    function : callable
        It stays as it is; its docstring describes the member.
    """

    name: str
    function: Callable[..., Any]

    @property
    def summary(self) -> str:
        """The first line of the function's docstring; its name where Python drops docstrings (`python -OO`)."""
        without = self.name.replace("_", " ") if sys.flags.optimize > 1 else ""
        return (inspect.getdoc(self.function) or without).partition("\n")[0]

    @property
    def module(self) -> str:
        """Module that defines the function; "" for a function that was typed or executed as text."""
        return self.function.__module__ or ""


def plugin_points(group: str) -> list[EntryPoint]:
    """The entry points of a group: those of softcal's plugins, and those of the installed packages.

    A plugin in softcal's own wheel is a folder with the file `entry_points.txt` that an installed package has in its
    metadata, in the same format, so that it is found without an installation too.
    """
    folders = sorted(file.parent for file in PLUGINS.glob("*/entry_points.txt"))
    own = [point for folder in folders for point in Distribution.at(folder).entry_points if point.group == group]
    return [*own, *entry_points(group=group)]


class Catalogue(Mapping[str, T], Generic[T]):
    """The members of a family by their attribute `name`: objects, or classes.

    softcal's own are given, or register themselves as the modules of a package are imported, which is when the
    catalogue is first asked. So are packages that bring members by entry points.

    Parameters
    ----------
    what
        What a member is called, such as "law".
    group
        The group of entry points by which packages bring members, such as "softcal.laws".
    faults
        What is wrong with a new member, given those that there are. It is asked of what comes by an entry point too,
        which may be anything.
    own
        softcal's own members.
    home
        The package whose modules register the other ones of softcal's own.
    """

    def __init__(
        self,
        what: str,
        group: str,
        faults: Callable[[T, Mapping[str, T]], Sequence[Fault]],
        *,
        own: Sequence[T] = (),
        home: str = "",
    ) -> None:
        self.what, self._group, self._home = what, group, home
        self._faults = faults
        self._members: dict[str, T] = {}
        self._own: set[str] = set()
        self._points: list[EntryPoint] = []  # whose members are not loaded yet
        self._asked = True
        for member in own:
            self.add(member)
            self._own.add(_name(member))
        self._asked = False

    def __getitem__(self, name: str) -> T:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    @property
    def registered(self) -> tuple[T, ...]:
        """The members that are not softcal's own, to be passed on to another process."""
        return tuple(member for name, member in self._all().items() if name not in self._own)

    def named(self, name: str, where: str = "") -> T:
        """The member of a name; where: the beginning of the message, or the kind of member.

        Raises
        ------
        ParameterError
            Where there is none.
        """
        if name not in self:
            raise ParameterError(self.unknown(name, where or self.what))
        return self[name]

    def unknown(self, name: str, where: str = "", among: Sequence[str] = ()) -> Fault:
        """The fault of a name without a member.

        Parameters
        ----------
        name
            The name.
        where
            Where it is stated.
        among
            The names that are allowed, where these are not all members.
        """
        return unknown(f"there is no such {self.what}", where, name, among or sorted(self))

    def add(self, member: T) -> None:
        """Add a member.

        Raises
        ------
        ParameterError
            Where another one has its name, or something is wrong with it.
        """
        # Many register while their module is imported: the modules of others may need that one themselves.
        module = getattr(member, "module", getattr(member, "__module__", ""))
        is_own = bool(self._home) and module.startswith(f"{self._home}.")
        known = self._members if is_own else self._begun() if _is_being_imported(module) else self._all()
        if faults := self._faults(member, known):
            raise ParameterError(faults)
        name = _name(member)
        if known.get(name, member) != member:
            what = f"there is another {self.what} of this name"
            raise ParameterError(Fault(what, self.what, name, attempt=_OTHER))
        self._members[name] = member
        if is_own:
            self._own.add(name)

    def registrar(
        self, name: str, summary: str, require: Callable[[T], object] = lambda member: None
    ) -> Callable[[M], M]:
        """The public function that adds a member and returns it, so that it decorates a class or encloses a call.

        Parameters
        ----------
        name
            Name of the function.
        summary
            First sentence of its docstring.
        require
            Raises an InputError for faults of a member that take too long to look for in every package's.

        Raises
        ------
        ParameterError
            By what is returned: as `add`, and with what `require` finds.
        """

        def register(member: M) -> M:
            one = cast("T", member)
            self.add(one)
            try:
                require(one)
            except InputError as error:
                self.remove(_name(one))
                raise ParameterError(error.faults) from error
            return member

        register.__name__ = register.__qualname__ = name
        register.__doc__ = f"""{summary}

        A package does the same for every process by an entry point of the group `{self._group}` that names it.

        Returns
        -------
        object
            The same {self.what}, so that this decorates its class or encloses its definition.

        Raises
        ------
        ParameterError
            Where another {self.what} has the name, or something is wrong with this one.
        """
        return register

    def decorator(self, make: Callable[[M], T]) -> Callable[[M], M]:
        """A decorator that adds the member made of a function, which stays as it is; an entry point names the function.

        What is decorated raises a ParameterError as `add` does.
        """

        def register(function: M) -> M:
            member = make(function)
            self.add(member)
            function.__dict__[_MEMBER] = member
            return function

        return register

    def remove(self, name: str) -> None:
        """Remove a member that was registered from outside.

        Raises
        ------
        ParameterError
            For one of softcal's own.
        """
        known = self._all()
        if name in self._own:
            raise ParameterError(Fault(f"softcal's own {self.what} cannot be removed", where=self.what, got=name))
        known.pop(name, None)

    def _begun(self) -> dict[str, T]:
        """softcal's own members and those registered so far; entry points of further members are listed, not loaded."""
        if not self._asked:
            self._asked = True
            if self._home:
                for module in pkgutil.iter_modules(importlib.import_module(self._home).__path__):
                    importlib.import_module(f"{self._home}.{module.name}")
            self._points = plugin_points(self._group)
        return self._members

    def _all(self) -> dict[str, T]:
        self._begun()
        # A module that is being imported has its member later.
        ready = [point for point in self._points if not _is_being_imported(point.module)]
        self._points = [point for point in self._points if point not in ready]
        for point in ready:
            member = point.load()
            self.add(getattr(member, _MEMBER, member))
        return self._members


def _is_being_imported(module: str) -> bool:
    return getattr(getattr(sys.modules.get(module), "__spec__", None), "_initializing", False)


def _name(member: Any) -> str:
    return member.name
