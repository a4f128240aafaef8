"""Draw the finger and write it as STEP: a bar of 12 x 12 x 70 mm with a bore of 3 mm, 3 mm beside its middle."""

from pathlib import Path

import gmsh

if __name__ == "__main__":
    gmsh.initialize()
    bar = gmsh.model.occ.addBox(-6.0, -6.0, 0.0, 12.0, 12.0, 70.0)
    bore = gmsh.model.occ.addCylinder(3.0, 0.0, 0.0, 0.0, 0.0, 70.0, 1.5)
    gmsh.model.occ.cut([(3, bar)], [(3, bore)])
    gmsh.model.occ.synchronize()
    gmsh.write(str(Path(__file__).parent / "finger.step"))
    gmsh.finalize()
