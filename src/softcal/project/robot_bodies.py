"""From a project's `bodies` to Bodies: meshes made and placed, regions selected, materials checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Ints
from softcal.geometry.mesh import TetMesh
from softcal.geometry.placement import Placement, placed_mesh
from softcal.geometry.primitives import Primitive
from softcal.geometry.quality import MeshReport, check_quality, require_sound
from softcal.geometry.regions import Named, select_elements, select_faces, select_nodes
from softcal.geometry.shape import BodyShape, PrimitiveShape
from softcal.project.document import Findings, KeyPath
from softcal.project.robot_schema import BodySection
from softcal.quantities import QUANTITIES
from softcal.twin.clamp import clamp_zone
from softcal.twin.material import Material
from softcal.twin.parameters import out_of_range, robot_parameters
from softcal.twin.robot import Body, Robot

# Makes the mesh of a body from its section; the project determines the folders of files.
MeshMaker = Callable[[str, BodySection], TetMesh]


@dataclass
class BuiltBodies:
    """The bodies built so far, by name.

    sections: as written, with or without faults; made: meshes before their placement; meshes: placed; regions: name ->
    node numbers.
    """

    sections: Mapping[str, BodySection]
    made: dict[str, TetMesh] = field(default_factory=dict[str, TetMesh])
    meshes: dict[str, TetMesh] = field(default_factory=dict[str, TetMesh])
    qualities: dict[str, MeshReport] = field(default_factory=dict[str, MeshReport])
    regions: dict[str, dict[str, Ints]] = field(default_factory=dict[str, dict[str, Ints]])
    bodies: list[Body] = field(default_factory=list[Body])

    def nodes(self, body: str, region: str, path: KeyPath, findings: Findings) -> Ints | None:
        """Nodes (n,) of a body's region; None with a fault, which is recorded, or without a mesh.

        Parameters
        ----------
        body
            Name of the body.
        region
            Name of the region.
        path
            Key path of the section in the file, for faults.
        findings
            Collects the faults and warnings.
        """
        if body not in self.meshes:
            return None
        if region in self.regions[body]:
            return self.regions[body][region]
        known = self.known_regions(body)
        if region not in known:
            findings.unknown(path, "region", region, known)
        elif region not in self.sections[body].regions:  # else its own fault is on record
            with findings.at(path):
                return select_nodes(self.meshes[body], Named(region))
        return None

    def known_regions(self, body: str) -> list[str]:
        """The regions that the project defines, and the groups of the mesh file."""
        mesh = self.meshes[body]
        names = (*self.sections[body].regions, *mesh.node_sets, *mesh.face_sets, *mesh.element_sets)
        return list(dict.fromkeys(names))

    def faces(self, body: str, region: str, at_body: KeyPath, at_region: KeyPath, findings: Findings) -> Ints | None:
        """Triangles (n, 3 or 6) of a body's region; None with a fault, which is recorded.

        Parameters
        ----------
        body, region
            Their names.
        at_body, at_region
            Key paths of these in the file, for faults.
        findings
            Collects the faults and warnings.
        """
        if body not in self.sections:
            findings.unknown(at_body, "body", body, self.sections)
        elif body in self.meshes:
            regions = self.sections[body].regions
            if region not in self.known_regions(body):
                findings.unknown(at_region, "region", region, self.known_regions(body))
                return None
            chosen = regions[region].region if region in regions else Named(region)
            with findings.at(at_region):
                return select_faces(self.made[body], chosen)
        return None


def build_bodies(sections: Mapping[str, BodySection], make_mesh: MeshMaker, findings: Findings) -> BuiltBodies:
    """Every body without a fault; faults go to `findings`.

    Parameters
    ----------
    sections
        Section of each body.
    make_mesh
        Makes the mesh [m] of a body by its name and section.
    findings
        Collects the faults and warnings.
    """
    built, shapes = BuiltBodies(sections), dict[str, BodyShape]()
    for name, body in sections.items():
        path = ("robot", "bodies", name)
        with findings.at((*path, "mesh")):
            mesh = make_mesh(name, body)
            built.made[name] = built.meshes[name] = mesh
            extent = float(np.ptp(mesh.points, axis=0).max())
            QUANTITIES["extent of a mesh"].checked(extent)
            built.qualities[name] = require_sound(mesh)
        if name not in built.made:
            continue
        built.regions[name] = {}
        for key, section in body.regions.items():  # before the body's placement, in its own frame
            with findings.at((*path, "regions", key)):
                built.regions[name][key] = select_nodes(built.made[name], section.region)
        if body.placement is not None:
            with findings.at((*path, "placement")):
                built.meshes[name] = placed_mesh(built.made[name], body.placement.pose)
                if name in built.qualities:
                    built.qualities[name] = check_quality(built.meshes[name])
        found = [built.nodes(name, region, (*path, "fixed"), findings) for region in body.fixed]
        held = [np.empty(0, dtype=np.int64), *(nodes for nodes in found if nodes is not None)]
        fixed = np.unique(np.concatenate(held))
        mesh, clamp = built.meshes[name], None
        if name in built.qualities:
            quality = built.qualities[name]
            # Slivers with all nodes fixed do not deform.
            slivers = tuple(tet for tet in quality.slivers if not np.isin(mesh.tets[tet], fixed).all())
            if warning := replace(quality, slivers=slivers).warning:
                findings.warn((*path, "mesh"), warning)
        inclusions = _inclusions(name, body, built, (*path, "materials"), findings)
        if body.clamp is not None and all(nodes is not None for nodes in found):
            with findings.at((*path, "clamp")):
                clamp_zone(mesh, fixed, body.clamp)
                clamp = body.clamp
        shape = body.mesh if body.shape is None and isinstance(body.mesh, Primitive) else body.shape
        if isinstance(shape, Primitive):
            shape = PrimitiveShape(shape, body.placement or Placement()) if shape.lengths else None
        if shape is not None:
            with findings.at((*path, "shape")):
                shape.require_fit(mesh, "")
                shapes[name] = shape
        with findings.at((*path, "materials")):
            whole = Body(
                name=name,
                mesh=mesh,
                fixed=fixed,
                parameters=body.constants,
                law=body.law,
                element=body.element,
                density=body.density,
                inclusions=inclusions,
                clamp=clamp,
                build_direction=body.build_direction,
                winding=body.winding,
                history=body.history,
                shape=shapes.get(name),
            )
            built.bodies.append(whole)
            for info in robot_parameters(Robot((whole,))).values():
                if fault := out_of_range(info, info.value):
                    keys = info.name.split(".")[1:]
                    at = (*path, *(["materials"] if len(keys) > 1 else []), *keys)
                    findings.add(at, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
    return built


def _inclusions(
    body: str, section: BodySection, built: BuiltBodies, path: KeyPath, findings: Findings
) -> tuple[Material, ...]:
    """The materials of a body's regions; those with a fault, which is recorded, are left out."""
    inclusions: list[Material] = []
    for name, material in section.materials.items():
        region = material.region or name
        if not name.isidentifier():
            findings.add((*path, name), "this cannot be a name", got=f"'{name}'", allowed="letters, digits and _")
        elif region not in built.known_regions(body):
            findings.unknown((*path, name), "region", region, built.known_regions(body))
        else:
            density = section.density if material.density is None else material.density
            of = section.regions[region].region if region in section.regions else Named(region)
            with findings.at((*path, name)):
                tets = select_elements(built.made[body], of)
                inclusions.append(Material(name, tets, material.constants, density))
    return tuple(inclusions)
