"""The examples as cases: three measured robots, and two synthetic records whose truth is known."""

from __future__ import annotations

from softcal.plugins.bench.case import Published, register_case
from softcal.plugins.bench.project_case import ProjectCase


@register_case
class Beam(ProjectCase):
    """Gravity and one weight to fit, twice that weight to predict."""

    name = "beam"
    title = "Clamped silicone beam under weights, six markers by motion capture (diffPD sim2real)"
    source = "srl-ethz/diffPD_sim2real, examples/beam/README.md"
    licence = "MIT, © 2021 Soft Robotics Lab, ETH Zürich"
    length = 0.1
    tip = "tip1"
    example = "beam"
    held_out = ("load101",)
    published = (
        Published(
            "diffPD sim2real",
            "its authors, by gradients through a simulation in time, on all three loads",
            note="E 264 kPa; errors of markers are not stated",
        ),
    )


@register_case
class Arm(ProjectCase):
    """Five pressures to fit, another one to predict."""

    name = "pneumatic-arm"
    title = "Pneumatic arm of four chambers, one under pressure, three markers by motion capture (diffPD sim2real)"
    source = "srl-ethz/diffPD_sim2real @825e7b7, python/1segment_arm"
    licence = "MIT, © 2021 Soft Robotics Lab, ETH Zürich"
    length = 0.1
    tip = "tip1"
    example = "pneumatic-arm"
    published = (
        Published(
            "diffPD sim2real",
            "its authors, of the silicone of their beam, which they use for the arm",
            note="E 264 kPa; errors of markers are not stated",
        ),
    )
    remarks = (
        "The authors' fine mesh is not in their repository: walls and hole are from remarks in their code, webs, "
        "fibres and the ends of the chambers are assumed. The states are 2.4 to 2.8 s after the start of a take; the "
        "arm creeps on. The pressure to predict is beyond those that are fitted."
    )


@register_case
class NeckCurves(ProjectCase):
    """Pulls of 20 and 40 mm to fit, 60 mm to predict; the slack of every pull is its own."""

    name = "neck"
    title = "Printed TPU neck pulled by one cable, digitised force curves (UC3M)"
    source = "AlbertoRodriguezSanz/SOFA_MOR_Force-Based_Trajectory @091e783, static/images/UTM_tests(1).png, digitised"
    licence = "page CC BY-SA 4.0"
    length = 0.1067
    example = "neck"
    held_out = ("pull_60mm",)
    remarks = (
        "Where a pull begins was not measured. So the slack of the predicted pull is fitted to that pull, by any "
        "method, and the shape and the slope of its curve are predicted."
    )


@register_case
class NeckBench(ProjectCase):
    """Three tests to fit, one to predict."""

    name = "neck-bench"
    title = "Soft neck on a testing machine with an IMU, synthetic record with noise, friction and hysteresis"
    source = "softcal, examples/neck-bench/generate.py"
    licence = "Apache-2.0"
    length = 0.1067
    example = "neck-bench"
    held_out = ("30mm_5mms",)
    published = (Published("truth", "what the record was made from", note="E 2.07 MPa, nu 0.462"),)
    remarks = (
        "The slack and the pitch's zero of the predicted test, which are its set-up's, are fitted to that test, by any "
        "method."
    )


@register_case
class ManipulatorRecord(ProjectCase):
    """Rest and four cables to fit, two cables to predict. Synthetic."""

    name = "manipulator"
    title = "Manipulator of four springs and six cables, synthetic camera record"
    source = "softcal, examples/manipulator/generate.py"
    licence = "Apache-2.0"
    length = 0.425
    tip = "marker4"
    example = "manipulator"
    held_out = ("cable3", "cable6*")
    published = (
        Published("truth", "what the record was made from", note="E 0.86, 0.70, 0.92 and 0.78 GPa, one per spring"),
    )
