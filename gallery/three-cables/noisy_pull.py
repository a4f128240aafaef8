"""The noisy pull of the neck: python noisy_pull.py."""

from pathlib import Path

import numpy as np

import softcal

here, travel = Path(__file__).parent, np.linspace(0.5e-3, 12e-3, 24)
robot = softcal.with_parameters(softcal.load(here / "project.yaml").robot, {"neck.youngs_modulus": 2.3e6})
twin = softcal.simulate(robot, softcal.Protocol({"front": softcal.Command("shortening", travel)}))
force = twin.channels["front.tension"] + np.random.default_rng(2).normal(0.0, 0.3, len(travel))
rows = "\n".join(f"{1e3 * d:.3f},{F:.4f}" for d, F in zip(travel, force, strict=True))
(here / "pull.csv").write_text(f"d [mm],F [N]\n{rows}\n")
