"""What every loss promises, as checks on one: by finite differences, on the benches that it can judge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block, Loss, by_experiment, gradient, total
from softcal.experiments.dataset import Channel, Dataset

LENGTH = 0.4  # [m]
N, N_PARAMETERS = 5, 3
CHANNELS = {"tension": ("N", 0.2), "pitch": ("rad", 0.01)}


def loss_of(loss: type[Loss]) -> Loss:
    """The loss as a project file makes it that says no more than its name."""
    return loss.made({option.name: option.default for option in loss.options}, LENGTH if loss.needs_length else None)


def benches() -> list[Experiment]:
    """A pull as in paper A, and places of a marker as in paper B."""
    rng = np.random.default_rng(3)
    pulled = {"shortening": Channel(np.linspace(1e-3, 5e-3, N), "m")}
    pulled |= {name: Channel(1.0 + rng.random(N), unit, sigma) for name, (unit, sigma) in CHANNELS.items()}
    placed = {f"m1.{axis}": Channel(0.1 + 0.01 * rng.random(N), "m", 1e-3) for axis in "xyz"}
    return [
        Experiment("pull", Dataset("pull", pulled), cable="front", plate="plate"),
        Experiment("places", Dataset("places", placed), drive=(), compared=tuple(placed)),
    ]


def judged(loss: Loss) -> list[list[Block]]:
    """Blocks of each bench that the loss can judge, two experiments of it, with residuals of the size of the noise."""
    rng = np.random.default_rng(4)
    found: list[list[Block]] = []
    for bench in (bench for bench in benches() if not loss.faults([bench])):
        blocks: list[Block] = []
        for name in ("a", "b"):
            for channel in bench.compared:
                sigma = np.asarray(bench.sigma(channel)) * np.ones(N)
                jacobian = 3 * sigma[0] * rng.standard_normal((N, N_PARAMETERS))
                values = bench.dataset.values(channel)
                residual = sigma * rng.standard_normal(N)
                blocks.append(Block(name, channel, values, residual, sigma, jacobian, bench.point_of(channel)))
        found.append(blocks)
    assert found, f"no bench here is one for the loss '{loss.name}'"
    return found


def check_value(loss: Loss) -> None:
    for blocks in judged(loss):
        assert total(loss, blocks) > 0.0
        assert total(loss, [replace(b, residual=0 * b.residual) for b in blocks]) == 0.0
        larger = total(loss, [replace(b, residual=2 * b.residual) for b in blocks])
        assert_allclose(larger, 2.0**loss.degree * total(loss, blocks), rtol=1e-12)
        assert_allclose(loss.squares(larger), 4 * loss.squares(total(loss, blocks)), rtol=1e-12)
        assert set(by_experiment(loss, blocks)) == {"a", "b"}
        assert loss.unit in ("1", "%")


def check_gradient(loss: Loss) -> None:
    for blocks in judged(loss):
        exact = gradient(loss, blocks)
        for j in range(N_PARAMETERS):
            above, below = (
                total(loss, [replace(b, residual=b.residual + s * b.jacobian[:, j]) for b in blocks])
                for s in (1e-5, -1e-5)
            )
            assert_allclose((above - below) / 2e-5, exact[j], rtol=1e-6, atol=1e-8 * np.abs(exact).max())


def check_gauss_newton(loss: Loss) -> None:
    """Half the Hessian of each block's term by its residual is sqrt(W) (I - u u^T) sqrt(W)."""
    for block in (block for blocks in judged(loss) for block in blocks):
        r, step = block.residual, 1e-4 * np.asarray(block.sigma)[0]

        def slope(at: np.ndarray, block: Block = block) -> np.ndarray:
            return 2 * loss.square_weights(replace(block, residual=at), at) * at

        steps = step * np.eye(N)
        by_value = [(loss.block_value(block, r + s) - loss.block_value(block, r - s)) / (2 * step) for s in steps]
        assert_allclose(by_value, slope(r), rtol=1e-6, atol=1e-8 * np.abs(slope(r)).max())
        hessian = np.array([(slope(r + s) - slope(r - s)) / (2 * step) for s in steps])
        weights, along = loss.square_weights(block, r), loss.straight_along(block, r)
        inner = np.eye(N) if along is None else np.eye(N) - np.outer(along, along)
        root = np.sqrt(weights)
        assert_allclose(hessian / 2, root[:, None] * inner * root, atol=1e-5 * weights.max())


def check_majorant(loss: Loss) -> None:
    """The weighted squares touch the term where they were taken, and lie above it elsewhere."""
    rng = np.random.default_rng(5)
    for block in (block for blocks in judged(loss) for block in blocks):
        r = block.residual
        weights = loss.square_weights(block, r)
        for other in (2 * r, 0.1 * r, *(np.abs(r).max() * rng.standard_normal((20, N)))):
            above = loss.block_value(block, r) + weights @ (other**2 - r**2)
            assert above >= loss.block_value(block, other) - 1e-9 * abs(above)


def check_order(loss: Loss) -> None:
    """Neither the order of samples nor that of channels and experiments is told apart."""
    order = np.random.default_rng(6).permutation(N)
    for blocks in judged(loss):
        shuffled = [
            replace(
                b,
                measured=b.measured[order],
                residual=b.residual[order],
                sigma=np.asarray(b.sigma)[order],
                jacobian=None if b.jacobian is None else b.jacobian[order],
            )
            for b in reversed(blocks)
        ]
        assert_allclose(total(loss, shuffled), total(loss, blocks), rtol=1e-12)
        assert_allclose(gradient(loss, shuffled), gradient(loss, blocks), rtol=1e-9)
        for block, other in zip(blocks, reversed(shuffled), strict=True):
            assert_allclose(loss.precisions(other, 1e-9), loss.precisions(block, 1e-9)[order], rtol=1e-12)


def check_search(loss: Loss) -> None:
    """A search goes by what is smooth and least where the loss is; what is met exactly is not known infinitely well."""
    smooth = loss.surrogate
    for blocks in judged(loss):
        assert total(smooth, [replace(b, residual=0 * b.residual) for b in blocks]) == 0.0
        for block in blocks:
            assert smooth.straight_along(block, block.residual) is None
            met = replace(block, residual=0 * block.residual)
            known = loss.precisions(met, 1e-9)
            assert np.isfinite(known).all()
            assert (known > 0).all()
            assert np.isfinite(loss.square_weights(met, met.residual)).all()


CHECKS = (check_value, check_gradient, check_gauss_newton, check_majorant, check_order, check_search)
