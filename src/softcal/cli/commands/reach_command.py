"""The commands `softcal reach` and `softcal workspace`: limits, obstacles and wanted values as options."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table, print_warnings, shown_path
from softcal.cli.running import clock
from softcal.cli.study import StudyFolder, study_folder
from softcal.cli.values import Source, Values, parsed_pairs, parsed_values
from softcal.errors import Fault, InputError, unknown

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from softcal.geometry.obstacle import Obstacle
    from softcal.twin.robot import Robot

V = TypeVar("V")
MOST = 20  # targets in the printed table


def _option(metavar: str, text: str) -> Any:
    return typer.Option(metavar=metavar, help=text, show_default=False)


By = Annotated[
    list[str] | None,
    _option("CONTROL", "tension (default), shortening or another; or by actuator, front=tension: the others rest."),
]
Limit = Annotated[
    list[str] | None,
    _option("CHANNEL=LOW..HIGH", "Limits: tension=0N..20N, tip.z=100mm.. or pitch=..40deg."),
]
Pretension = Annotated[str, _option("VALUE", "Least tension of every driven cable, such as 1N.")]
Obstacles = Annotated[
    Path | None,
    _option("FILE", "Half-spaces, spheres and boxes that the robot must not enter, as YAML with units."),
]
NewFolder = Annotated[Path | None, _option("DIR", "A folder, new or empty, for the commands as CSV and JSON.")]


class _Options:
    """Options on channels of a robot, with their faults together."""

    def __init__(self, robot: Robot) -> None:
        from softcal.twin.channels import channels_of, sensors_of, stiffness_units

        self.channels = [*channels_of(sensors_of(robot))]
        self.units = {name: one.kind.unit for one in self.channels for name in (str(one), one.kind.name)}
        self.units |= stiffness_units(robot)
        self.faults: list[Fault] = []

    def pairs(self, given: list[str] | None, option: str, each: Callable[[str, str, str], V]) -> dict[str, V]:
        """Channel -> value of an option; each: a text, the unit and the place -> the value."""
        found: dict[str, V] = {}
        try:
            texts = [part for text in given or [] for part in text.split(",")]
            pairs = parsed_pairs(texts, option, "this is no pair", "such as tip.x=20mm")
        except InputError as error:
            self.faults.extend(error.faults)
            return found
        for name, text in pairs.items():
            where = f"{option} {name}"
            try:
                if name not in self.units:
                    raise InputError(unknown("the robot has no such channel", option, name, self.units))
                found[name] = each(text, self.units[name], where)
            except InputError as error:
                self.faults.extend(error.faults)
        return found

    def limits(self, given: list[str] | None) -> dict[str, tuple[float, float]]:
        """Channel -> its ends, infinite for none."""

        def ends(text: str, unit: str, where: str) -> tuple[float, float]:
            low, dots, high = text.partition("..")
            if not dots or text.strip() == dots:
                allowed = "LOW..HIGH, such as 0N..20N, or one of both"
                raise InputError(Fault("these are no limits", where, f"'{text}'", allowed))
            none = float("-inf"), float("inf")
            low, high = (
                _number(end, unit, where) if end.strip() else other
                for end, other in zip((low, high), none, strict=True)
            )
            return low, high

        return self.pairs(given, "--limit", ends)

    def floor(self, pretension: str) -> float:
        """The least tension [N]."""
        return self.read(lambda: _number(pretension, "N", "--pretension"), 0.0)

    def controls(self, by: list[str] | None) -> Any:
        """The control of all actuators, or of each."""
        names = [part.strip() for text in by or ["tension"] for part in text.split(",")]
        if len(names) == 1 and "=" not in names[0]:
            return names[0]
        allowed = "tension, shortening, or front=tension"
        return self.read(lambda: parsed_pairs(names, "--by", "this is no control", allowed), {})

    def obstacles(self, path: Path | None) -> Mapping[str, Obstacle] | None:
        """The obstacles of a file."""
        if path is None:
            return None
        from softcal.project.obstacles import read_obstacles

        return self.read(lambda: read_obstacles(path), None)

    def read(self, value: Callable[[], V], instead: Any) -> V:
        """A value, or with a fault something else."""
        try:
            return value()
        except InputError as error:
            self.faults.extend(error.faults)
            return instead


def _number(text: str, unit: str, where: str) -> float:
    from softcal.units import parse_quantity

    return parse_quantity(text, unit, where=where)


@register_command("plan", 2)
def reach(  # noqa: PLR0913 (one argument for each option)
    source: Source,
    to: Annotated[
        list[str] | None,
        _option("CHANNEL=VALUE", "A wanted value, such as tip.x=20mm; several with commas, or repeat the option."),
    ] = None,
    targets: Annotated[
        Path | None, _option("TABLE", "Wanted values, a row per target: columns such as tip.x [mm], and time [s].")
    ] = None,
    by: By = None,
    limit: Limit = None,
    rate: Annotated[
        list[str] | None, _option("CHANNEL=RATE", "Largest change per second, such as tension=5N/s; needs times.")
    ] = None,
    tolerance: Annotated[
        list[str] | None, _option("CHANNEL=VALUE", "When a target counts as reached: by default 10um, 0.01deg, 10mN.")
    ] = None,
    weight: Annotated[
        list[str] | None, _option("CHANNEL=NUMBER", "Weight where targets cannot be reached together; by default 1.")
    ] = None,
    prefer: Annotated[
        str, typer.Option(metavar="WHICH", help="Of several commands for one target: effort (the least), or nearest.")
    ] = "effort",
    pretension: Pretension = "0",
    obstacles: Obstacles = None,
    values: Values = None,
    picture: Annotated[
        Path | None, _option("FILE", "A new picture, .png or .svg: the state of the last target, with the obstacles.")
    ] = None,
    out: NewFolder = None,
) -> None:
    """Tensions or shortenings that bring the robot to a wanted pose, within limits, on the exact twin.

    Of a project, or of a run at its calibrated values. The commands can be replayed: softcal simulate --commands.
    """
    from softcal.workflows.study_source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    print_warnings(project.warnings if not source.is_dir() else ())
    from softcal.sensing.channel import TIME

    options = _Options(project.robot)
    wanted: dict[str, float | Sequence[float]] = dict(options.pairs(to, "--to", _number))
    limits, tolerances = options.limits(limit), options.pairs(tolerance, "--tolerance", _number)
    rates = options.pairs(rate, "--rate", lambda text, unit, where: _number(text, f"{unit}/s", where))
    weights = options.pairs(weight, "--weight", lambda text, unit, where: _number(text, "1", where))
    floor, controls, around, times = options.floor(pretension), options.controls(by), options.obstacles(obstacles), None
    if (targets is not None) == bool(to):
        options.faults.append(Fault("the targets are given by one of two options", allowed="--to or --targets"))
    elif targets is not None:
        from softcal.experiments.read import read_channels

        try:
            table = read_channels(targets, [str(one) for one in options.channels])
            wanted = {name: table.values(name).tolist() for name in table.channels if name != TIME.name}
            times = table.values(TIME.name).tolist() if TIME.name in table.channels else None
        except InputError as error:
            options.faults.extend(error.faults)
    if options.faults:
        raise InputError(options.faults)
    from rich.table import Table

    from softcal.analysis.reach import reach_sentences
    from softcal.units import format_quantity
    from softcal.workflows.reach import reach as find

    n = max((len(one) for one in wanted.values() if isinstance(one, list)), default=1)
    with clock() as show:
        chosen: Any = prefer
        show(f"Target 1 of {n}")
        result = find(
            source if source.is_dir() and not values else project,
            wanted,
            times=times,
            controls=controls,
            limits=limits,
            rates=rates,
            tolerances=tolerances,
            weights=weights,
            prefer=chosen,
            pretension=floor,
            obstacles=around,
            picture=picture,
            out=out,
            progress=lambda k, step: show(f"Target {min(k + 1, n)} of {n}"),
        )
    first = result.steps[0]
    shown = Table("target", "", *first.commands, *first.wanted, *(f"{name} off" for name in first.wanted))
    for k, step in enumerate(result.steps[:MOST], start=1):
        cells = [format_quantity(value + 0.0, result.units[one]) for one, value in step.commands.items()]
        cells += [format_quantity(step.channels[one] + 0.0, result.units[one]) for one in step.wanted]
        cells += [format_quantity(off + 0.0, result.units[one], digits=2) for one, off in step.misses.items()]
        shown.add_row(str(k) if step.time is None else f"{k}, {step.time:g} s", step.outcome, *cells)
    print_table(shown)
    if len(result.steps) > MOST:
        echo(f"The first {MOST} of {len(result.steps)} targets; --out writes them all.")
    for sentence in reach_sentences(result):
        echo(sentence)
    if picture is not None:
        echo(f"Wrote {shown_path(picture)}")
    if out is not None:
        echo(f"Wrote {shown_path(out)}")
        echo(f"Replay with: softcal simulate PROJECT --commands {shown_path(out / 'commands.csv')} --out DIR")


@register_command("plan", 3)
def workspace(  # noqa: PLR0913 (one argument for each option)
    source: Source,
    of: Annotated[
        str, typer.Option("--of", metavar="CHANNELS", help="One to three channels: tip.x,tip.z.", show_default=False)
    ],
    by: By = None,
    limit: Limit = None,
    pretension: Pretension = "0",
    obstacles: Obstacles = None,
    states: Annotated[
        int | None, _option("N", "Commands that are tried; 64, 256 or 512 by default for one, two or three channels.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of these commands.")] = 1,
    values: Values = None,
    picture: Annotated[Path | None, _option("FILE", "A new picture, .png or .svg.")] = None,
    out: StudyFolder = None,
) -> None:
    """What the robot reaches within limits: border, mobility, compliance and singular poses, on the exact twin.

    Of a project, or of a run at its calibrated values. Every command needs limits: those of the robot's
    `actuator_limits`, or --limit tension=0N..20N.
    """
    from softcal.workflows.study_source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    print_warnings(project.warnings if not source.is_dir() else ())
    options = _Options(project.robot)
    limits, floor = options.limits(limit), options.floor(pretension)
    controls, around = options.controls(by), options.obstacles(obstacles)
    if options.faults:
        raise InputError(options.faults)
    from rich.table import Table

    from softcal.analysis.workspace import compliance_unit, workspace_sentences
    from softcal.units import format_quantity, plain
    from softcal.workflows.workspace import WORKSPACE
    from softcal.workflows.workspace import workspace as find

    folder = out if values or out is not None else study_folder(WORKSPACE, source, out)
    with clock() as show:
        found = find(
            source if source.is_dir() and not values else project,
            [name.strip() for name in of.split(",")],
            limits=limits,
            controls=controls,
            pretension=floor,
            obstacles=around,
            states=states,
            seed=seed,
            picture=picture,
            out=folder,
            progress=lambda what, done, n: show(f"{what.capitalize()}: {done} of {n}"),
        )
    shown = Table("", "from", "to", "compliance from", "to")
    for name, ends in found.spans.items():
        cells = [format_quantity(end, found.units[name]) for end in ends]
        soft = [state.compliances[name] for state in found.states if name in state.compliances]
        cells += [
            f"{plain(end, 3)} {compliance_unit(found.units[name])}" for end in ((min(soft), max(soft)) if soft else ())
        ]
        shown.add_row(name, *cells)
    worst = [state.mobility[-1] for state in found.states]
    shown.add_row("mobility, worst direction", *(plain(end, 3) for end in (min(worst), max(worst))))
    print_table(shown)
    for sentence in workspace_sentences(found):
        echo(sentence)
    for file in (picture, folder):
        if file is not None:
            echo(f"Wrote {shown_path(file)}")
    if folder is not None and source.is_dir() and out is None:
        echo(f"Add it to the report with: softcal report {source}")
