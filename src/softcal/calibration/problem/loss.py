"""The distance of the twin from the bench, as one number, with exact gradients.

Every loss here is a sum over blocks, or the root of one, a block being one channel of one experiment, and each block's
share is a convex function of its residual. The least-squares optimiser uses just that: `square_weights` gives, for the
present residuals, the weighted squares that touch the sum from above.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.option import FAMILIES, Option, option_faults
from softcal.catalogue import Catalogue
from softcal.checks import Floats
from softcal.display import displayed
from softcal.errors import DatasetError, Fault
from softcal.sensing.channel import channel_name

# RMSE over the root mean square of the measurement up to which a channel counts as fitted exactly.
MET = 1e-6
_EXACT = 1e-9  # the same up to which residuals are rounding, and tell nothing of the noise


@dataclass(frozen=True)
class Block:
    """One channel of one experiment, or a prior, without the samples that were not measured.

    Attributes
    ----------
    experiment
        Its name; "" for a prior.
    channel
        The channel of the dataset.
    measured
        Measured values (n,) [SI].
    residual
        Predicted less measured (n,) [SI].
    sigma
        Noise [SI] of all samples, or of each (n,); 0 where unknown.
    jacobian
        d residual / d theta (n, size of the search space) [SI], or None.
    point
        The marker or plate whose position the channel is a part of; "" for any other channel.
    systematic
        Change of the residual (n, k) [SI] by one standard deviation of each uncertain parameter, or None.
    set_up
        The set-up of the experiment; "" where it is one by itself.
    drift
        The part (n,) of the record's time that has passed, where the instrument may drift and nothing is stated on it.
    unstated
        Systematic error of an instrument on which nothing is stated, by the name of its parameter, such as
        `front.tension_gain`, or `front.compliance` of the machine that pulls -> the change of the residual (n,) by one
        unit of it, and by how many units all that is read would change.
    command
        What drives the twin (n,) [SI], where that is one channel.
    """

    experiment: str
    channel: str
    measured: Floats
    residual: Floats
    sigma: float | Floats = 0.0
    jacobian: Floats | None = None
    point: str = ""
    systematic: Floats | None = None
    set_up: str = ""
    drift: Floats | None = None
    unstated: Mapping[str, tuple[Floats, float]] = field(default_factory=dict[str, tuple[Floats, float]])
    command: Floats | None = None

    @cached_property
    def grows_with_moduli(self) -> bool:
        """Whether it is proportional to moduli, as forces and the prior of a modulus are; positions and
        angles are not.
        """
        return not self.experiment or channel_name(self.channel).kind.is_force


@displayed
class Loss(ABC):
    """A loss: a sum over blocks of a convex function of the block's residual; where `rooted`, the root of that sum.

    A frozen dataclass: results are hashed with it.

    Attributes
    ----------
    name
        The `loss` of project files and results.
    uses_priors
        Whether what is known of parameters beforehand counts.
    rooted
        Whether the loss is the root of the sum.
    degree
        The power of the residuals by which it grows, 2 for a sum of squares.
    unit
        Of its value: "%", or "1" where it has none.
    needs_length
        Whether it is made with the length [m] that the rig says the robot has.
    options
        What project files can give it.
    """

    name: str
    uses_priors: bool = False
    rooted: bool = False
    degree: int = 2
    unit: ClassVar[str] = "1"
    needs_length: ClassVar[bool] = False
    options: ClassVar[tuple[Option, ...]] = ()

    @classmethod
    def made(cls, options: Mapping[str, float], length: float | None) -> Loss:
        """The loss with its options [SI by name] and, where it needs one, the length [m], as fields of these names."""
        given: dict[str, Any] = {option.name: options[option.name] for option in cls.options}
        return cls(**given, **({"length": length} if cls.needs_length else {}))

    @property
    def surrogate(self) -> Loss:
        """A smooth loss that least squares minimises until it is near the minimum; the loss itself where it has no
        kinks.
        """
        return self

    def precisions(self, block: Block, rounding: float) -> Floats:
        """One over the variance (n,) of each sample, up to a factor that all blocks have in common.

        rounding: the twin's rounding error of the channel [SI]; no noise is below it.
        """
        return self.square_weights(block, block.residual)

    def squares(self, value: float) -> float:
        """A value of the loss as a sum of squares: the square of a root."""
        return value ** (2 / self.degree)

    @abstractmethod
    def block_value(self, block: Block, residual: Floats) -> float:
        """The term of one block."""

    @abstractmethod
    def square_weights(self, block: Block, residual: Floats) -> Floats:
        """w (n,) such that d block_value = 2 (w residual) . d residual, and sum w r^2 + const >= block_value."""

    @abstractmethod
    def share(self, blocks: Sequence[Block]) -> float:
        """The factor of every block in the sum, such as one over the number of experiments."""

    def straight_along(self, block: Block, residual: Floats) -> Floats | None:
        """The unit direction (n,) in which block_value is linear; None where it curves in all.

        Half the Hessian of block_value by the residual is sqrt(W) (I - u u^T) sqrt(W), u being this direction.
        """
        return None

    def stated_noise(self, block: Block) -> Floats | None:
        """The standard deviation (n,) that the loss assumes for the samples; None where it assumes none."""
        return None

    def noise_group(self, block: Block) -> str:
        """The group of channels of one kind, such as every marker's x, whose noise has one size."""
        return channel_name(block.channel).kind.name

    @abstractmethod
    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        """Faults of experiments that this loss cannot judge."""


class SumOfSquares(Loss):
    """A loss sum w r^2 over all blocks, w being `square_weights`."""

    def block_value(self, block: Block, residual: Floats) -> float:
        return float(residual**2 @ self.square_weights(block, residual))

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        return []


def _faults(loss: type[Loss], known: Mapping[str, type[Loss]]) -> list[Fault]:
    """Faults of a class that is to be registered: missing members, and options that other classes have."""
    if not (isinstance(loss, type) and issubclass(loss, Loss)):
        return [Fault("this is not a loss", "loss", repr(loss)[:60], "a subclass of softcal.Loss")]
    where = f"loss {loss.__name__}"
    missing = [*(() if hasattr(loss, "name") else ("name",)), *sorted(loss.__abstractmethods__)]
    faults = [Fault("the loss lacks something", where, allowed=f"'{name}' must be there") for name in missing]
    return [*faults, *option_faults(loss, "loss", where, known)]


LOSSES: Catalogue[type[Loss]] = Catalogue("loss", "softcal.losses", _faults, home="softcal.calibration.problem.losses")

FAMILIES["loss"] = LOSSES
register_loss = LOSSES.registrar(
    "register_loss", "Add a loss: project files, results and reports then accept its name."
)


def total(loss: Loss, blocks: Sequence[Block]) -> float:
    """The joint loss."""
    summed = loss.share(blocks) * sum(loss.block_value(block, block.residual) for block in blocks)
    return math.sqrt(summed) if loss.rooted else summed


def gradient(loss: Loss, blocks: Sequence[Block]) -> Floats:
    """d total / d theta, shape (size of the search space,); every block must have its jacobian."""
    parts = [
        2 * (loss.square_weights(block, block.residual) * block.residual) @ block.jacobian
        for block in blocks
        if block.jacobian is not None
    ]
    summed = loss.share(blocks) * np.sum(parts, axis=0)
    # Where all is fitted exactly the root has no gradient, only a kink.
    return summed / (2 * max(total(loss, blocks), 1e-300)) if loss.rooted else summed


def by_experiment(loss: Loss, blocks: Sequence[Block]) -> dict[str, float]:
    """Each experiment's loss, taken alone."""
    own: dict[str, list[Block]] = {}
    for block in blocks:
        if block.experiment:
            own.setdefault(block.experiment, []).append(block)
    return {experiment: total(loss, held) for experiment, held in own.items()}


def errors_by_point(blocks: Sequence[Block]) -> dict[str, dict[str, float]]:
    """Experiment -> marker, plate or channel -> root mean square of the distance [m] or the error [SI].

    A position of which not all three coordinates are compared is reported by coordinate.
    """
    counts = Counter((block.experiment, block.point) for block in blocks)
    found: dict[str, dict[str, list[Floats]]] = {}
    for block in blocks:
        if block.experiment:
            alone = counts[block.experiment, block.point] < 3
            name = block.channel if alone or not block.point else block.point
            found.setdefault(block.experiment, {}).setdefault(name, []).append(block.residual)
    return {
        experiment: {name: rms(np.sqrt(np.sum(np.square(parts), axis=0))) for name, parts in held.items()}
        for experiment, held in found.items()
    }


def require(loss: Loss, experiments: Sequence[Experiment]) -> None:
    """Check that the experiments can be judged.

    Raises
    ------
    DatasetError
        For a channel without a weight or a noise; all faults at once.
    """
    faults = loss.faults(experiments)
    if faults:
        raise DatasetError(faults)


def fitted_exactly(loss: Loss, blocks: Sequence[Block]) -> list[Block]:
    """The channels of experiments whose residuals are rounding, while no noise is stated: theirs is not known."""
    return [
        one
        for one in blocks
        if one.experiment and loss.stated_noise(one) is None and rms(one.residual) <= _EXACT * rms(one.measured)
    ]


def rms(values: Floats) -> float:
    """Root mean square."""
    return math.sqrt(float(values @ values) / len(values))


def rms_detrended(values: Floats) -> float:
    """Root mean square after removal of the best straight line over the samples."""
    position = np.linspace(-1.0, 1.0, len(values)) if len(values) > 1 else np.zeros(1)
    centred = values - values.mean()
    span = float(position @ position)
    return rms(centred - position * (float(position @ centred) / span if span > 0 else 0.0))
