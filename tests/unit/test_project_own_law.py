"""A law in the project file, by the text of its energy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project

from softcal import load
from softcal.errors import ProjectFileError
from softcal.materials.catalogue import LAWS
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

LAW = """\
laws:
  stiffening:
    energy: mu/(2*b)*(exp(b*(I1_bar - 3)) - 1)
    constants: {mu: modulus, b: positive ratio, kappa: modulus}
robot:
"""
OWN = "      law: stiffening\n      mu: 0.7 MPa\n      b: 2\n      kappa: 4 MPa\n"
CONSTANTS = "      youngs_modulus: 2 MPa\n      poissons_ratio: 0.42\n"
FREE = "  bar.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}\n"
CHANGES = (
    ("robot:\n", LAW),
    (CONSTANTS, OWN),
    (FREE, "  bar.mu: {bounds: [0.1 MPa, 4 MPa], scale: log}\n  bar.b: {bounds: [0.001, 2], scale: log}\n"),
)


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    yield
    LAWS.remove("stiffening")


def test_it_is_used_as_any_other(tmp_path: Path) -> None:
    project = load(write_project(tmp_path, *CHANGES))
    law = LAWS["stiffening"]
    assert law.shear_modulus({"mu": 7e5, "b": 2.0, "kappa": 4e6}) == pytest.approx(7e5, rel=1e-12)
    assert project.space is not None
    assert {one.name for one in project.space.parameters} >= {"bar.mu", "bar.b"}
    pull = Protocol({"front": Command("shortening", np.array([0.0, 0.01]))})
    own = simulate(project.robot, pull).channels["front.tension"]
    neo = write_project(
        tmp_path / "neo",
        (CONSTANTS, "      law: yeoh\n      C10: 0.35 MPa\n      bulk_modulus: 4 MPa\n"),
        (FREE, "  bar.C10: {bounds: [0.1 MPa, 4 MPa], scale: log}\n"),
    )
    soft = simulate(load(neo).robot, pull).channels["front.tension"]
    assert own[1] == pytest.approx(soft[1], rel=0.02)
    assert own[1] > soft[1] * (1.0 + 1e-4)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("exp(b*(I1_bar - 3)) - 1", "open('x')"), r"laws\.stiffening: .*there is no such function"),
        (("- 3)) - 1", "- 2)) - 1"), r"laws\.stiffening\.energy: the energy at rest is not zero"),
        (
            ("exp(b*(I1_bar - 3)) - 1", "J - 1"),
            r"energy: the (law is not free|shear modulus at rest)",
        ),
        (("mu/(2*b)", "mu/b*(J - 1) + mu/(2*b)"), r"laws\.stiffening\.energy: the law is not free of stress at rest"),
        (("b: positive ratio", "b: length"), r"laws\.stiffening\.constants\.b: a constant cannot be of this kind"),
        (("mu/(2*b)", "-mu/(2*b)"), r"laws\.stiffening\.energy: the shear modulus at rest is not above zero"),
        (("mu/(2*b)", "nu/(2*b)"), r"the law has no such symbol; got 'nu'"),
        (("    energy:", "    enrgy:"), r"laws\.stiffening\.enrgy: unknown key"),
        (("  stiffening:", "  yeoh:"), r"laws\.yeoh: .*another law of this name"),
    ],
)
def test_what_is_wrong_with_it_is_said_at_its_place(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    assert change[0] in LAW
    changed = (("robot:\n", LAW.replace(*change)), *CHANGES[1:])
    with pytest.raises(ProjectFileError, match=told):
        load(write_project(tmp_path, *changed))
    assert "stiffening" not in LAWS  # so that it can be mended and read again
