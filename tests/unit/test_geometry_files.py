"""Mesh files in and out."""

import base64
import contextlib
import io
import lzma
import re
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softcal.errors import MeshError, StorageError, UnitError
from softcal.geometry.generate import mesh_file
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quality import require_sound
from softcal.geometry.read import read_mesh
from softcal.geometry.write import write_mesh
from softcal.limits import LIMITS

meshio = pytest.importorskip("meshio")


def with_elements(order: int) -> TetMesh:
    mesh = box_mesh((0.1, 0.2, 0.3), (2, 1, 2), order=order)
    nodes = {**mesh.node_sets, "few": np.array([0, 3])}
    return TetMesh(mesh.points, mesh.tets, nodes, mesh.face_sets, {"a": np.array([0, 2, 5]), "b": np.array([1, 23])})


def assert_same(one: TetMesh, other: TetMesh) -> None:
    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.tets, other.tets)
    for kind in ("node_sets", "element_sets"):
        mine, theirs = getattr(one, kind), getattr(other, kind)
        assert mine.keys() == theirs.keys()
        assert all(np.array_equal(np.sort(rows), np.sort(theirs[name])) for name, rows in mine.items())
    assert one.face_sets.keys() == other.face_sets.keys()
    for name, rows in one.face_sets.items():
        # The same triangles, each with the same sense of rotation.
        turned = [
            sorted(np.roll(row[:3], -int(np.argmin(row[:3]))).tolist() for row in faces)
            for faces in (rows, other.face_sets[name])
        ]
        assert turned[0] == turned[1]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("suffix", [".msh", ".vtu"])
def test_what_is_written_is_read_again(tmp_path, order, suffix):
    mesh = with_elements(order)
    path = write_mesh(mesh, tmp_path / f"box{suffix}")
    assert_same(mesh, read_mesh(path))
    assert [file.name for file in tmp_path.iterdir()] == [f"box{suffix}"]


def test_coordinates_are_scaled_to_metres(tmp_path):
    mesh = box_mesh((1.0, 2.0, 3.0), (1, 1, 1))
    path = write_mesh(mesh, tmp_path / "box.msh")
    assert read_mesh(path, unit="mm").points == pytest.approx(mesh.points * 1e-3)
    with pytest.raises(UnitError, match=r"box\.msh"):
        read_mesh(path, unit="kg")


def test_abaqus_sets_are_read(tmp_path):
    path = tmp_path / "part.inp"
    path.write_text(
        "*HEADING\n*NODE\n"
        "11, 0., 0., 0.\n12, 1., 0., 0.\n13, 0., 1., 0.\n14, 0., 0., 1.\n15, 1., 1., 1.\n"
        "*ELEMENT, TYPE=C3D4, ELSET=solid\n1, 11, 12, 13, 14\n2, 12, 13, 14, 15\n"
        "*ELEMENT, TYPE=S3, ELSET=base\n3, 11, 12, 13\n"
        "*NSET, NSET=held, GENERATE\n11, 13, 1\n*ELSET, ELSET=upper\n2\n"
    )
    mesh = read_mesh(path, unit="mm")
    assert mesh.n_tets == 2
    assert mesh.points.max() == pytest.approx(1e-3)
    assert mesh.node_sets["held"].tolist() == [0, 1, 2]
    assert mesh.element_sets["solid"].tolist() == [0, 1]
    assert mesh.element_sets["upper"].tolist() == [1]
    # Given with its normal up, the base of the solid comes out looking down.
    assert mesh.face_sets["base"].tolist() in ([[0, 2, 1]], [[2, 1, 0]], [[1, 0, 2]])
    assert mesh.node_sets["base"].tolist() == [0, 1, 2]


DECK = (
    "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n5, 1., 1., 1.\n"
    "*ELEMENT, TYPE=C3D4\n11, 1, 2, 3, 4\n*ELEMENT, TYPE=C3D4, ELSET=tip\n12, 2, 3, 4, 5\n"
    "*NSET, NSET=held\n1, 2, 3\n*ELSET, ELSET=all\n11, 12\n"
)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("1, 2, 3\n", "1 , 2 , 3\n"),
        ("1, 2, 3\n", "1,\n** of the clamp\n2, 3,\n"),
        ("1, 2, 3\n", "1, 2\n*NSET, NSET=held\n3\n"),
        ("held\n1, 2, 3\n", "foot\n1, 2\n*NSET, NSET=held\nfoot, 3\n"),
        ("held\n1, 2, 3\n", "held, GENERATE\n1, 2\n3, 3, 1\n"),
        ("5, 1., 1., 1.\n", "** the tip\n5, 1., 1., 1.\n"),
        ("11, 1, 2, 3, 4\n", "** the foot\n11, 1, 2, 3, 4\n"),
        ("11, 1, 2, 3, 4\n", "11, 1, 2,\n3, 4\n"),
        ("TYPE=C3D4, ELSET=tip", "type=c3d4,\n elset=tip"),
        ("all\n11, 12\n", "all\n11\ntip\n"),
        ("all\n11, 12\n", "foot\n11\n*ELSET, ELSET=all\nfoot, tip\n"),
        ("*NODE\n", "*PART, NAME=a\n*NODE, NSET=every\n"),
        ("*ELEMENT, TYPE=C3D4\n", "*ELEMENT, TYPE=S3, ELSET=lid\n1, 1, 2, 3\n*ELEMENT, TYPE=C3D4\n"),
    ],
)
def test_a_deck_is_read_as_abaqus_reads_it(tmp_path, before, after):
    assert before in DECK
    path = tmp_path / "a.inp"
    path.write_text(DECK.replace(before, after))
    mesh = read_mesh(path)
    assert mesh.n_tets == 2
    assert mesh.node_sets["held"].tolist() == [0, 1, 2]
    assert mesh.element_sets["tip"].tolist() == [1]
    assert mesh.element_sets["all"].tolist() == [0, 1]


MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
0 1 "tip"
2 1 "neck"
3 2 "neck"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
5
1 15 2 1 1 4
2 2 2 1 1 1 3 2
3 2 2 9 1 1 2 4
4 4 2 2 1 1 2 3 4
5 4 2 7 1 1 2 3 4
$EndElements
"""


def test_gmsh_groups_of_one_name_unnamed_groups_and_tets_in_two_groups(tmp_path):
    path = tmp_path / "neck.msh"
    path.write_text(MSH)
    mesh = read_mesh(path)
    assert mesh.n_tets == 1
    assert mesh.element_sets["neck"].tolist() == [0]
    assert mesh.element_sets["7"].tolist() == [0]
    assert mesh.node_sets["tip"].tolist() == [3]
    assert sorted(mesh.face_sets["neck"][0].tolist()) == [0, 1, 2]
    assert sorted(mesh.face_sets["9"][0].tolist()) == [0, 1, 3]
    require_sound(mesh)


def test_a_large_number_of_a_node_takes_no_memory(tmp_path):
    path = tmp_path / "neck.msh"
    path.write_text(
        MSH.replace("4 0 0 1", "4000000000000 0 0 1")
        .replace(" 1 1 4\n", " 1 1 4000000000000\n")
        .replace(" 4\n", " 4000000000000\n")
    )
    assert read_mesh(path).n_tets == 1


def test_a_group_whose_sense_gmsh_turned_keeps_its_name(tmp_path):
    path = tmp_path / "neck.msh"
    path.write_text(MSH.replace("2 2 2 1 1 1 3 2", "2 2 2 -1 1 1 3 2"))
    assert read_mesh(path).face_sets["neck"].shape == (1, 3)


MSH4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
2 2 "wall"
2 3 "top"
3 1 "wall"
$EndPhysicalNames
$Entities
0 0 1 1
1 0 0 0 1 1 0 2 3 2 0
1 0 0 0 1 1 1 1 1 0
$EndEntities
$Nodes
2 5 1 5
2 1 0 3
1
2
3
0 0 0
1 0 0
0 1 0
3 1 0 2
4
9
0 0 1
1 1 1
$EndNodes
$Elements
2 3 1 3
2 1 2 1
1 1 2 3
3 1 4 2
2 1 2 3 4
3 2 3 4 9
$EndElements
"""


@pytest.mark.parametrize(
    ("before", "after", "faces", "tets"),
    [
        ("9\n", "9\n", {"top", "wall"}, {"wall"}),
        ('"wall"\n2 3 "top"', '"side"\n2 3 "top"', {"side", "top"}, {"wall"}),
        (" 2 3 2 0", " 2 7 8 0", {"7", "8"}, {"wall"}),
        (" 2 3 2 0", " 0 0", set(), {"wall"}),
        ("1 1 1 1 1 0\n", "1 1 1 0 0\n", {"top", "wall"}, set()),
    ],
)
def test_groups_of_gmsh_4_are_all_of_all_its_elements(tmp_path, before, after, faces, tets):
    path = tmp_path / "neck.msh"
    path.write_text(MSH4.replace(before, after))
    mesh = read_mesh(path)
    assert mesh.tets.tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]
    assert (set(mesh.face_sets), set(mesh.element_sets)) == (faces, tets)


def test_a_group_of_loose_triangles_is_refused(tmp_path):
    path = tmp_path / "neck.msh"
    path.write_text(MSH.replace("2 2 2 1 1 1 3 2", "2 2 2 1 1 1 3 5").replace("4\n1 0 0 0", "5\n5 9 9 9\n1 0 0 0"))
    with pytest.raises(MeshError, match=r"neck\.msh, group 'neck': 1 of 1 triangles are not faces"):
        read_mesh(path)


INP = (
    "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n*ELEMENT, TYPE=C3D4, ELSET=solid\n"
    "1, 1, 2, 3, 4\n2, 1, 2, 3, 4\n*NSET, NSET=held\n1\n*ELSET, ELSET=upper\n2\n"
)


VTK = (
    "# vtk DataFile Version 2.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    "1 1 1\nCELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\n"
)


def triangles_only(path):
    meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]).write(path)


def two_orders(path):
    mesh = box_mesh((1, 1, 1), (1, 1, 1), order=2)
    meshio.Mesh(mesh.points, [("tetra10", mesh.tets), ("tetra", mesh.tets[:1, :4])]).write(path)


def bricks_too(path):
    box = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    meshio.Mesh(np.array(box, float), [("tetra", [[0, 1, 2, 4]]), ("hexahedron", [[0, 1, 3, 2, 4, 5, 7, 6]])]).write(
        path
    )


def two_pieces(path):
    meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])]).write(path)
    text = path.read_text()
    piece = text[text.index("<Piece") : text.index("</Piece>") + len("</Piece>")]
    path.write_text(text.replace(piece, 2 * piece))


def cells_changed(old, new):
    def write(path):
        with contextlib.redirect_stderr(io.StringIO()):  # meshio warns of text
            meshio.Mesh(np.eye(5, 3), [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]])]).write(path, binary=False)
        text = path.read_text()
        assert re.search(old, text)
        path.write_text(re.sub(old, new, text, count=1))

    return write


def packed(old, new, form="gmsh22"):
    """Writes a binary file of Gmsh in which some bytes are others."""

    def write(path):
        with contextlib.redirect_stderr(io.StringIO()):  # meshio warns of missing groups
            meshio.Mesh(np.eye(5, 3), [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]])]).write(path, form, binary=True)
        assert old in path.read_bytes()
        path.write_bytes(path.read_bytes().replace(old, new, 1))

    return write


def numbers(kind, *values):
    return np.array(values, dtype=kind).tobytes()


def appended(mesh, sets):
    """A .vtu as ParaView writes it: arrays of binary numbers behind the text, one after another."""
    arrays = [
        ("Points", "Float64", mesh.points),
        ("connectivity", "Int64", mesh.tets),
        ("offsets", "Int64", 4 * np.arange(1, mesh.n_tets + 1)),
        ("types", "UInt8", np.full(mesh.n_tets, 10, np.uint8)),
        *((f"element set {k}", "UInt8", np.isin(np.arange(mesh.n_tets), v).astype(np.uint8)) for k, v in sets.items()),
    ]
    tags, raw = [], b""
    for name, kind, values in arrays:
        width = ' NumberOfComponents="3"' if name == "Points" else ""
        tags.append(f'<DataArray type="{kind}" Name="{name}"{width} format="appended" offset="{len(raw)}"/>')
        raw += np.uint32(values.nbytes).tobytes() + values.tobytes()
    text = (
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"><UnstructuredGrid>'
        f'<Piece NumberOfPoints="{mesh.n_points}" NumberOfCells="{mesh.n_tets}"><Points>{tags[0]}</Points>'
        f"<Cells>{''.join(tags[1:4])}</Cells><CellData>{''.join(tags[4:])}</CellData></Piece></UnstructuredGrid>"
        '<AppendedData encoding="raw">_'
    )
    return text.encode() + raw + b"\n</AppendedData></VTKFile>"


@pytest.mark.parametrize("boxes", [(6, 3, 2), (3, 2, 2), (5, 1, 1)])
def test_sets_of_a_file_of_paraview_are_not_interchanged(tmp_path, boxes):
    mesh, rng = box_mesh((1, 1, 1), boxes), np.random.default_rng(0)
    sets = {f"s{k}": np.flatnonzero(rng.random(mesh.n_tets) < 0.5) for k in range(40)}
    (tmp_path / "a.vtu").write_bytes(appended(mesh, sets))
    found = read_mesh(tmp_path / "a.vtu")
    assert np.array_equal(found.tets, mesh.tets)
    assert np.array_equal(found.points, mesh.points)
    assert all(np.array_equal(found.element_sets[name], rows) for name, rows in sets.items())


@pytest.mark.parametrize("form", ["gmsh22", "gmsh"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_binary_file_of_gmsh_is_read_as_its_text(tmp_path, form, order):
    mesh = box_mesh((0.1, 0.2, 0.3), (2, 1, 2), order=order)
    groups = {"gmsh:physical": [np.arange(mesh.n_tets) % 3], "gmsh:geometrical": [np.ones(mesh.n_tets, int)]}
    names = {"a": np.array([1, 3]), "b": np.array([2, 3])}
    raw = meshio.Mesh(mesh.points, [(mesh.cell.meshio, mesh.tets)], cell_data=groups, field_data=names)
    for binary in (False, True):
        raw.write(tmp_path / f"{binary}.msh", form, binary=binary)
    assert_same(*(read_mesh(tmp_path / f"{binary}.msh") for binary in (False, True)))
    assert np.array_equal(read_mesh(tmp_path / "True.msh").points, mesh.points)


def fractions(path):
    cells_changed(r'"Int64" (Name="connectivity"[^>]*>\s*)0', r'"Float64" \g<1>0.7')(path)


def flagged(**data):
    return lambda path: meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])], **data).write(path)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("empty.msh", "", "the file is empty"),
        ("text.msh", "this is not a mesh", "cannot be read"),
        ("text.vtk", "this is not a mesh", "cannot be read"),
        ("text.vtu", "this is not a mesh", "cannot be read"),
        ("text.inp", "this is not a mesh", "cannot be read|no tetrahedra"),
        ("cut.msh", MSH[:-60], "cannot be read"),
        ("cut.inp", "*NODE\n1, 0., 0.\n*ELEMENT, TYPE=C3D4\n1, 1, 2\n", "cannot be read"),
        ("neck.obj", "v 0 0 0", r"got '\.obj'; allowed: \.msh, \.vtk, \.vtu, \.inp"),
        ("neck.stl", "solid", "mesh_file"),
        (
            "old.msh",
            MSH.replace("2.2 0", "4.0 0"),
            "got version 4.0 of the format; 2 and 4.1 are read, which Gmsh",
        ),
        ("oldest.msh", "$NOD\n1\n1 0 0 0\n$ENDNOD\n", r"got no \$MeshFormat; 2 and 4.1 are read, which Gmsh writes by"),
        ("half a node.msh", MSH.replace("4 0 0 1", "4.7 0 0 1"), "got a word in the place of a number"),
        ("large.msh", MSH.replace("4 0 0 1", f"{2**63 + 5} 0 0 1").replace(" 4\n", f" {2**64}\n"), "that is too large"),
        ("level.msh", MSH4.replace("3 1 4 2\n", "2 1 4 2\n"), "got tetra cells of an entity of dimension 2"),
        (
            "zero, binary.msh",
            packed(numbers("<i4", 1, 2, 3, 4), numbers("<i4", 0, 2, 3, 4)),
            "got number 0 under tetra cells, which no node has",
        ),
        (
            "zero, binary 4.msh",
            packed(numbers("<u8", 1, 1, 2, 3, 4), numbers("<u8", 1, 0, 2, 3, 4), "gmsh"),
            "got number 0 under tetra cells, which no node has",
        ),
        (
            "total, binary 4.msh",
            packed(numbers("<u8", 1, 5, 1, 5), numbers("<u8", 1, 6, 1, 5), "gmsh"),
            r"got other numbers of lines in \$Nodes than it",
        ),
        ("end, binary.msh", packed(b"$EndElements", b"$EndElem"), r"got \$Elements without an end"),
        ("more, binary.msh", packed(b"\n$EndNodes", b"more\n$EndNodes"), r"got 4 bytes too many in \$Nodes"),
        ("order, binary.msh", packed(b"\1\0\0\0\n", b"\0\0\0\1\n"), "got binary numbers of another kind or order of"),
        (
            "byte.vtu",
            cells_changed(r'"Int64" (Name="connectivity"[^>]*>\s*)0', r'"UInt8" \g<1>256'),
            "got numbers from 1 to 256 in an array of UInt8",
        ),
        (
            "ends twice.vtu",
            cells_changed(r'(?s)(<DataArray[^>]*"offsets".*?</DataArray>)', r"\1\1"),
            "got two arrays 'offsets'",
        ),
        ("poly.vtu", cells_changed('type="UnstructuredGrid"', 'type="PolyData"'), "got a file of type 'PolyData'"),
        ("lid.vtu", triangles_only, "no tetrahedra; got 3 points, 1 triangle; allowed: tetra"),
        ("two.vtu", two_orders, "mixes linear and quadratic"),
        (
            "bricks.vtu",
            bricks_too,
            "other solid elements beside tetrahedra; got 8 points, 1 tetra, 1 hexahedron; allowed",
        ),
        ("pieces.vtu", two_pieces, "got 2 pieces in place of one: merge them"),
        (
            "nodes.vtu",
            cells_changed(r'(?s)(<DataArray[^>]*"connectivity".*?</DataArray>)', r"\1\1"),
            "got two arrays 'connectivity'",
        ),
        ("ends.vtu", cells_changed(r"\n4\n8\n", r"\n3\n8\n"), "got cell 0 of type 10 with 3 nodes"),
        ("back.vtu", cells_changed(r"\n4\n8\n", r"\n8\n4\n"), "got cell 0 of type 10 with 8 nodes"),
        ("kind.vtu", cells_changed(r"\n10\n10\n", r"\n10\n99\n"), "got cell 1 of type 99"),
        ("rest.vtu", cells_changed(r"\n3\n4\n\n", r"\n3\n4\n4\n\n"), "got 9 nodes of cells that end at 8"),
        ("part.vtu", fractions, "tetra cells: there are no numbers of nodes or cells"),
        ("ends.vtk", cells_changed(r"\n0\n4\n8\n", r"\n0\n3\n8\n"), "got cell 0 of type 10 with 3 nodes"),
        (
            "nan.vtu",
            flagged(point_data={"node set a": np.array([np.nan, 0, 0, 1])}),
            "'node set a': this is no set; got",
        ),
        (
            "half.vtu",
            flagged(point_data={"node set a": np.array([0.5, 0, 0, 1])}),
            "no set; .*allowed: 0 or 1 for each",
        ),
        ("vector.vtu", flagged(point_data={"node set a": np.eye(4, 3)}), "'node set a': this is no set"),
        ("cells.vtu", flagged(cell_data={"element set a": [np.array([2])]}), "'element set a': this is no set"),
        ("nan.msh", MSH.replace("4 0 0 1", "4 0 0 nan"), "no finite coordinates; got node 3"),
        ("word.msh", MSH.replace("4 0 0 1", "4 0 zero 1"), "got a word in the place of a number, or another number of"),
        ("short.msh", MSH.replace("1 15 2 1 1 4", "1"), "got a word in the place of a number, or another number of"),
        ("few.msh", MSH.replace("$Elements\n5", "$Elements\n4"), r"got 5 lines in \$Elements, which states 4"),
        ("fewer.msh", MSH.replace("$Nodes\n4", "$Nodes\n3"), r"got 4 lines in \$Nodes, which states 3"),
        ("again.msh", MSH.replace("$Nodes\n4", "$Nodes\n5\n4 9 9 9"), "got number 4 of two nodes"),
        ("back.msh", MSH4.replace("3 1 4 2\n2 1 2 3 4", "3 1 4 -1\n2 1 2 3 4"), r"got -1 entries of \$Elements"),
        ("zero.msh", MSH.replace("7 1 1 2 3 4", "7 1 1 2 3 0"), "got number 0 under tetra cells, which no node has"),
        ("row.msh", MSH.replace("7 1 1 2 3 4", "7 1 1 2 3"), "got '5 4 2 7 1 1 2 3', in the place of the 9 numbers of"),
        ("long.msh", MSH.replace("7 1 1 2 3 4", "7 1 9 1 2 3 4"), "got '5 4 2 7 1 9 1 2 3 4', in the place of the 9"),
        ("type.msh", MSH.replace("5 4 2 7", "5 99 2 7"), "got elements of type 99"),
        ("nodes.msh", MSH + "$Nodes\n1\n1 9 9 9\n$EndNodes\n", r"got two sections \$Nodes"),
        ("blocks.msh", MSH4.replace("2 3 1 3\n", "1 3 1 3\n"), r"got other numbers of lines in \$Elements than it"),
        ("total.msh", MSH4.replace("2 3 1 3\n", "2 2 1 3\n"), r"got other numbers of lines in \$Elements than it"),
        ("entity.msh", MSH4.replace("\n3 1 4 2\n", "\n3 5 4 2\n"), "got elements of an entity 5 of dimension 3 that"),
        ("same.msh", MSH.replace("7 1 1 2 3 4", "7 1 1 2 3 3"), "1 tetrahedra have a node twice; got nodes"),
        (
            "types.vtk",
            VTK.replace("TYPES 2\n10\n", "TYPES 1\n"),
            "several meshes, or cells without a type; got POINTS 5",
        ),
        ("points.vtk", VTK + "POINTS 5 double\n" + "9 9 9\n" * 5, "several meshes, or cells without a type"),
        ("scar.inp", INP + "*IMPERFECTION, FILE=x\n1, 0.1\n", r"got \*IMPERFECTION in line 13, which is not followed"),
        ("less.inp", INP + "*MODEL CHANGE, REMOVE\nupper\n", r"got \*MODEL CHANGE in line 13, which is not followed"),
        (
            "latin.msh",
            MSH.replace('"tip"', '"spitze \xe4"').encode("latin-1"),
            "got bytes that are no text; allowed: a",
        ),
        (
            "type.inp",
            INP.replace("C3D4", "C9"),
            r"got elements of type C9 in line 6; allowed: a valid \.inp file\. Try: ",
        ),
        (
            "cell.inp",
            INP.replace("held\n1", "held, GENERATE\n1, 9, 1"),
            r"got number 5 under \*NSET in line 9, which no node has",
        ),
        ("other.inp", INP + "*INCLUDE, INPUT=/dev/zero\n", r"got \*INCLUDE in line 13, which is not followed: list"),
        ("twice.inp", INP.replace("4, 0., 0.", "3, 0., 0."), "got number 3 of two nodes"),
        ("lists.inp", INP + INP, "got number 1 of two nodes"),
        (
            "set.inp",
            INP.replace("upper\n2", "upper\nx"),
            r"got 'x' under \*ELSET in line 11: only a number or a set above it",
        ),
        (
            "nodes.inp",
            INP.replace("held\n1", "held\n1, x"),
            r"got 'x' under \*NSET in line 9: only a number or a set above it",
        ),
        (
            "half.inp",
            INP.replace("held\n1", "held\n1.0, 2"),
            r"got '1\.0' under \*NSET in line 9: only a number or a set above it",
        ),
        (
            "minus.inp",
            INP.replace("held\n1", "held\n-1, 2"),
            r"got number -1 under \*NSET in line 9, which no node has",
        ),
        ("element.inp", INP.replace("upper\n2", "upper\n2, 99"), r"got number 99 under \*ELSET in line 11, which no"),
        (
            "of.inp",
            INP.replace("=held\n1", "=held, ELSET=solid"),
            r"got ELSET of \*NSET in line 9, which is not followed: list",
        ),
        (
            "round.inp",
            INP.replace("*NODE", "*NODE, SYSTEM=C"),
            r"got SYSTEM of \*NODE in line 1, which is not followed: list",
        ),
        (
            "system.inp",
            "*SYSTEM\n1., 0., 0., 2., 0., 0.\n" + INP,
            r"got \*SYSTEM in line 1, which is not followed: list",
        ),
        (
            "copies.inp",
            INP + "*NCOPY, OLD SET=held, SHIFT\n0, 0, 5\n",
            r"got \*NCOPY in line 13, which is not followed: list",
        ),
        (
            "moved.inp",
            INP + "*INSTANCE, PART=a\n0., 0., 50.\n",
            r"got \*INSTANCE in line 13, which is not followed: list",
        ),
        (
            "parts.inp",
            INP + "*INSTANCE, PART=a\n*INSTANCE, PART=a\n",
            r"got \*INSTANCE in line 14, which is not followed: list",
        ),
        (
            "down.inp",
            INP.replace("held\n1", "held, GENERATE\n3, 1, -1"),
            r"got numbers from 3 down to 1 under \*NSET in",
        ),
        (
            "line.inp",
            INP.replace("4, 0., 0., 1.", "4, 0., 0., 1_0."),
            r"got letters in the place of numbers under \*NODE in line 1;",
        ),
        (
            "arabic.inp",
            INP.replace("2, 1, 2, 3, 4", "2, 1, 2, 3, \u0664"),
            r"got letters in the place of numbers under \*ELEMENT in line 6",
        ),
        ("names.msh", MSH.replace('0 1 "tip"', '2 1 "tip"'), "got two names of group 1 of dimension 2"),
        ("label.inp", INP.replace("\n2, 1, 2", "\n1, 1, 2"), "got number 1 of two elements"),
        (
            "row.inp",
            INP.replace("2, 1, 2, 3, 4", "2, 1, 2, 3"),
            r"got 9 numbers under \*ELEMENT in line 6, each with 4 nodes",
        ),
    ],
)
def test_bad_files_are_told_in_one_sentence(tmp_path, capfd, name, content, told):
    path = tmp_path / name
    if callable(content):
        content(path)
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content)
    with pytest.raises(MeshError, match=told) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_more_tets_than_a_robot_may_have_are_refused(tmp_path, monkeypatch):
    path = write_mesh(box_mesh((1, 1, 1), (2, 2, 1)), tmp_path / "box.vtu")
    monkeypatch.setitem(LIMITS, "tets", replace(LIMITS["tets"], most=23))
    with pytest.raises(MeshError, match=r"box\.vtu: there are too many tets; got 24; allowed: 1 to 23 tets"):
        read_mesh(path)
    monkeypatch.setitem(LIMITS, "bytes of a mesh file", replace(LIMITS["bytes of a mesh file"], most=100))
    with pytest.raises(MeshError, match=r"box\.vtu: there are too many bytes of a mesh file"):
        read_mesh(path)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(MeshError, match="does not exist"):
        read_mesh(tmp_path / "none.msh")


def test_what_a_format_cannot_hold_is_refused(tmp_path):
    mesh = box_mesh((1, 1, 1), (1, 1, 1))
    with pytest.raises(MeshError, match=r"allowed: \.msh, \.vtu"):
        write_mesh(mesh, tmp_path / "box.stl")
    overlapping = TetMesh(mesh.points, mesh.tets, element_sets={"a": np.array([0, 1]), "b": np.array([1])})
    with pytest.raises(MeshError, match="overlap"):
        write_mesh(overlapping, tmp_path / "box.msh")
    assert_same(overlapping, read_mesh(write_mesh(overlapping, tmp_path / "box.vtu")))
    clash = TetMesh(mesh.points, mesh.tets, {"x0": np.array([0])}, mesh.face_sets)
    with pytest.raises(MeshError, match="share a name"):
        write_mesh(clash, tmp_path / "box.msh")
    shared = TetMesh(mesh.points, mesh.tets, face_sets=mesh.face_sets, element_sets={"x0": np.array([0])})
    with pytest.raises(MeshError, match=r"share a name; got 'x0'"):
        write_mesh(shared, tmp_path / "box.msh")
    with pytest.raises(StorageError, match="cannot be written"):
        write_mesh(mesh, tmp_path / "none" / "box.msh")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory of a process is read from /proc")
@pytest.mark.parametrize("compressor", ["vtkZLibDataCompressor", "vtkLZMADataCompressor"])
def test_a_small_file_that_unpacks_to_gigabytes_is_refused_before_it_does(tmp_path, compressor):
    """Of which a process of its own says how much memory it took."""
    zeros = bytes(2**26)
    maker = zlib.compressobj() if "ZLib" in compressor else lzma.LZMACompressor(preset=0)
    packed = b"".join([*(maker.compress(zeros) for _ in range(16)), maker.flush()])
    header = np.array([1, 16 * len(zeros), 0, len(packed)], dtype="<u8").tobytes()
    data = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    (tmp_path / "bomb.vtu").write_text(f"""<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"
header_type="UInt64" compressor="{compressor}"><UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="binary">{data}</DataArray></Points></Piece></UnstructuredGrid>
</VTKFile>""")
    code = (
        "import re, sys, softcal\ntry:\n    softcal.read_mesh(sys.argv[1])\n"
        "except softcal.MeshError as error:\n    print(error)\n"
        "print(re.search(r'VmHWM:\\s*(\\d+) kB', open('/proc/self/status').read())[1])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "bomb.vtu")], capture_output=True, text=True, check=True
    )
    told, kilobytes = done.stdout.splitlines()
    assert "reading this takes more than a mesh in a file of this size does; got more than 5" in told
    assert int(kilobytes) < 1_000_000


@pytest.mark.parametrize(
    ("corner", "message"),
    [(3.0, "made no tetrahedra.*Try: one closed surface: join"), (0.5, "could not mesh this.*Try: unite bodies that")],
)
def test_a_surface_of_two_bodies_is_refused_with_advice(tmp_path, corner, message):
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    unit = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    lines = ["solid two"]
    for cube in (unit, unit + corner):
        for i, j, k, m in faces:
            for facet in ((i, j, k), (i, k, m)):
                corners = ["vertex " + " ".join(map(str, cube[n])) for n in facet]
                lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    path = tmp_path / "two.stl"
    path.write_text("\n".join([*lines, "endsolid two"]))
    with pytest.raises(MeshError, match=message):
        mesh_file(path, unit="mm", size=5e-4)
