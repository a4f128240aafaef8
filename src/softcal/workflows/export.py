"""An export: a function that writes a project, or a calibrated run, for another program, and the function's options.

The command line lists all exports, so this module and theirs import what is slow inside functions.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from softcal.catalogue import Catalogue, FunctionMember
from softcal.declare import Checked, as_annotated, checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown

if TYPE_CHECKING:
    from softcal.project.project import Project
    from softcal.twin.response import Response, Shown
    from softcal.workflows.cases import Case
    from softcal.workflows.motion import Observer

Reporter = Callable[[str], None]
KINDS = (int, str, bool)


def _silent(_: str) -> None:
    """The reporter of nothing."""


@displayed
@dataclass(frozen=True)
class ExportOption(Checked):
    """An option of an export on the command line.

    Attributes
    ----------
    kind : type
        int, str, or bool for a flag.
    help : str
        What it does, in a sentence.
    metavar : str
        The name of its value in `--help`.
    """

    kind: type
    help: str
    metavar: str = ""


@displayed
@dataclass(frozen=True)
class ExportRequest:
    """The project to export, pulls, and callables for warnings and progress.

    Attributes
    ----------
    project : Project, str or Path
        The project, or the path of its file, with the parameters at the values that are written.
    pulls : sequence of str
        Pulls in the place of the experiments, such as "front=40mm".
    warn, note : callable
        Called with warnings, and with other remarks for the user.
    stage : callable
        Called with the name of each stage.
    motion : callable or None
        Called with the progress of each motion.
    run : Path, str or None
        The run folder with the calibrated values of the parameters, or None.
    """

    project: Project
    pulls: Sequence[str] = ()
    warn: Reporter = _silent
    note: Reporter = _silent
    stage: Reporter = _silent
    motion: Observer | None = None
    run: str | Path | None = None

    def __post_init__(self) -> None:
        from softcal.project.project import project_of

        object.__setattr__(self, "project", project_of(self.project))
        as_annotated(self.run, str | Path | None, "run")

    def cases(self) -> dict[str, Case]:
        """Name -> robot and protocol of a case: one with all pulls, else one per experiment.

        Raises
        ------
        InputError
            For an impossible pull; if there is neither an experiment nor a pull.
        """
        from softcal.workflows.cases import cases

        return cases(self.project, self.pulls)

    def solved(self, cases: Mapping[str, Case], snapshots: Shown = True) -> dict[str, Response]:
        """The response of each case, with its shapes; warnings go to `warn`.

        Raises
        ------
        SimulationError
            If a protocol has no solution.
        """
        from softcal.twin.simulate import simulate
        from softcal.workflows.simulation import simulate_each

        def respond(case: Case) -> Response:
            return simulate(case.robot, case.protocol, snapshots=snapshots)

        return self.told(simulate_each(cases, respond, stage=self.stage))

    def told(self, responses: dict[str, Response]) -> dict[str, Response]:
        """The responses; their warnings go to `warn`."""
        for name, response in responses.items():
            for sentence in response.warnings:
                self.warn(f"{name}: {sentence}")
        return responses


@dataclass(frozen=True)
class Export(FunctionMember):
    """A way to write a project for another program.

    Attributes
    ----------
    name : str
        That of the function: `softcal export NAME`.
    function : callable
        From a request, an empty folder and the options to the files written.
    files : tuple of str
        Patterns of the files' names.
    options : mapping of str to ExportOption
        By the function's parameters; one without a default must be given.
    pulled : bool
        Whether pulls can take the place of the experiments.
    hint : str
        What to do with the files, where "{out}" is the folder, or "".
    """

    files: tuple[str, ...]
    options: Mapping[str, ExportOption] = field(default_factory=dict[str, ExportOption])
    pulled: bool = True
    hint: str = ""

    @property
    def defaults(self) -> Mapping[str, Any]:
        """Option -> default, `inspect.Parameter.empty` for an option without a default."""
        parameters = inspect.signature(self.function).parameters
        return {name: parameters[name].default for name in self.options}


def _faults(export: Export, _: Mapping[str, Export]) -> list[Fault]:
    """Faults of an export that is to be registered."""
    if not isinstance(export, Export):  # pyright: ignore[reportUnnecessaryIsInstance] (an entry point may be anything)
        allowed = "what softcal.register_export returns for a function"
        return [Fault("this is no export", "export", repr(export)[:60], allowed)]
    where = f"export {export.name}"
    declared = inspect.signature(export.function).parameters
    parameters = list(declared)[2:]  # after the request and the folder
    faults = [
        Fault("the function needs a value that no option gives", f"{where}, {name}", attempt=f"{name}=ExportOption(…)")
        for name in parameters
        if declared[name].default is inspect.Parameter.empty and name not in export.options
    ]
    if len(declared) < 2:
        got = ", ".join(declared) or "none"
        faults.append(
            Fault("the function has too few parameters", where, got, "the request, the folder and the options")
        )
    faults += [
        Fault("the function has no such parameter", f"{where}, {name}", allowed=", ".join(parameters))
        for name in export.options
        if name not in parameters
    ]
    faults += [
        Fault("there is no such kind of option", f"{where}, {name}", got, "an ExportOption of int, str or bool")
        for name, option in export.options.items()
        if (kind := getattr(option, "kind", None)) not in KINDS
        for got in [repr(option if kind is None else kind)]
    ]
    if not export.summary:
        faults.append(Fault("the export has no description", where, attempt="a docstring of the function"))
    return faults


EXPORTS: Catalogue[Export] = Catalogue(
    "export",
    "softcal.exports",
    _faults,
    home="softcal.workflows.exports",
)

F = TypeVar("F", bound=Callable[..., list[Path]])


def register_export(*files: str, pulled: bool = True, hint: str = "", **options: ExportOption) -> Callable[[F], F]:
    """Add an export of one's own: `softcal export` lists it by the function's name from then on.

    A package does the same for every process by an entry point of the group `softcal.exports` that names the function.

    Parameters
    ----------
    files
        Patterns of the names of the files that it writes.
    pulled
        Whether pulls can take the place of the experiments (`--pull`).
    hint
        What to do with the files, where "{out}" is the folder.
    options
        What the command line may set, by the function's parameters.

    Returns
    -------
    callable
        The decorator of the function, which stays as it is: from an `ExportRequest`, an empty folder and the options to
        the paths that it wrote there.

    Raises
    ------
    InputError
        Where it is written without its brackets.
    ParameterError
        Where another export has the name, an option is no parameter of the function, or it has no description.
    """
    as_annotated(files, tuple[str, ...], "files")
    return EXPORTS.decorator(lambda function: Export(function.__name__, function, files, options, pulled, hint))


@checked_arguments
def write_export(name: str, request: ExportRequest, folder: str | Path, **options: Any) -> list[Path]:
    """Write an export into a new folder, completely or not at all; returns the files.

    Parameters
    ----------
    name
        Name of the export.
    request
        The project, its pulls, and observers.
    folder
        New or empty.
    **options
        Of the export.

    Raises
    ------
    InputError
        For an unknown export, or what it cannot represent.
    StorageError
        Where the folder holds files, or cannot be written.
    SimulationError
        If what it needs cannot be simulated.
    """
    from softcal.workflows.output import new_folder, require_free_folder

    export, folder = EXPORTS.named(name), Path(folder)
    known = dict([*inspect.signature(export.function).parameters.items()][2:])
    faults = [unknown("the export has no such option", one, one, known, got="") for one in options if one not in known]
    faults += [
        Fault("the export needs this option", one, attempt=f"write_export('{name}', …, {one}=…)")
        for one, parameter in known.items()
        if parameter.default is parameter.empty and one not in options
    ]
    if faults:
        raise InputError(faults)
    for one, option in export.options.items():
        as_annotated(options.get(one), option.kind | None, one)
    require_free_folder(folder)
    with new_folder(folder) as part:
        written = [path.relative_to(part) for path in export.function(request, part, **options)]
    return [folder / path for path in written]


def each_in_its_folder(names: Sequence[str], folder: Path, write: Callable[[str, Path], list[Path]]) -> list[Path]:
    """Let `write` fill the folder; several names get a subfolder each.

    Parameters
    ----------
    names
        Names of the cases.
    folder
        An existing folder.
    write
        Function of a case and its folder, which returns the files that it wrote.
    """
    written: list[Path] = []
    for name in names:
        inside = folder / name if len(names) > 1 else folder
        inside.mkdir(exist_ok=True)
        written += write(name, inside)
    return written
