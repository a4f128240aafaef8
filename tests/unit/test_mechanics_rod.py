"""Building rods, and what the parts of an element give by themselves."""

import numpy as np
import pytest
from rod_cases import at_rest, modulus, on_own_frames
from scipy.spatial.transform import Rotation

from softcal.errors import MeshError
from softcal.geometry.centreline import Centreline, helix, straight
from softcal.geometry.section import RoundBar
from softcal.mechanics import rotation_kernels
from softcal.mechanics.rod import build_rod

THETA = modulus(1e6, 0.3)
LINE = straight((0, 0, 0), (0, 0, 1), 4)


def test_elements_within_one_frame_are_left_out():
    """A disc holds the middle nodes: what is inside it cannot deform."""
    references = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.4], [0.0, 0.0, 1.0]])
    rod = build_rod("rod", RoundBar(0.1), LINE, [0, 1, 1, 1, 2], references)
    assert rod.frames.tolist() == [[0, 1], [1, 2]]
    assert rod.arm[:, 1] == pytest.approx(np.array([[-0.1, 0.0, -0.15], [0.0, 0.0, 0.0]]))
    assert rod.length == pytest.approx([0.25, 0.25])


@pytest.mark.parametrize(
    ("frames", "n_frames", "message"),
    [
        ([0, 1, 2, 3], 5, "rod: the frames of a rod's nodes do not fit"),
        ([0, 1, 2, 3, 5], 5, "from 0 to 5.*from 0 to 4"),
        ([0, 1, 2, 3, -1], 5, "do not fit"),
        ([1, 1, 1, 1, 1], 5, "are attached to one frame"),
    ],
)
def test_frames_that_do_not_fit_are_refused(frames, n_frames, message):
    with pytest.raises(MeshError, match=message):
        build_rod("rod", RoundBar(0.1), LINE, frames, np.zeros((n_frames, 3)))


def test_too_few_elements_around_a_coil_are_refused():
    def coil(n):
        return helix((0, 0, 0), (0, 0, 1), diameter=1.0, pitch=0.1, turns=1.0, at=n)

    on_own_frames(RoundBar(0.1), coil(4))
    fine = coil(6)
    with pytest.raises(MeshError, match=r"turns too much .* more elements"):
        on_own_frames(RoundBar(0.1), Centreline(fine.nodes[::2], fine.triads[::2], fine.lengths[::2] * 2.0))
    with pytest.raises(MeshError, match="a helix is too coarse for its turns; got 3 elements in a turn"):
        coil(3)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 0.3, 0.999999, 1.000001, 2.0, 3.1, np.pi - 1e-9, np.pi])
def test_rotation_vector_at_any_angle(angle):
    rng = np.random.default_rng(0)
    for axis in [*np.eye(3), *rng.normal(size=(20, 3))]:
        theta = angle * axis / np.linalg.norm(axis)
        out = np.empty(3)
        rotation_kernels.rotation_vector(Rotation.from_rotvec(theta).as_matrix(), out)
        error = min(np.abs(out - theta).max(), np.abs(out + theta).max() if angle > 3.14 else np.inf)
        assert error < 4e-15 * max(1.0, angle) if angle < 3.0 else error < 1e-8


def test_coefficients_meet_where_series_and_closed_form_do():
    below, above = (rotation_kernels.coefficients(np.array([x, 0.0, 0.0])) for x in (1.0 - 1e-12, 1.0 + 1e-12))
    assert below == pytest.approx(above, rel=1e-11)
    x, h = 1.7, 1e-5
    middle, plus, minus = (rotation_kernels.coefficients(np.array([y, 0.0, 0.0])) for y in (x, x + h, x - h))
    assert middle[0] == pytest.approx((1.0 - x / 2 / np.tan(x / 2)) / x**2, rel=1e-14)
    assert middle[1] == pytest.approx((plus[0] - minus[0]) / (2 * h) / x, rel=1e-9)
    assert middle[2] == pytest.approx((plus[1] - minus[1]) / (2 * h) / x, rel=1e-9)


def test_turn_is_the_angle_between_neighbours():
    rod, pose = on_own_frames(RoundBar(0.1), LINE)
    R = Rotation.from_rotvec([[0, 0, 0], [0.3, 0, 0], [2.0, 0, 0], [2.0, 0, 0], [2.0, 0.1, 0]]).as_matrix()
    assert rod._coordinates(pose.c, R)[1][:3] == pytest.approx([0.3, 1.7, 0.0], abs=1e-12)


def test_forces_in_a_bar_pulled_bent_and_twisted():
    """Force and moment of the later end on each element, in the world's axes, and the strains that make them."""
    rod, pose = on_own_frames(RoundBar(0.1), LINE)
    section = RoundBar(0.1)
    E, G = 1e6, 1e6 / 2.6

    def at_later_ends(c: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        gradient = rod.assemble(c, R, THETA).gradient
        return rod.strains(c, R), gradient[:, 6:9], gradient[:, 9:]

    strain, force, _ = at_later_ends(1.01 * pose.c, pose.R)
    assert strain[:, :3] == pytest.approx(np.tile([0.0, 0.0, 0.01], (4, 1)), abs=1e-14)
    assert force == pytest.approx(np.tile([0.0, 0.0, 0.01 * E * section.constants.area], (4, 1)), abs=1e-8)
    twist = Rotation.from_rotvec(np.outer(pose.c[:, 2], [0, 0, 2.0])).as_matrix()
    strain, _, moment = at_later_ends(pose.c, twist)
    assert strain[:, 3:] == pytest.approx(np.tile([0.0, 0.0, 2.0], (4, 1)), abs=1e-14)
    assert moment == pytest.approx(np.tile([0.0, 0.0, 2.0 * G * section.constants.J], (4, 1)), abs=1e-8)
    z = pose.c[:, 2]  # an arc in the x-z plane of radius 1, about y
    arc = at_rest(np.stack([1.0 - np.cos(z), 0 * z, np.sin(z)], axis=1)).c
    _, force, moment = at_later_ends(arc, Rotation.from_rotvec(np.outer(z, [0, 1.0, 0])).as_matrix())
    assert moment == pytest.approx(np.tile([0.0, E * section.constants.I1, 0.0], (4, 1)), abs=1e-8)
    assert force == pytest.approx(np.zeros((4, 3)), abs=1e-8)
