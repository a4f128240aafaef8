"""Two and three driven cables: symmetry, agreement with one, slack cables found slack."""

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, mirrored_box, pulled, side_cable

from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate


def commands(**values):
    """cable=("tension" or "shortening", [values])."""
    return Protocol({name: Command(control, np.array(v, dtype=float)) for name, (control, v) in values.items()})


FRONT, BACK = side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0))
ROUND = [side_cable(name, (0.05 * np.cos(a), 0.05 * np.sin(a))) for name, a in zip("abc", np.radians([90, 210, 330]))]
LEFT, INNER = side_cable("left", (0.0, 0.05)), side_cable("inner", (0.025, 0.0))


def column(*cables, **options):
    mesh = mirrored_box((0.03, 0.03, 0.1), (1, 2, 5))
    return column_robot("P1", mesh=mesh, parameters=elastic(0.6e6, 0.43), cables=cables, **options)


@pytest.mark.parametrize("control", ["shortening", "tension"])
def test_symmetric_pull_keeps_the_column_straight(control):
    values = [0.001, 0.003] if control == "shortening" else [2.0, 5.0]
    response = simulate(column(FRONT, BACK), commands(front=(control, values), back=(control, values)))
    assert response.succeeded, response.status
    c = response.channels
    np.testing.assert_allclose(c["back.tension"], c["front.tension"], rtol=1e-7)
    np.testing.assert_allclose(c["back.shortening"], c["front.shortening"], rtol=1e-7)
    assert np.abs(c["plate.pitch"]).max() < 1e-8
    assert np.abs(c["plate.x"]).max() < 1e-9
    assert np.all(c["plate.z"] < 0.1 - 1e-4)
    assert np.all(c["front.tension"] > 1.0)


def test_mirrored_pulls_give_mirrored_poses():
    robot = column(FRONT, BACK, LEFT)
    one = simulate(
        robot, commands(front=("tension", [0.5, 1.5]), back=("tension", [0.2, 0.4]), left=("tension", [0.3, 0.3]))
    )
    two = simulate(
        robot, commands(back=("tension", [0.5, 1.5]), front=("tension", [0.2, 0.4]), left=("tension", [0.3, 0.3]))
    )
    assert np.abs(one.channels["plate.pitch"]).min() > 0.01
    for key, sign in {"x": -1, "y": 1, "z": 1, "pitch": -1, "roll": 1, "yaw": -1}.items():
        np.testing.assert_allclose(
            two.channels[f"plate.{key}"], sign * one.channels[f"plate.{key}"], rtol=1e-6, atol=1e-10
        )


def test_second_cable_paid_out_changes_nothing():
    d = np.array([0.005, 0.015, 0.03, 0.01])
    alone = simulate(column(FRONT, BACK), pulled(*d), curve_tolerance=0.0)
    both = simulate(column(FRONT, BACK), commands(front=("shortening", d), back=("shortening", [-0.08] * 4)))
    assert both.succeeded, both.status
    np.testing.assert_array_equal(both.channels["back.tension"], 0.0)
    np.testing.assert_allclose(both.channels["back.shortening"], -0.08)
    for name in ("front.tension", "plate.pitch", "plate.x", "plate.z"):
        np.testing.assert_allclose(both.channels[name], alone.channels[name], rtol=1e-7, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("seed", [2, 3])
def test_taut_or_slack_is_found_at_every_sample(seed):
    """Each cable is taut with a tension, or longer than it need be without one; seed 3 leaps from 47 N to slack."""
    rng = np.random.default_rng(seed)
    d = {name: rng.uniform(-0.02, 0.03, 12) for name in "abc"}
    response = simulate(
        column(*ROUND, mass=0.05), commands(**{name: ("shortening", v) for name, v in d.items()}), snapshots=True
    )
    assert response.succeeded, response.status
    n_slack = 0
    for i, shot in enumerate(response.snapshots):
        for name, values in d.items():
            length = np.linalg.norm(np.diff(shot.routes[name], axis=0), axis=1).sum()
            allowed = 0.1 - values[i]
            tension = response.channels[f"{name}.tension"][i]
            assert tension >= 0.0
            if tension > 0.0:
                assert length == pytest.approx(allowed, abs=1e-9)
            else:
                n_slack += 1
                assert length <= allowed + 1e-9
    assert 3 < n_slack < 33  # both kinds occur


def test_inner_cable_goes_slack_as_the_outer_pulls():
    d = np.linspace(0.0, 0.03, 6)
    response = simulate(column(FRONT, INNER), commands(front=("shortening", d), inner=("shortening", 0.4 * d)))
    assert response.succeeded, response.status
    assert response.channels["inner.tension"][-1] == 0.0
    assert response.channels["front.tension"][-1] > 0.1


def test_history_does_not_matter():
    """The last sample reached by two ways, through slack and taut states."""
    robot = column(FRONT, BACK, LEFT)
    last = {"front": 0.02, "back": -0.005, "left": 0.006}
    ways = (
        {"front": [0.01, 0.02], "back": [0.004, -0.005], "left": [-0.01, 0.006]},
        {"front": [-0.01, 0.0, 0.02], "back": [0.01, 0.01, -0.005], "left": [0.01, 0.02, 0.006]},
    )
    ends = []
    for way in ways:
        assert all(way[name][-1] == value for name, value in last.items())
        response = simulate(robot, commands(**{name: ("shortening", v) for name, v in way.items()}))
        assert response.succeeded, response.status
        ends.append({name: values[-1] for name, values in response.channels.items()})
    for name, value in ends[0].items():
        assert ends[1][name] == pytest.approx(value, rel=1e-6, abs=1e-9), name


def test_tension_by_many_equals_tension_by_one_where_the_other_is_small():
    T = np.array([0.5, 1.0, 2.0])
    one = simulate(column(FRONT, BACK), Protocol({"front": Command("tension", T)}), curve_tolerance=0.0)
    two = simulate(column(FRONT, BACK), commands(front=("tension", T), back=("tension", [1e-9] * 3)))
    for name in ("front.shortening", "plate.pitch", "plate.x"):
        np.testing.assert_allclose(two.channels[name], one.channels[name], rtol=1e-6)


MIDDLE = side_cable("middle", (0.0, 0.0))


@pytest.mark.parametrize(
    "shortenings",
    [
        pytest.param((0.002, 0.002, 0.002), id="lengths that fit together leave the tensions open"),
        pytest.param((0.004, 0.0, 0.002), id="bent"),
        pytest.param((0.001, 0.001, 0.003), id="lengths that do not fit together"),
    ],
)
def test_parallel_cables_whose_lengths_follow_from_each_other_are_named(shortenings):
    """Three in one plane on a plate: two lengths give the third. The fourth cable is beside that plane."""
    d = dict(zip(("front", "back", "middle"), shortenings, strict=True))
    robot = column(FRONT, BACK, MIDDLE, LEFT)
    response = simulate(robot, commands(**{n: ("shortening", [v]) for n, v in d.items()}, left=("shortening", [0.001])))
    assert not response.succeeded
    assert "The shortenings of front, back and middle depend on each other" in response.status
    where, why = response.status.split(": ", maxsplit=1)
    assert where.endswith("left 1 mm)")
    assert "left" not in why
    assert response.status.endswith("Drive one of them by its tension, or not at all.")
    one_by_tension = {n: ("shortening", [v]) for n, v in d.items() if n != "middle"} | {"middle": ("tension", [0.5])}
    assert simulate(robot, commands(**one_by_tension)).succeeded


def test_a_tension_of_zero_has_the_derivative_of_a_pull():
    """Alone, beside others, or with them all zero: it is slack to one side only."""
    robot, names = column(FRONT, BACK), ["front.tension", "plate.mass"]
    alone = simulate(robot, commands(front=("tension", [0.0])), sensitivities=names)
    many = simulate(robot, commands(front=("tension", [0.0, 0.2])), sensitivities=names, curve_tolerance=0.0)
    both = simulate(robot, commands(front=("tension", [0.0]), back=("tension", [0.0])), sensitivities=names)
    step = simulate(robot, commands(front=("tension", [0.0, 1e-3])), curve_tolerance=0.0)
    for channel in ("plate.x", "plate.z", "front.shortening"):
        slope = np.diff(step.channels[channel])[0] / 1e-3
        for one in (alone, many, both):
            assert one.sensitivities[channel]["front.tension"][0] == pytest.approx(slope, rel=1e-3), channel
    assert alone.sensitivities["front.tension"]["front.tension"] == [1.0]
