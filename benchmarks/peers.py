"""The same residual and tangent by softcal and by its peers: compressible neo-Hookean tets, no constraints.

Every assembler gives residual and tangent in its own numbering and storage; `common` brings them, untimed, to nodes
in order (x, y, z of each) and a full sparse matrix, so that it is checked that all compute the same thing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from softcal.checks import Floats
from softcal.geometry.cell import TET_EDGES
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.elements import P1, P2

Common = tuple[Floats, sp.csr_matrix]
PLAIN = {element.cell.order: element for element in (P1, P2)}


@dataclass(frozen=True)
class Task:
    """A mesh of straight tets, displacements u of its nodes [m], and Lamé's constants [Pa]."""

    mesh: TetMesh
    u: Floats
    mu: float
    lmbda: float


@dataclass(frozen=True)
class Assembler:
    """assemble: residual and tangent as the library has them; common: the same in the numbering of all."""

    assemble: Callable[[], Any]
    common: Callable[[Any], Common]


def softcal_assembler(task: Task) -> Assembler:
    from softcal.materials.catalogue import LAWS
    from softcal.mechanics.layout import FREE, Layout
    from softcal.mechanics.solid_build import build_solid
    from softcal.mechanics.state import State, rest_state
    from softcal.mechanics.system import build_system
    from softcal.mechanics.term import Controls

    X, none = task.mesh.points, np.zeros(0)
    solid, _ = build_solid("body", LAWS["neo-hooke"], PLAIN[task.mesh.order], X, task.mesh.tets, first_point=0)
    layout = Layout(X, np.full(len(X), FREE), np.zeros((0, 3)), 0, 0)
    system = build_system(layout, (solid,))
    nu = 0.5 * task.lmbda / (task.lmbda + task.mu)
    theta = {"body.youngs_modulus": 2.0 * task.mu * (1.0 + nu), "body.poissons_ratio": nu}
    rest = rest_state(layout)
    state = State(X + task.u, rest.position, rest.rotation, rest.pressure, rest.effort)
    controls = Controls(np.zeros(0, dtype=bool), none, none)

    def common(at: Any) -> Common:
        n = layout.first_effort_unknown
        upper = sp.csr_matrix((at.data, system.pattern.indices, system.pattern.indptr), shape=(n, n))
        return at.reduced, (upper + sp.triu(upper, 1).T).tocsr()

    return Assembler(lambda: system.linearise(state, controls, theta), common)


def felupe_assembler(task: Task) -> Assembler:
    import felupe

    kind, region_of = (
        ("tetra", felupe.RegionTetra) if task.mesh.order == 1 else ("tetra10", felupe.RegionQuadraticTetra)
    )
    # FElupe's own points of its quadratic tet have eight digits.
    rule = PLAIN[task.mesh.order].quadrature
    scheme = felupe.quadrature.Scheme(rule.points[:, 1:], rule.weights)
    region = region_of(felupe.Mesh(task.mesh.points, task.mesh.tets, kind), quadrature=scheme)
    fields = felupe.FieldContainer([felupe.Field(region, dim=3, values=task.u)])
    body = felupe.SolidBody(felupe.NeoHookeCompressible(mu=task.mu, lmbda=task.lmbda), fields)
    return Assembler(
        lambda: (body.assemble.vector(fields), body.assemble.matrix(fields)),
        lambda raw: (raw[0].toarray().ravel(), raw[1].tocsr()),
    )


def scikit_fem_assembler(task: Task) -> Assembler:
    import skfem
    from skfem.helpers import ddot, det, grad, inv, transpose

    corners = int(task.mesh.tets[:, :4].max()) + 1
    mesh = skfem.MeshTet(task.mesh.points[:corners].T.copy(), task.mesh.tets[:, :4].T.copy())
    scalar = skfem.ElementTetP1() if task.mesh.order == 1 else skfem.ElementTetP2()
    rule = PLAIN[task.mesh.order].quadrature
    basis = skfem.Basis(mesh, skfem.ElementVector(scalar), quadrature=(rule.points[:, 1:].T.copy(), rule.weights))
    to_node = _nodes_at(task.mesh, basis.doflocs[:, ::3].T)
    order = (3 * to_node[:, None] + np.arange(3)).ravel()
    values = np.empty(task.u.size)
    values[:] = task.u.ravel()[order]
    mu, lmbda = task.mu, task.lmbda

    @skfem.LinearForm
    def residual(v: Any, w: Any) -> Any:
        return ddot(w["P"], grad(v))

    @skfem.BilinearForm
    def tangent(du: Any, v: Any, w: Any) -> Any:
        G, dF = w["G"], grad(du)
        turned = np.einsum("ij...,kj...,kl...->il...", G, dF, G)
        return ddot(mu * dF + w["turn"] * turned + lmbda * ddot(G, dF) * G, grad(v))

    def assemble() -> tuple[Any, Any]:
        F = grad(basis.interpolate(values)) + np.eye(3)[:, :, None, None]
        G = transpose(inv(F))
        turn = mu - lmbda * np.log(det(F))
        return residual.assemble(basis, P=mu * F - turn * G), tangent.assemble(basis, G=G, turn=turn)

    def common(raw: Any) -> Common:
        back = np.argsort(order)
        return raw[0][back], raw[1].tocsr()[back][:, back]

    return Assembler(assemble, common)


def ngsolve_assembler(task: Task) -> Assembler:
    import ngsolve as ng
    from netgen.meshing import Element3D, MeshPoint, Pnt
    from netgen.meshing import Mesh as NetgenMesh

    corners = int(task.mesh.tets[:, :4].max()) + 1
    built = NetgenMesh(dim=3)
    points = [built.Add(MeshPoint(Pnt(*map(float, p)))) for p in task.mesh.points[:corners]]
    for tet in task.mesh.tets[:, :4]:
        built.Add(Element3D(1, [points[i] for i in tet]))
    mesh = ng.Mesh(built)
    scalar = ng.H1(mesh, order=task.mesh.order)
    space = ng.VectorH1(mesh, order=task.mesh.order)
    to_own = _hierarchical(task.mesh, scalar, mesh)
    rule = PLAIN[task.mesh.order].quadrature
    # NGSolve's reference tet has its corners in another order; the points are symmetric, so their order is free.
    points = ng.IntegrationRule([tuple(map(float, p[:3])) for p in rule.points], [float(w) for w in rule.weights])
    u = space.TrialFunction()
    F = ng.Id(3) + ng.Grad(u)
    J = ng.Det(F)
    energy = 0.5 * task.mu * (ng.InnerProduct(F, F) - 3) - task.mu * ng.log(J) + 0.5 * task.lmbda * ng.log(J) ** 2
    form = ng.BilinearForm(space, symmetric=False)
    form += ng.Variation(energy.Compile() * ng.dx(intrules={ng.TET: points}))
    at, out = ng.GridFunction(space), ng.GridFunction(space)
    # VectorH1 numbers one component after the other.
    own = [sp.linalg.spsolve(to_own.tocsc(), task.u[:, i]) for i in range(3)]
    at.vec.FV().NumPy()[:] = np.concatenate(own)

    def assemble() -> tuple[Any, Any]:
        form.Apply(at.vec, out.vec)
        form.AssembleLinearization(at.vec)
        return out.vec, form.mat

    def common(raw: Any) -> Common:
        n = space.ndof
        rows, columns, entries = raw[1].COO()
        K = sp.csr_matrix((np.array(entries), (np.array(rows), np.array(columns))), shape=(n, n))
        # Nodal values are to_own @ own coefficients, so a gradient transforms with the inverse's transpose.
        inverse = sp.linalg.inv(to_own.tocsc()).tocsr()
        blocks = sp.block_diag([inverse] * 3).tocsr()
        n_nodes = n // 3
        by_node = np.arange(n).reshape(3, n_nodes).T.ravel()
        r = blocks.T @ raw[0].FV().NumPy()
        K = (blocks.T @ K @ blocks).tocsr()
        return r[by_node], K[by_node][:, by_node]

    return Assembler(assemble, common)


PEERS: dict[str, Callable[[Task], Assembler]] = {
    "softcal": softcal_assembler,
    "felupe": felupe_assembler,
    "scikit-fem": scikit_fem_assembler,
    "ngsolve": ngsolve_assembler,
}


def _nodes_at(mesh: TetMesh, places: Floats) -> Any:
    """The node of the mesh at each place."""
    from scipy.spatial import cKDTree

    distance, node = cKDTree(mesh.points).query(places)
    if distance.max() > 1e-9 * np.ptp(mesh.points):
        raise RuntimeError("the peer's nodes are not the mesh's")
    return node


def _hierarchical(mesh: TetMesh, space: Any, ng_mesh: Any) -> sp.csr_matrix:
    """Nodal values from NGSolve's coefficients: vertices as they are, an edge's middle with its bubble -L_a L_b / 2."""
    corners = int(mesh.tets[:, :4].max()) + 1
    n = mesh.n_points
    if mesh.order == 1:
        return sp.identity(n, format="csr")
    middle = {}
    for i, (a, b) in enumerate(TET_EDGES):
        low, high = np.sort(mesh.tets[:, [a, b]], axis=1).T
        middle.update(zip(zip(low.tolist(), high.tolist(), strict=True), mesh.tets[:, 4 + i].tolist(), strict=True))
    rows, columns, entries = list(range(corners)), list(range(corners)), [1.0] * corners
    for edge in ng_mesh.edges:
        a, b = sorted(vertex.nr for vertex in edge.vertices)
        rows += [middle[a, b]] * 3
        columns += [a, b, space.GetDofNrs(edge)[0]]
        entries += [0.5, 0.5, -0.125]
    return sp.csr_matrix((entries, (rows, columns)), shape=(n, n))
