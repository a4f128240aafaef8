"""The command `softcal reach`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, print_table, print_warnings, shown_path
from softcal.cli.running import clock
from softcal.cli.values import Source, Values, parsed_pairs, parsed_values
from softcal.errors import Fault, InputError, unknown

if TYPE_CHECKING:
    from collections.abc import Callable

V = TypeVar("V")
MOST = 20  # targets in the printed table


def _option(metavar: str, text: str) -> Any:
    return typer.Option(metavar=metavar, help=text, show_default=False)


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
    by: Annotated[
        list[str] | None,
        _option("CONTROL", "tension (default) or shortening; or by cable, front=tension: the others are then slack."),
    ] = None,
    limit: Annotated[
        list[str] | None,
        _option("CHANNEL=LOW..HIGH", "Limits: tension=0N..20N, tip.z=100mm.. or pitch=..40deg."),
    ] = None,
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
    pretension: Annotated[str, _option("VALUE", "Least tension of every driven cable, such as 1N.")] = "0",
    obstacles: Annotated[
        Path | None,
        _option("FILE", "Half-spaces, spheres and boxes that the robot must not enter, as YAML with units."),
    ] = None,
    values: Values = None,
    picture: Annotated[
        Path | None, _option("FILE", "A new picture, .png or .svg: the state of the last target, with the obstacles.")
    ] = None,
    out: Annotated[Path | None, _option("DIR", "A folder, new or empty, for the commands as CSV and JSON.")] = None,
) -> None:
    """Tensions or shortenings that bring the robot to a wanted pose, within limits, on the exact twin.

    Of a project, or of a run at its calibrated values. The commands can be replayed: softcal simulate --commands.
    """
    from softcal.workflows.study_source import load_calibrated

    project = load_calibrated(source, parsed_values(values))
    print_warnings(project.warnings if not source.is_dir() else ())
    from softcal.sensing.channel import TIME
    from softcal.twin.channels import channels_of, sensors_of, stiffness_units
    from softcal.units import parse_quantity

    of_robot = channels_of(sensors_of(project.robot))
    units = {name: one.kind.unit for one in of_robot for name in (str(one), one.kind.name)}
    units |= stiffness_units(project.robot)
    faults: list[Fault] = []

    def read(given: list[str] | None, option: str, each: Callable[[str, str, str], V]) -> dict[str, V]:
        """Channel -> value of an option; each: a text, the unit and the place -> the value."""
        found: dict[str, V] = {}
        try:
            texts = [part for text in given or [] for part in text.split(",")]
            pairs = parsed_pairs(texts, option, "this is no pair", "such as tip.x=20mm")
        except InputError as error:
            faults.extend(error.faults)
            return found
        for name, text in pairs.items():
            where = f"{option} {name}"
            try:
                if name not in units:
                    raise InputError(unknown("the robot has no such channel", option, name, units))
                found[name] = each(text, units[name], where)
            except InputError as error:
                faults.extend(error.faults)
        return found

    def number(text: str, unit: str, where: str) -> float:
        return parse_quantity(text, unit, where=where)

    def bounds(text: str, unit: str, where: str) -> tuple[float, float]:
        low, dots, high = text.partition("..")
        if not dots:
            raise InputError(
                Fault("these are no limits", where, f"'{text}'", "LOW..HIGH, such as 0N..20N, or one of both")
            )
        ends = [number(end, unit, where) if end.strip() else None for end in (low, high)]
        return (float("-inf") if ends[0] is None else ends[0], float("inf") if ends[1] is None else ends[1])

    wanted: dict[str, float | Sequence[float]] = dict(read(to, "--to", number))
    limits, tolerances = read(limit, "--limit", bounds), read(tolerance, "--tolerance", number)
    rates = read(rate, "--rate", lambda text, unit, where: number(text, f"{unit}/s", where))
    weights = read(weight, "--weight", lambda text, unit, where: number(text, "1", where))
    floor, times = 0.0, None
    try:
        floor = number(pretension, "N", "--pretension")
    except InputError as error:
        faults.extend(error.faults)
    controls: Any = "tension"
    if by:
        names = [part.strip() for text in by for part in text.split(",")]
        controls = names[0] if len(names) == 1 and "=" not in names[0] else {}
        if controls == {}:
            try:
                controls = parsed_pairs(names, "--by", "this is no control", "tension, shortening, or front=tension")
            except InputError as error:
                faults.extend(error.faults)
    if (targets is not None) == bool(to):
        faults.append(Fault("the targets are given by one of two options", allowed="--to or --targets"))
    elif targets is not None:
        from softcal.experiments.read import read_channels

        try:
            table = read_channels(targets, [str(one) for one in of_robot])
            wanted = {name: table.values(name).tolist() for name in table.channels if name != TIME.name}
            times = table.values(TIME.name).tolist() if TIME.name in table.channels else None
        except InputError as error:
            faults.extend(error.faults)
    around = None
    if obstacles is not None:
        from softcal.project.obstacles import read_obstacles

        try:
            around = read_obstacles(obstacles)
        except InputError as error:
            faults.extend(error.faults)
    if faults:
        raise InputError(faults)
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
