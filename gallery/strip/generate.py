"""Write the bench tables of the strip: its own twin at 4 MPa, with 2 % between tests, slack, and noise."""

from pathlib import Path

import numpy as np

import softcal

HERE = Path(__file__).parent
TRUE, SPREAD, SLACK = 4e6, {10: 0.99, 20: 1.02, 30: 0.99}, {10: 0.3e-3, 20: 0.6e-3, 30: 0.1e-3}

if __name__ == "__main__":
    chance = np.random.default_rng(1)
    robot = softcal.load(HERE / "project.yaml").robot
    for reach, share in SPREAD.items():
        d = 1e-3 * np.linspace(1.0, reach, 30)
        taut = softcal.Protocol({"front": softcal.Command("shortening", d - SLACK[reach])})
        seen = softcal.simulate(robot, taut, {"strip.youngs_modulus": TRUE * share}).channels
        tension = seen["front.tension"] + chance.normal(0.0, 5e-3, len(d))
        pitch = np.degrees(seen["tip.pitch"]) + chance.normal(0.0, 0.2, len(d))
        rows = [f"{1e3 * a:.3f},{b:.4f},{c:.2f}" for a, b, c in zip(d, tension, pitch, strict=True)]
        (HERE / f"pull_{reach}mm.csv").write_text("\n".join(["d [mm],T [N],pitch [deg]", *rows]) + "\n")
