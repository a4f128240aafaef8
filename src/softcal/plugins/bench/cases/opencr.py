"""OpenCR's tendon-driven continuum robot: three segments, nine cables by servo travel, the tip by motion capture."""

from __future__ import annotations

from softcal.plugins.bench.case import Published, register_case
from softcal.plugins.bench.project_case import ProjectCase


@register_case
class OpenCr(ProjectCase):
    """One and two segments to fit, three together to predict."""

    name = "opencr-v4"
    title = "Three-segment continuum robot of nine cables by servo travel, tip by motion capture (OpenCR v4)"
    source = "ContinuumRoboticsLab/opencr-mujoco @17fff8b, data/sysid/ftdcr_v4"
    licence = "MIT, © 2026 Continuum Robotics Lab"
    length = 0.1865
    tip = "tip"
    held_out = ("predict",)
    left_out = ("pulls",)
    aligned = True
    published = (
        Published(
            "OpenCR-MuJoCo",
            "its code and identified model ftdcr_v4_sysid.json, run on these files",
            fit=(6.68e-3, 6.68e-3),
            predict=(9.39e-3, 9.39e-3),
        ),
        Published(
            "OpenCR-MuJoCo, identified on another recording",
            "its code and ftdcr_v4_sysid_0326.json, run on these files",
            fit=(9.68e-3, 9.68e-3),
            predict=(12.11e-3, 12.11e-3),
        ),
        Published(
            "repeatability",
            "the same command at another time; the floor of models without memory",
            note="3.5 mm near neutral, 4.7 mm anywhere",
        ),
    )
    goal = "at most 4.7 mm on the rows to predict, which needs friction with a memory; 6 mm without"
    remarks = (
        "The goal of 4.7 mm is missed. It leaves 39 % less than its rival, and 78 %, not 95 %, of the values are in "
        "its bands. Each cable has its angle and its zero, the segments have their moduli, and the drives have "
        "backlash. That was chosen on the samples to fit alone, in a quicker model of constant curvature in each "
        "part of a segment: by leaving out every fourth pattern, and by predicting the motions of two segments from "
        "those of one. Angles and zeros alone leave 4.3 and 5.2 mm; with backlash, 3.8 and 4.7 mm; with moduli, 3.7 "
        "and 4.3 mm. The single pulls are not fitted: with them 4.1 and 4.7 mm of the others are left, since their "
        "angles and zeros are not those of the others. The loss has a kink at its minimum, since cables become "
        "slack in many samples at once; the intervals below are those of its slopes there. The friction of cables "
        "was found to be zero. Routing radii (3.6 and 4.4 mm) and the marker's height (3.8 and 4.5 mm) did not help "
        "in both; the next best were a twist of the cables about the axis (4.2 mm of two segments) and dry friction "
        "of bending (4.2 mm). What is left is largest where all segments bend far the same way, and at small "
        "commands: after motions of two segments against each other the tip stays 4 to 8 mm on the side that it was "
        "bent to, as friction in the body would hold it."
    )
