"""The check of a robot's cables: their routes, their supports, where they leave their bores; and of the
limits of all that drives it.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby

import numpy as np

from softcal.mechanics.attachment import Attachment
from softcal.project.project import Project
from softcal.twin.actuated import faults_of_limits
from softcal.twin.robot import Cable, Robot
from softcal.twin.routing import off_bore, supports
from softcal.units import format_quantity
from softcal.workflows.simulation import protocol_of


def cable_rows(robot: Robot) -> list[tuple[str, str]]:
    """A row for each cable, with the rows that belong to it."""
    rows, attachments = list[tuple[str, str]](), supports(robot)
    meshes = {body.name: body.mesh for body in robot.bodies}
    for cable in robot.cables:
        runs = [(on or "space", len(list(run))) for on, run in groupby(via.on for via in cable.via_points)]
        via = " → ".join(on if count == 1 else f"{on} ({count} points)" for on, count in runs)
        rows.append((f"cable {cable.name}", f"{format_quantity(cable.length, 'm')} long, {via}"))
        if cable.routing_axis is not None:
            _, radii = cable.routing_axis.away(np.array([via.at for via in cable.via_points]))
            least, most = (format_quantity(float(r), "m", digits=4) for r in (radii.min(), radii.max()))
            far = least if least == most else f"{least} to {most}"
            offset, angle = format_quantity(cable.routing_offset, "m"), format_quantity(cable.routing_angle, "rad")
            rows.append(("  routing", f"{far} from its axis, with an offset of {offset} and an angle of {angle}"))
        rows += _support_rows(cable, attachments.get(cable.name, {}))
        for body, length in off_bore(cable, meshes).items():
            if length.in_bore:
                far = format_quantity(length.in_bore, "m", digits=3)
                rows.append(
                    ("  straight", f"{far} in a bore or cavity of {body}; a via point on {body} makes it a guide")
                )
            if length.embedded:
                far = format_quantity(length.embedded, "m", digits=3)
                rows.append(("  embedded", f"{far} in the material of {body}, which has no bore there and guides it"))
        stated = cable.properties
        of_line = (
            ("EA", cable.stiffness, "N"),
            ("compliance of the machine", cable.line.compliance, "m/N"),
            ("pretension", cable.pretension, "N"),
        )
        line = [f"{word} {format_quantity(value, unit)}" for word, value, unit in of_line if value is not None]
        if line:
            rows.append(("  line", ", ".join(line)))
        beside = ""
        if preload := stated.get("friction_preload"):
            beside = f", of the tension and a preload of {format_quantity(preload, 'N')}"
        friction = f"{cable.friction_coefficient:.4g}{beside}"
        if "presliding" in stated:
            over = format_quantity(stated["presliding"], "m")
            rows.append(("  friction", f"{friction}, against the sliding, built up over {over} of it"))
        elif cable.friction_coefficient:
            rows.append(("  friction", f"{friction}, of a cable that is pulled in"))
    return rows


def off_course(robot: Robot) -> list[str]:
    """The cables that run straight through a body, or off the bore that they are in."""
    meshes = {body.name: body.mesh for body in robot.bodies}
    sentences: list[str] = []
    for cable in robot.cables:
        for body, length in off_bore(cable, meshes).items():
            straight, guided = (format_quantity(part, "m", digits=3) for part in (length.straight, length.guided))
            if length.straight:
                sentences.append(
                    f"{cable.name}: {straight} of it run straight through the material of {body}, off any bore, and "
                    f"do not bend with it; allowed: a cable that follows {body}; try a via point on it, and route: bore"
                )
            if length.guided:
                sentences.append(
                    f"{cable.name}: {guided} of it run through the material of {body}, beside the bore in which the "
                    "rest is; allowed: a line along the bore; try via points on its axis, and where it turns"
                )
    return sentences


def _support_rows(cable: Cable, attachments: Mapping[int, Attachment]) -> list[tuple[str, str]]:
    """How many via points of a cable lie in bores, and over which extent bodies bear the force of the stated ones."""
    rows: list[tuple[str, str]] = []
    wide = [attachment.bore for attachment in attachments.values() if attachment.bore > 0.0]
    if wide:
        usual, widest = (format_quantity(width, "m", digits=3) for width in (float(np.median(wide)), max(wide)))
        of = (
            f"{len(wide)} of {len(cable.via_points)} via points lie in bores, {usual} across (median), {widest} at most"
        )
        rows.append(("  bores", f"{of}: guided by the walls"))
    balls: dict[str, list[float]] = {}
    for i, attachment in attachments.items():
        via = cable.via_points[i]
        if via.share is None:
            kind = "stated" if via.radius is not None else "by the bore" if attachment.bore else "by default"
            balls.setdefault(kind, []).append(attachment.radius)
    spread = []
    for kind, radii in balls.items():
        least, most = (format_quantity(r, "m", digits=3) for r in (min(radii), max(radii)))
        size = least if least == most else f"{least} to {most}"
        spread.append(f"{size} ({kind}) at {len(radii)} via point{'s' * (len(radii) > 1)}")
    if spread:
        rows.append(("  extent", f"force over a radius of {', '.join(spread)}"))
    return rows


def beyond_limits(project: Project) -> list[str]:
    """Tests whose commands, at the start values, are beyond the limits of the actuators."""
    sentences: list[str] = []
    for name in project.experiments:
        commands = protocol_of(project, name).commands.items()
        values = {f"{actuator}.{command.control}": command.values for actuator, command in commands}
        sentences += [f"{name}: {fault}" for fault in faults_of_limits(project.robot.limited, values)]
    return sentences
