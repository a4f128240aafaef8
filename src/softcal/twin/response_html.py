"""A response as a small table for notebooks: its channels with their units, ends and courses."""

from __future__ import annotations

import numpy as np

from softcal.display import pictures_of
from softcal.html_text import curve, heading, html_table, paragraph, picture
from softcal.twin.response import Response
from softcal.units import format_quantity


def response_html(response: Response) -> str:
    """The status, a row for each channel, and what must be known of the shapes."""
    rows: list[list[object]] = []
    for name, values in response.channels.items():
        known = values[np.isfinite(values)]
        unit = response.units[name]
        ends = (
            [format_quantity(float(x), unit) for x in (known.min(), known.max(), known[-1])]
            if len(known)
            else ["–"] * 3
        )
        rows.append([name, *ends, curve(values.tolist())])
    samples = max((len(values) for values in response.channels.values()), default=0)
    return "".join(
        [
            heading(f"{'' if response.succeeded else 'Failed: '}{response.status}"),
            html_table(["channel", "least", "largest", "last", f"over {samples} samples"], rows),
            *(paragraph(f"Warning: {warning}") for warning in response.warnings),
            *(picture(png, "shape") for png in pictures_of(response)),
        ]
    )
