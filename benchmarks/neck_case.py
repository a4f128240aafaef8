"""The published neck under one cable, as every benchmark here pulls it."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint

YOUNGS_MODULUS, POISSONS_RATIO = 2.3e6, 0.43  # [Pa], [-]: what the neck's authors found
CABLE_RADIUS = 0.05  # [m]
PULL = 0.04  # [m]
P1_TETS, P2P1_TETS = 3700, 1700
DEFAULT = Neck(tets=P1_TETS)
TENSION, PITCH = "front.tension", "plate.pitch"


def neck_robot(
    mesh: TetMesh,
    element: str,
    E: float = YOUNGS_MODULUS,
    nu: float = POISSONS_RATIO,
    shape: Neck = DEFAULT,
    cable_radius: float = CABLE_RADIUS,
) -> Robot:
    """Clamped in its socket, a rigid plate on its collar, a cable straight down from the plate; no gravity."""
    body = Body(
        "neck",
        mesh,
        fixed=mesh.node_sets["socket"],
        parameters={"youngs_modulus": E, "poissons_ratio": nu},
        element=element,
    )
    top, foot = (np.array([cable_radius, 0.0, z]) for z in (shape.height, shape.clamp_depth))
    plate = Plate("plate", {"neck": mesh.node_sets["collar"]}, reference=np.array([0.0, 0.0, shape.height]))
    return Robot((body,), (plate,), (Cable("front", (ViaPoint(top, "plate"), ViaPoint(foot))),))


def standard_robot(element: str, E: float = YOUNGS_MODULUS, nu: float = POISSONS_RATIO) -> Robot:
    """P1 on some 3.7k tets, P2P1 on some 1.7k curved ones."""
    mesh = (Neck(tets=P1_TETS, order=1) if element == "P1" else Neck(tets=P2P1_TETS)).mesh()
    return neck_robot(mesh, element, E, nu)


def pull(values: Floats) -> Protocol:
    """The front cable's shortening [m]."""
    return Protocol({"front": Command("shortening", values)})
