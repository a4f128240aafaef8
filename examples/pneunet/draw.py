"""Draw the actuator of this example again: four bellows over a flat base, a channel between them, an inlet at the foot.

python draw.py --out runs/pneunet.step         a second; needs Gmsh
"""

from __future__ import annotations

import argparse
from pathlib import Path

HERE = Path(__file__).parent
# [mm]: the base, and above it bellows of this pitch, walls and gaps.
WIDTH, BASE, HEIGHT, PITCH, GAP, WALL, FOOT, N = 18.0, 3.0, 18.0, 12.0, 3.0, 2.5, 8.0, 4
CHANNEL = 3.0  # height and width of the channel that joins the chambers, on top of the base


def main() -> None:
    """Write the STEP file."""
    import gmsh

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "runs" / "pneunet.step")
    out = parser.parse_args().out
    out.parent.mkdir(parents=True, exist_ok=True)
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    length, low = FOOT + N * PITCH, -0.5 * WIDTH

    def box(x: float, y: float, z: float, dx: float, dy: float, dz: float) -> tuple[int, int]:
        return 3, occ.addBox(x, y, z, dx, dy, dz)

    # The axis is z, from the foot up; x points from the base to the bellows.
    blocks = [box(0, low, 0, BASE + CHANNEL + WALL, WIDTH, length), box(0, low, 0, HEIGHT, WIDTH, FOOT)]
    blocks += [box(0, low, FOOT + k * PITCH, HEIGHT, WIDTH, PITCH - GAP) for k in range(N)]
    outer, _ = occ.fuse(blocks[:1], blocks[1:])
    inner = [box(BASE, -0.5 * CHANNEL, -1, CHANNEL, CHANNEL, length - WALL - GAP + 1 - WALL)]
    inner += [
        box(BASE, low + WALL, FOOT + k * PITCH + WALL, HEIGHT - BASE - WALL, WIDTH - 2 * WALL, PITCH - GAP - 2 * WALL)
        for k in range(N)
    ]
    occ.cut(outer, occ.fuse(inner[:1], inner[1:])[0])
    occ.synchronize()
    gmsh.write(str(out))
    gmsh.finalize()


if __name__ == "__main__":
    main()
