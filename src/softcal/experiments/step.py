"""A preparation step: its name in a project, the function that does it, and its settings with units."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeVar

from softcal.catalogue import Catalogue, FunctionMember
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault
from softcal.experiments.dataset import Dataset
from softcal.quantities import QUANTITIES

# Kinds of settings that are no quantity.
KINDS = ("of channel", "count", "flag", "channel", "choice", "cycles")
LeavesOut = Literal["", "samples", "cycles"]


@displayed
@dataclass(frozen=True)
class Setting(Checked):
    """A setting of a step.

    Attributes
    ----------
    kind : str
        A quantity of `QUANTITIES` by its name, read with its unit; "of channel", a quantity in the unit of the channel
        that the setting `channel_from` names; "count", a whole number; "flag", true or false; "channel", a channel's
        name; "choice", one of `choices`; "cycles", one of `choices` or a list of cycle numbers.
    choices : tuple of str
        Words that are allowed, of some kinds beside what they read.
    channel_from : str
        Of "of channel": the setting that names the channel.
    drives : {"", "coordinate", "effort"}
        Of "channel": where the setting is left out, the driven actuator's coordinate or effort is meant. Of "of
        channel": it is an offset of the coordinate or the effort of the actuator whose channel is named, or that the
        record drives.
    former : str
        Another name under which projects may have the setting.
    of : str
        Of "count": what is counted, by its name in `LIMITS`.
    """

    kind: str
    choices: tuple[str, ...] = ()
    channel_from: str = "channel"
    drives: Literal["", "coordinate", "effort"] = ""
    former: str = ""
    of: str = "samples"


@dataclass(frozen=True)
class PreparationStep(FunctionMember):
    """A step that a project can name.

    Attributes
    ----------
    name : str
        That of the function.
    function : callable
        From a dataset and settings in SI to the next dataset.
    settings : mapping of str to Setting
        By the function's parameters, in the order of their importance: the first may be given alone.
    keeps_gaps : bool
        True if values may be missing.
    leaves_out : {"", "samples", "cycles"}
        Parts of the record that the step leaves out.
    """

    settings: Mapping[str, Setting] = field(default_factory=dict[str, Setting])
    keeps_gaps: bool = False
    leaves_out: LeavesOut = ""

    @property
    def required(self) -> tuple[str, ...]:
        """Settings for which the function has no default."""
        parameters = inspect.signature(self.function).parameters
        return tuple(key for key in self.settings if parameters[key].default is inspect.Parameter.empty)


def _faults(step: PreparationStep, _: Mapping[str, PreparationStep]) -> list[Fault]:
    """Faults of a step to be registered."""
    if not isinstance(step, PreparationStep):  # pyright: ignore[reportUnnecessaryIsInstance] (an entry point may be anything)
        allowed = "what softcal.register_step returns for a function"
        return [Fault("this is not a preparation step", "prepare", repr(step)[:60], allowed)]
    where = f"step {step.name}"
    parameters = list(inspect.signature(step.function).parameters)[1:]  # the first is the dataset
    faults = [
        Fault("the function has no such parameter", f"{where}, {key}", allowed=", ".join(parameters))
        for key in step.settings
        if key not in parameters
    ]
    known = [*KINDS, *QUANTITIES]
    faults += [
        Fault("there is no such kind of setting", f"{where}, {key}", setting.kind, ", ".join(known))
        for key, setting in step.settings.items()
        if setting.kind not in known
    ]
    if not step.summary:
        faults.append(Fault("the step has no description", where, attempt="a docstring of the function"))
    return faults


STEPS: Catalogue[PreparationStep] = Catalogue(
    "preparation step", "softcal.steps", _faults, home="softcal.experiments.steps"
)

F = TypeVar("F", bound=Callable[..., Dataset])


def register_step(*, keeps_gaps: bool = False, leaves_out: LeavesOut = "", **settings: Setting) -> Callable[[F], F]:
    """Add a preparation step: `prepare:` of a project then accepts the name of the function.

    Parameters
    ----------
    keeps_gaps
        True if the function accepts missing values (NaN).
    leaves_out
        "samples" or "cycles", if the step leaves some of them out.
    settings
        Settings in a project file, by the function's parameters.

    Returns
    -------
    callable
        The decorator of the function, which stays as it is: from a `Dataset` and settings in SI to a `Dataset`.

    Raises
    ------
    ParameterError
        Where another step has the name, or a setting is no parameter of the function.
    """
    return STEPS.decorator(
        lambda function: PreparationStep(function.__name__, function, settings, keeps_gaps, leaves_out)
    )
