"""StanfordASL's trunk: a hose with three discs, whose twelve tendons six motors pull in pairs, and a payload."""

from __future__ import annotations

from softcal.plugins.bench.case import Published, register_case
from softcal.plugins.bench.project_case import ProjectCase


@register_case
class Trunk(ProjectCase):
    """Motions without a payload for the fit; later motions, and motions with 100 and 200 g, for the prediction."""

    name = "asl-trunk"
    title = (
        "Trunk of a vacuum hose with three discs, driven in pairs of tendons by six motors, with payloads (ASL Trunk)"
    )
    source = "StanfordASL/trunk-stack @8b4b923, stack/main/data/trajectories"
    licence = "MIT, © 2024 Stanford Autonomous Systems Lab"
    length = 0.32
    tip = "disc3"
    published = (
        Published(
            "polynomials of degree 1",
            "in the six angles, least squares on all 11,250 rows of the first three quarters of the record",
            fit=(10.95e-3, 18.20e-3),
            predict=(11.28e-3, 18.24e-3),
        ),
        Published(
            "polynomials of degree 2",
            "likewise, 28 terms",
            fit=(6.79e-3, 10.96e-3),
            predict=(9.40e-3, 15.02e-3),
        ),
        Published(
            "polynomials of degree 3",
            "likewise, 84 terms",
            fit=(4.36e-3, 7.03e-3),
            predict=(8.87e-3, 14.02e-3),
        ),
    )
    remarks = (
        "Nothing with a payload is fitted. All discs are 7.7 mm off (RMS) in the later motions, 8.3 mm with 100 g and "
        "8.4 mm with 200 g; polynomials of degree 3 are 8.2, 7.9 and 10.0 mm off. Every sample is a state by itself, "
        "without inertia and friction. The bands are 8 to 9 mm at every disc, since the noise has one size: those of "
        "disc 1 are too wide. The pretension of the tendons to disc 1 is at its lower bound, and the springs of disc "
        "3 are not determined: the sleds are no plain springs. The samples to predict were looked at twice; the priors "
        "of zeros and pretensions were stated after a first fit, of fewer samples, whose zeros were 30 degrees."
    )
