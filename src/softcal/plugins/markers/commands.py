"""Commands about cameras and markers: board, camera, markers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from softcal.cli.command import register_command
from softcal.cli.printing import echo, shown_path
from softcal.errors import Fault, InputError

Images = Annotated[list[str], typer.Argument(metavar="IMAGES", help="Files, folders or patterns.", show_default=False)]
Dictionary = Annotated[str, typer.Option(help="Dictionary of the markers, by OpenCV's name.")]
Squares = Annotated[str, typer.Option(metavar="CxR", help="Squares of the board along x and y.")]
Square = Annotated[str, typer.Option(metavar="LENGTH", help="Side of a square, as measured on the print.")]
Marker = Annotated[str, typer.Option(metavar="LENGTH", help="Side of a marker's black square on the board.")]
Legacy = Annotated[bool, typer.Option("--legacy", help="The board was made with OpenCV before 4.6, in even rows.")]


@register_command("data", 2)
def board(
    out: Annotated[Path, typer.Option(metavar="FILE.svg", help="A file that does not exist.", show_default=False)],
    dictionary: Dictionary = "DICT_4X4_50",
    squares: Squares = "9x6",
    square: Square = "28mm",
    marker: Marker = "21mm",
    ids: Annotated[
        str, typer.Option(help="Instead of a board: single markers, such as 0-4 or 0,3,7.", show_default=False)
    ] = "",
    size: Annotated[str, typer.Option(metavar="LENGTH", help="With --ids: side of the black square.")] = "20mm",
    legacy: Legacy = False,
) -> None:
    """Write a ChArUco board, or single markers, as SVG to print at true scale."""
    from softcal.plugins.markers.pattern_sheet import board_sheet, marker_sheet
    from softcal.quantities import QUANTITIES
    from softcal.workflows.output import require_free_file, write_new_file

    require_free_file(out)
    if ids:
        from softcal.checks import is_number
        from softcal.limits import LIMITS

        markers: list[int] = []
        for part in ids.split(","):
            first, sign, last = (piece.strip() for piece in part.partition("-"))
            if not (is_number(first) and (is_number(last) or not sign)):
                raise InputError(Fault("these are not markers", "--ids", f"'{ids}'", "such as 0-4 or 0,3,7"))
            wanted = range(int(first), int(last or first) + 1)
            LIMITS["markers"].check(len(markers) + len(wanted), where="--ids")
            markers += wanted
        text = marker_sheet(dictionary, markers, QUANTITIES["size"].read(size, where="--size"))
    else:
        text = board_sheet(_board(squares, square, marker, dictionary, legacy))
    write_new_file(out, text)
    echo(f"Wrote {shown_path(out)}. Print it at 100 %, glue it onto something flat, and measure a square.")


@register_command("data", 3)
def camera(
    images: Images,
    out: Annotated[Path, typer.Option(metavar="FILE", help="A file that does not exist.")] = Path("camera.yaml"),
    dictionary: Dictionary = "DICT_4X4_50",
    squares: Squares = "9x6",
    square: Square = "28mm",
    marker: Marker = "21mm",
    legacy: Legacy = False,
) -> None:
    """Calibrate a camera from images of a ChArUco board."""
    from softcal.plugins.markers.workflow import make_camera_file

    with _bar("Images") as progress:
        run = make_camera_file(images, _board(squares, square, marker, dictionary, legacy), out, progress=progress)
    found = run.calibration
    for image, rms in found.rms_by_image.items():
        echo(f"{image}: {rms:.3f} px")
    for image in run.skipped:
        echo(f"Warning: {image}: the board was not found; skipped.", err=True)
    for warning in found.warnings:
        echo(f"Warning: {warning}.", err=True)
    (fx, fy), (cx, cy) = found.camera.focal, found.camera.centre
    echo(f"Reprojection error: {found.rms:.3f} px (rms) over {len(found.rms_by_image)} images")
    echo(f"Focal lengths: {fx:.1f} and {fy:.1f} px, ± {found.focal_sd[0]:.2g} and {found.focal_sd[1]:.2g}")
    echo(f"Principal point: ({cx:.1f}, {cy:.1f}) px, ± {found.centre_sd[0]:.2g} and {found.centre_sd[1]:.2g}")
    echo(f"Wrote {shown_path(out)}")


@register_command("data", 4)
def markers(  # noqa: PLR0913 (one argument for each option)
    images: Images,
    camera: Annotated[Path, typer.Option(metavar="FILE", help="A file of softcal camera.", show_default=False)],
    size: Annotated[str, typer.Option(metavar="LENGTH", help="Side of the markers' black square.", show_default=False)],
    base: Annotated[
        str,
        typer.Option(
            metavar="ID",
            help="Marker that defines the frame (0), several that are fixed to each other (0,5,6), or a base file.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="A file that does not exist.")] = Path("markers.csv"),
    dictionary: Dictionary = "DICT_4X4_50",
    names: Annotated[str, typer.Option(metavar="ID=NAME,…", help="Names, such as 1=S1,2=S2.", show_default=False)] = "",
    sizes: Annotated[
        str, typer.Option(metavar="ID=LENGTH,…", help="Sizes of markers that differ from --size.", show_default=False)
    ] = "",
    group_by: Annotated[
        str,
        typer.Option(
            help="Images of one state: names that differ only in a number at the end (name), the same folder (folder), "
            "or each image alone (image)."
        ),
    ] = "name",
    viewpoints: Annotated[
        str,
        typer.Option(
            help="Position of the camera: another one in each image (each), one for all images of a number (numbered), "
            "or one for all images (one)."
        ),
    ] = "each",
) -> None:
    """Measure markers in images: positions relative to the base, with their uncertainty."""
    from softcal.plugins.markers.workflow import measure_markers

    with _bar("Images") as progress:
        run = measure_markers(
            images,
            camera=camera,
            dictionary=dictionary,
            size=size,
            base=base,
            out=out,
            names=names,
            sizes=sizes,
            group_by=group_by,  # pyright: ignore[reportArgumentType] (checked there)
            viewpoints=viewpoints,  # pyright: ignore[reportArgumentType]
            progress=progress,
        )
    table = run.table
    for group in table.groups:
        found = {name: table.cells[group, name] for name in table.names if (group, name) in table.cells}
        worst = max((one.covariance.diagonal()[3:].max() ** 0.5 for one in found.values()), default=None)
        told_sd = "" if worst is None else f", sd up to {worst * 1e3:.2g} mm"
        n = table.n_images[group]
        echo(f"{group}: {n} image{'s' if n > 1 else ''}, {', '.join(found) or 'no marker'}{told_sd}")
        for note in table.notes[group]:
            echo(f"Warning: {group}: {note}.", err=True)
    for remark in table.remarks:
        echo(f"Warning: {remark}.", err=True)
    echo(f"Corners are good to {table.noise:.2g} px")
    echo(f"Wrote {shown_path(out)}")


def _board(squares: str, square: str, marker: str, dictionary: str, legacy: bool) -> Any:
    from softcal.checks import is_number
    from softcal.plugins.markers.fiducials import CharucoBoard
    from softcal.quantities import QUANTITIES

    columns, sign, rows = squares.lower().partition("x")
    if not (sign and is_number(columns.strip()) and is_number(rows.strip())):
        raise InputError(Fault("this is not a number of squares", "--squares", f"'{squares}'", "such as 9x6"))
    sides = QUANTITIES["size"].read(square, where="--square"), QUANTITIES["size"].read(marker, where="--marker")
    return CharucoBoard(int(columns), int(rows), *sides, dictionary, legacy)


@contextmanager
def _bar(label: str) -> Generator[Callable[[int, int], None]]:
    """A progress bar on a terminal; nothing without one."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
