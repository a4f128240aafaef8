"""A bench record of eight cycles as a testing machine and an IMU on its own clock write it, with known truth.

Crosshead: triangles to 20 mm with dwells at the bottom and at the top. Force: floor below the taut point, a loading
branch that softens over the first cycles, hysteresis, load-cell drift and noise. IMU: its clock is off and runs fast.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

RATE = 50.0  # samples a second
LAG = 3.217  # s, IMU clock ahead
CLOCK_RATE = 400e-6
SLACK = 2.5e-3  # m
TRAVEL = 20e-3  # m
STIFFNESS = 420.0  # N/m
FLOOR = 0.05  # N
HYSTERESIS = 0.06  # share of the loading force that unloading lacks
PITCH_SLOPE = 18.0  # rad/m
PITCH_DRIFT = 4e-5  # rad/s
SOFTENING = (1.10, 1.03, 1.008, 1.003, 1.001, 1.0, 1.0, 1.0)  # peak over the stable one, cycle by cycle
SPEED = 5e-3  # m/s


@dataclass(frozen=True)
class Motion:
    """Crosshead position [m], cycle (-1 at rest) and direction (+1 pulled) over the machine's time [s]."""

    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    shortening: np.ndarray = field(default_factory=lambda: np.empty(0))
    cycle: np.ndarray = field(default_factory=lambda: np.empty(0))
    direction: np.ndarray = field(default_factory=lambda: np.empty(0))


def motion(n_cycles: int = 8, *, bottom_dwell: float = 0.8, top_dwell: float = 0.5, cut: float = 0.0) -> Motion:
    """cut [s]: how much is missing at the end of the record."""
    ramp = TRAVEL / SPEED
    nodes, position, cycles = [0.0], [0.0], []
    for number in range(n_cycles):
        for span, target, label in (
            (bottom_dwell, 0.0, -1),
            (ramp, TRAVEL, number),
            (top_dwell, TRAVEL, number),
            (ramp, 0.0, number),
        ):
            nodes.append(nodes[-1] + span)
            position.append(target)
            cycles.append(label)
    nodes.append(nodes[-1] + bottom_dwell)
    position.append(0.0)
    cycles.append(-1)
    time = np.arange(0.0, nodes[-1] - cut, 1.0 / RATE)
    part = np.clip(np.searchsorted(nodes, time, side="right") - 1, 0, len(cycles) - 1)
    slope = np.sign(np.diff(position))[part]
    return Motion(time, np.interp(time, nodes, position), np.array(cycles)[part], slope)


def force(moved: Motion, noise: float = 0.02, drift: float = 5e-4, seed: int = 1) -> np.ndarray:
    """Tension at the machine [N]; drift [N/s]."""
    softening = np.array([*SOFTENING, 1.0])[np.minimum(moved.cycle, len(SOFTENING))]
    elastic = STIFFNESS * np.maximum(moved.shortening - SLACK, 0.0) * softening
    elastic = np.where(moved.direction < 0, elastic * (1.0 - HYSTERESIS), elastic)
    random = np.random.default_rng(seed)
    return FLOOR + elastic + drift * moved.time + noise * random.standard_normal(len(moved.time))


def pitch(shortening: np.ndarray, time: np.ndarray, noise: float = 5e-4, seed: int = 2) -> np.ndarray:
    random = np.random.default_rng(seed)
    clean = PITCH_SLOPE * np.maximum(shortening - SLACK, 0.0) + PITCH_DRIFT * time
    return clean + noise * random.standard_normal(len(time))


def write_instron(path: Path, moved: Motion, tension: np.ndarray) -> Path:
    """As Bluehill writes it on a German machine: ';', decimal comma, free lines, units in a row, Latin-1, kN."""

    def comma(value: float, digits: int) -> str:
        return f"{value:.{digits}f}".replace(".", ",")

    lines = ["Results Table 1", "Specimen label;Hals 1, TPU 82A", "Prüfgeschwindigkeit;5;mm/s", ""]
    lines += ["Time;Extension;Load;Cycle", "(s);(mm);(kN);"]
    for t, s, f in zip(moved.time, moved.shortening, tension, strict=True):
        lines.append(f"{comma(t, 3)};{comma(s * 1e3, 5)};{comma(f / 1e3, 7)};1")
    path.write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))
    return path


def write_imu(path: Path, moved: Motion, *, lag: float = LAG, clock_rate: float = CLOCK_RATE) -> Path:
    """Tab-separated, degrees, unit in the header; on for 4 s before and after the test, on its own clock."""
    true_time = np.arange(-4.0, moved.time[-1] + 4.0, 1.0 / 100.0)
    s = np.interp(true_time, moved.time, moved.shortening)
    middle = 0.5 * moved.time[-1]
    clock = true_time + lag + clock_rate * (true_time - middle)
    angle = np.degrees(pitch(s, true_time))
    rows = [f"{t:.4f}\t{a:.5f}\t{0.1:.3f}" for t, a in zip(clock, angle, strict=True)]
    path.write_text("\n".join(["# IMU 3DM-GX5-10", "time_s\tPitch [deg]\tRoll [deg]", *rows, ""]), encoding="utf-8")
    return path
