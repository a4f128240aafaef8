"""The linear system of a robot's small motions about an equilibrium, with its inputs and outputs."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats, ReadOnly
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, StorageError
from softcal.mechanics.small_motions import poles_of
from softcal.regular_file import write_whole


@displayed
@dataclass(frozen=True, eq=False)
class LinearSystem(ReadOnly):
    """Small motions about an equilibrium.

    In k coordinates a, with changes u of inputs and y of outputs:

        M a'' + C a' + K a = B u,    y = C_y a + D u

    Attributes
    ----------
    commands
        Actuator -> its command at the equilibrium [SI].
    values
        Channel -> its value there [SI].
    units
        Channel, inputs among them -> its SI unit.
    inputs
        Efforts of the actuators that are commanded by these, such as `front.tension` (n_inputs,).
    channels
        The outputs: every channel (n_channels,).
    frequencies
        Frequencies of the modes without damping (n_modes,) [Hz].
    damping_ratios
        Damping ratios of each mode alone (n_modes,) [-]; above 1 it does not swing.
    frequency_errors
        Bounds of the frequencies' relative errors by the reduction (n_modes,), those of the mesh apart.
    next_frequency
        Of the first mode left out [Hz].
    mass, damping, stiffness
        M, C and K (k, k): the modes come first, then what they leave of the static responses to the inputs.
    input_matrix, output_matrix, feedthrough
        B (k, n_inputs), C_y (n_channels, k) and D (n_channels, n_inputs).
    static_error
        Largest error of the static gain against the exact derivatives of the twin, each over the channel's largest.
    parameters
        Parameters of the robot by which there are derivatives (n_parameters,).
    frequency_rates
        Derivatives of the frequencies (n_modes, n_parameters) [Hz per SI unit of the parameter], at the same commands.
    pole_rates
        Derivatives of the poles (2 k, n_parameters), complex [1/s per SI unit of the parameter].
    """

    commands: Mapping[str, float]
    values: Mapping[str, float]
    units: Mapping[str, str]
    inputs: tuple[str, ...]
    channels: tuple[str, ...]
    frequencies: Floats
    damping_ratios: Floats
    frequency_errors: Floats
    next_frequency: float
    mass: Floats
    damping: Floats
    stiffness: Floats
    input_matrix: Floats
    output_matrix: Floats
    feedthrough: Floats
    static_error: float
    parameters: tuple[str, ...]
    frequency_rates: Floats
    pole_rates: Any

    @property
    def static_gain(self) -> Floats:
        """Outputs by inputs at rest (n_channels, n_inputs)."""
        return self.output_matrix @ np.linalg.solve(self.stiffness, self.input_matrix) + self.feedthrough

    @property
    def state_matrices(self) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C and D of the states (a, a'), as python-control's `control.ss` takes them."""
        k, m = self.input_matrix.shape
        right = np.hstack([-self.stiffness, -self.damping, self.input_matrix])
        rates = np.asarray(np.linalg.solve(self.mass, right), dtype=np.float64)
        A: Floats = np.block([[np.zeros((k, k)), np.eye(k)], [rates[:, : 2 * k]]])
        B: Floats = np.vstack([np.zeros((k, m)), rates[:, 2 * k :]])
        return A, B, np.hstack([self.output_matrix, np.zeros_like(self.output_matrix)]), self.feedthrough

    @property
    def poles(self) -> Any:
        """Eigenvalues of A (2 k,), complex [1/s], the slowest first."""
        return poles_of(self.mass, self.damping, self.stiffness)[0]

    @property
    def state_space(self) -> Any:
        """The system as `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace

        return StateSpace(*self.state_matrices)

    @checked_arguments
    def save(self, path: str | Path) -> Path:
        """Write all of it as arrays by the names of the fields, with `A`, `B`, `C` and `D`, to a file `.npz`.

        Raises
        ------
        StorageError
            Where it cannot be written.
        """
        target = Path(path).with_suffix(".npz")
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        arrays |= dict(zip("ABCD", self.state_matrices, strict=True))
        names = {"inputs": self.inputs, "channels": self.channels, "parameters": self.parameters}
        arrays |= {name: np.array(each, dtype=str) for name, each in names.items()}
        arrays["channel_units"] = np.array([self.units[name] for name in self.channels])
        arrays["input_units"] = np.array([self.units[name] for name in self.inputs], dtype=str)
        arrays["values"] = np.array([self.values[name] for name in self.channels])
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        try:
            write_whole(target, buffer.getvalue())
        except OSError as error:
            raise StorageError(
                Fault("the file cannot be written", str(target), error.strerror or str(error))
            ) from error
        return target


ARRAYS = (
    "frequencies",
    "damping_ratios",
    "frequency_errors",
    "next_frequency",
    "mass",
    "damping",
    "stiffness",
    "input_matrix",
    "output_matrix",
    "feedthrough",
    "static_error",
    "frequency_rates",
    "pole_rates",
)
