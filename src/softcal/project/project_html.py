"""A project as small tables for notebooks: its robot, its experiments, its free parameters, its warnings."""

from __future__ import annotations

from softcal.html_text import heading, html_table, paragraph, picture
from softcal.pictures import pictures_of
from softcal.project.project import Project
from softcal.units import format_quantity, format_range


def project_html(project: Project) -> str:
    """Parts, experiments with their samples and channels, free parameters with their bounds, warnings."""
    robot = project.robot
    counts = {"body": len(robot.bodies), "rod": len(robot.rods), "plate": len(robot.plates), "cable": len(robot.cables)}
    named = {"body": "bodies"}
    parts = [f"{n} {kind if n == 1 else named.get(kind, f'{kind}s')}" for kind, n in counts.items() if n]
    experiments = [
        [name, one.dataset.n_samples, ", ".join(one.drives) or "–", ", ".join(one.compared)]
        for name, one in project.experiments.items()
    ]
    known = project.parameters
    free = () if project.space is None else project.space.parameters
    rows = [
        [p.label, format_range(p.lower, p.upper, unit), p.scale]
        for p in free
        for unit in [known[p.targets[0]].unit if p.targets[0] in known else "1"]
    ]
    held = [[name, format_quantity(value, known[name].unit)] for name, value in project.held.items() if name in known]
    found = [heading(project.name), paragraph(", ".join(parts))]
    found += [html_table(["experiment", "samples", "driven", "compared"], experiments)] if experiments else []
    found += [html_table(["free parameter", "bounds", "scale"], rows)] if rows else []
    found += [html_table(["fixed parameter", "value"], held)] if held else []
    found += [paragraph(f"Warning: {warning}") for warning in project.warnings]
    return "".join([*found, *(picture(png, "robot") for png in pictures_of(project.robot))])
