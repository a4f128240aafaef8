"""Steps an exported scene through its schedule; by SOFA's own Python, in the scene's folder, with SECONDS to go.

Prints JSON: steps, seconds of wall time for them, and the front cable's tension [N] at the end.
"""

import json
import os
import sys
import time

sys.path.insert(0, os.getcwd())

import Sofa
import Sofa.Core
import Sofa.Simulation
from robot_state import read_state
from scene import createScene, read_parameters


def main() -> None:
    root = Sofa.Core.Node("root")
    createScene(root, seen=False)
    getattr(Sofa.Simulation, "initRoot", Sofa.Simulation.init)(root)
    dt = float(root.dt.value)
    n = round(float(sys.argv[1]) / dt)
    began = time.perf_counter()
    for _ in range(n):
        Sofa.Simulation.animate(root, dt)
    seconds = time.perf_counter() - began
    state = read_state(root.pulling.parts, read_parameters(), dt)
    print(json.dumps({"steps": n, "seconds": seconds, "tension": state["cables"]["front"]["tension"]}))


if __name__ == "__main__":
    main()
