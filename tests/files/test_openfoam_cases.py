"""Cases of OpenFOAM as people have them: graded, steady, decomposed with empty parts, with regions, with macros."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foam_case import Writer, box, decomposed
from test_openfoam import graded, means, played, speeds

from taichi_plume.assembly.preparation import load
from taichi_plume.files.openfoam import read
from taichi_plume.files.openfoam_case import series, steadiness
from taichi_plume.files.openfoam_file import dictionary
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.files.wind_site import Site
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.loading import ScenarioError

LOW, HIGH = np.array([-5.0, -1.0, 0.0]), np.array([-3.0, 0.2, 0.8])
"""Corners of the mesh `graded`."""
EULER = "ddtSchemes { default Euler; }"


def case(folder: Path, times: Any = ("1",), system: dict[str, str] | None = None, **keys: Any) -> np.ndarray:
    """A case of a graded mesh; returns the centres of its cells. times: names, by which velocities are multiplied."""
    points, cells = box((4, 3, 2), graded)
    writer, x = Writer(folder, **keys), means(points, cells)
    writer.mesh(points, cells)
    for time in times:
        writer.field(time, "U", float(time) * speeds(x))
    for name, text in (system or {}).items():
        Writer(folder).write(f"system/{name}", "dictionary", text.encode())
    return x


def site(folder: Path, files: str = "case", dim: int = 3, **keys: Any) -> Site:
    return Site(ImportedWind(kind="imported", files=files, **keys), (1.0,) * dim, folder)


def test_the_extent_is_that_of_the_mesh(tmp_path):
    """The box of the points, where half a distance of the outermost centres would be beside it."""
    case(tmp_path / "case")
    found = site(tmp_path)
    np.testing.assert_allclose(found.origin, LOW, atol=1e-12)
    np.testing.assert_allclose(found.high, HIGH - LOW, atol=1e-12)
    assert found.levels == pytest.approx((0.0, 0.8))
    assert found.slack == 0.0
    np.testing.assert_allclose(site(tmp_path, origin=(-4.5, -1.0, 0.0)).low, [-0.5, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("keys", [{}, {"binary": True}])
def test_extent_and_equal_values_are_those_of_another_reader(tmp_path, keys):
    import pyvista

    case(tmp_path, ("1",), {"controlDict": "startTime 0; endTime 1; deltaT 1; writeInterval 1;"}, **keys)
    Writer(tmp_path).raw_field("1", "U", "nonuniform List<vector> 24{(0.1 -0.2 0.3)}")
    (tmp_path / "case.foam").touch()
    reader = pyvista.OpenFOAMReader(str(tmp_path / "case.foam"))
    reader.set_active_time_value(1.0)
    mesh, ours = reader.read()["internalMesh"], read(tmp_path / "1")
    assert ours.box is not None
    np.testing.assert_allclose(np.ravel(np.array(ours.box).T), mesh.bounds, atol=1e-6)
    np.testing.assert_allclose(ours.velocity, mesh.cell_data["U"], atol=1e-7)


def test_points_that_no_face_uses_do_not_count(tmp_path):
    points, cells = box((2, 2, 2), lambda x: x)
    writer = Writer(tmp_path / "case")
    writer.mesh(np.concatenate([points, [[90.0, 0.0, 0.0]]]), cells)
    writer.field("1", "U", np.zeros((8, 3)))
    np.testing.assert_array_equal(np.array(read(tmp_path / "case/1").box), [[0, 0, 0], [1, 1, 1]])


@pytest.mark.parametrize(
    ("system", "is_steady"),
    [
        ({"fvSchemes": "ddtSchemes { default steadyState; }"}, True),
        ({"fvSchemes": "ddtSchemes { default none; ddt(U) steadyState; ddt(k) Euler; }"}, True),
        ({"fvSchemes": 'ddtSchemes { default Euler; "ddt\\(.*\\)" bounded steadyState; }'}, True),
        ({"fvSchemes": "ddtSchemes { default localEuler rDeltaT; }", "controlDict": "application pimpleFoam;"}, True),
        ({"fvSchemes": 's steadyState;\nddtSchemes\n{\n    #include "x"\n    default $s; // all\n}'}, True),
        ({"controlDict": "application buoyantSimpleFoam;"}, True),
        ({"controlDict": "application rhoSimpleFoam;", "fvSchemes": EULER}, True),
        ({"controlDict": "application potentialFoam;"}, True),
        ({"controlDict": "application buoyantPimpleFoam;", "fvSchemes": EULER}, False),
        ({"controlDict": "application foamRun; solver incompressibleFluid;", "fvSchemes": EULER}, False),
        ({"fvSchemes": "t CoEuler; ddtSchemes { default ${t} phi 0.3; }", "controlDict": "application icoFoam;"}, True),
        ({"fvSchemes": "old { default steadyState; } ddtSchemes { $old; }"}, True),
        ({"fvSchemes": "all { old { default Euler; } } ddtSchemes ${all.old};"}, False),
        ({"fvSchemes": 'ddtSchemes { #include "ddt" }', "ddt": "default steadyState;"}, True),
        ({"fvSchemes": '#include "<system>/all"', "all": "ddtSchemes { default backward; }"}, False),
        ({"fvSchemes": EULER, "controlDict": '#include "$FOAM_CASE/system/of"', "of": "application overPotentialFoam;"},
         True),
        ({"controlDict": 'application "SRFSimpleFoam";'}, True),
        ({"controlDict": "application /usr/bin/adjointOptimisationFoam;", "fvSchemes": EULER}, True),
        ({"controlDict": "application icoFoam;"}, None),
        ({"fvSchemes": 'ddtSchemes { #include "away" }', "controlDict": "application pimpleFoam;"}, None),
        ({"fvSchemes": 'ddtSchemes { default Euler; #include "../../steady" }'}, None),
        ({"fvSchemes": "ddtSchemes { $away; }"}, None),
        ({"controlDict": "application foamRun;", "fvSchemes": "ddtSchemes { default $away; }"}, None),
        ({"fvSchemes": "}} ; { ddtSchemes"}, None),
        ({}, None),
    ],
)  # fmt: skip
def test_whether_a_case_is_steady(tmp_path, system, is_steady):
    x = case(tmp_path / "case", ("0", "200", "500"), system)
    assert steadiness(tmp_path / "case")[0] is is_steady
    found = played(tmp_path / "case")
    assert [time for time, _ in found.files] == ([0.0] if is_steady else [0.0, 200.0, 500.0])
    np.testing.assert_array_equal(read(found.files[-1][1]).velocity, 500 * speeds(x))
    assert len(found.remarks) == (0 if is_steady is False else 1)
    if is_steady:
        assert "500" in found.remarks[0]
        assert "iterations" in found.remarks[0]
    assert played(tmp_path / "case/200").files == [(0.0, tmp_path / "case/200")]


def test_a_dictionary_that_includes_itself(tmp_path):
    (tmp_path / "system").mkdir()
    (tmp_path / "system/fvSchemes").write_text('#include "fvSchemes"\n' * 2)
    assert steadiness(tmp_path)[0] is None
    assert dictionary(tmp_path / "system/fvSchemes") == {"#": '#include "fvSchemes"'}


@pytest.mark.parametrize(
    ("inner", "head"),
    [("uniform ($ux 0.2 -0.3)", "ux 0.1;"), ("uniform $u", "u (0.1 0.2 -0.3);"),
     ("uniform $of.u", '#include "include/all"'), ("uniform [m/s] (0.1 0.2 -0.3)", ""), ("$fields.U", "f 1;"),
     ("uniform (10 20 -30) [cm/s]", "")],
)  # fmt: skip
def test_a_uniform_field_of_macros_and_units(tmp_path, inner, head):
    case(tmp_path / "case", ("2",), {"fvSchemes": EULER})
    (tmp_path / "case/0/include").mkdir(parents=True)
    (tmp_path / "case/0/include/all").write_text("of { u (0.1 0.2 -0.3); }")
    text = (
        f"{head} fields {{ U uniform (0.1 0.2 -0.3); }} dimensions [0 1 -1 0 0 0 0]; internalField {inner};"
    )
    Writer(tmp_path / "case").write("0/U", "volVectorField", text.encode())
    found = played(tmp_path / "case")
    assert ([time for time, _ in found.files], found.remarks) == ([0.0, 2.0], ())
    np.testing.assert_allclose(read(tmp_path / "case/0").velocity, np.tile([0.1, 0.2, -0.3], (24, 1)))


def test_one_time_of_two_names_and_times_without_a_velocity(tmp_path):
    case(tmp_path / "case", ("2.0", "2", "3"), {"fvSchemes": EULER})
    found = played(tmp_path / "case")
    assert [time for time, _ in found.files] == [2.0, 3.0]
    assert any("case/2: is left out" in remark and "case/2.0" in remark for remark in found.remarks)
    for time in ("2", "2.0", "3"):
        Writer(tmp_path / "case").raw_field(time, "U", "uniform $U0")
    with pytest.raises(WindFileError, match=r"case/3/U: .*\$U0"):
        series(tmp_path / "case")


def test_a_dictionary_of_any_form(tmp_path):
    (tmp_path / "d").write_bytes(
        b'\xef\xbb\xbfFoamFile { a b; }\n#includeEtc "x"\nn 3; a { b { c $n; d "x y"; } e $:n; f #calc "1"; }\n'
        b"g #codeStream { code #{ int x = 1; { #}; };\n h {"
    )
    found = dictionary(tmp_path / "d")
    assert found["a"]["b"] == {"c": "3", "d": '"x y"'}
    assert (found["a"]["e"], found["a"]["f"], found["h"]) == ("3", '#calc "1"', {})


@pytest.mark.parametrize("binary", [False, True])
def test_a_list_of_one_value_and_processors_without_cells(tmp_path, binary):
    points, cells = box((5, 4, 2), graded)
    x = means(points, cells)
    parts = [np.arange(0), np.arange(15), np.arange(0), np.arange(15, 40)]
    writers = decomposed(tmp_path / "case", points, cells, parts, binary=binary)
    for writer, part in zip(writers, parts, strict=True):
        writer.field("0.5", "U", speeds(x[part]))
        value = b"(0.2 -0.1 0)"
        if binary:
            value = np.array([0.2, -0.1, 0.0]).tobytes()
        inner = f"dimensions [0 1 -1 0 0 0 0];\ninternalField nonuniform List<vector> {len(part)}".encode()
        inner += b"{" + value + b"};\n" if len(part) else b"();\n"
        writer.write("1/U", "volVectorField", inner)
    first, second = (read(path) for _, path in played(tmp_path / "case").files)
    np.testing.assert_array_equal(first.velocity, speeds(x))
    np.testing.assert_allclose(np.array(first.box), [LOW, HIGH], atol=1e-12)
    np.testing.assert_array_equal(second.velocity, np.tile([0.2, -0.1, 0.0], (40, 1)))


def test_a_missing_processor_is_named(tmp_path):
    points, cells = box((4, 2, 2), graded)
    for writer in decomposed(tmp_path / "case", points, cells, np.split(np.arange(16), 4)):
        writer.field("1", "U", np.ones((4, 3)))
    (tmp_path / "case/processor2").rename(tmp_path / "case/away")
    with pytest.raises(WindFileError, match="processor2: is missing"):
        series(tmp_path / "case")
    (tmp_path / "case/away").rename(tmp_path / "case/processor2")
    (tmp_path / "case/processor2/constant/polyMesh").rename(tmp_path / "mesh")
    with pytest.raises(WindFileError, match="processor2/constant/polyMesh: is missing"):
        series(tmp_path / "case")


@pytest.mark.parametrize(
    "inner",
    ["uniform $U0", "$internalField", "uniform (0 $v 0)", '#include "U.internal"', "nonuniform #codeStream { }",
     "uniform #calc \"1\"", "uniform ${U0}"],
)  # fmt: skip
def test_a_time_of_macros_is_left_out(tmp_path, inner):
    case(tmp_path / "case", ("2", "3"), {"fvSchemes": EULER})
    Writer(tmp_path / "case").raw_field("0", "U", inner)
    found = played(tmp_path / "case")
    assert [time for time, _ in found.files] == [2.0, 3.0]
    assert "case/0: is left out" in found.remarks[0]
    with pytest.raises(WindFileError, match="0/U: its internalField is a macro"):
        read(tmp_path / "case/0")
    with pytest.raises(WindFileError, match="0/U: its internalField is a macro"):
        site(tmp_path, "case/0")


def test_the_last_iteration_without_macros_is_the_steady_wind(tmp_path):
    case(tmp_path / "case", ("0", "100"), {"controlDict": "application simpleFoam;"})
    Writer(tmp_path / "case").raw_field("100", "U", "uniform $U0")
    found = played(tmp_path / "case")
    assert [path.name for _, path in found.files] == ["0"]
    assert "case/100: is left out" in found.remarks[0]


@pytest.mark.parametrize(
    ("name", "dimensions", "fits"),
    [
        ("U", "0 1 -1 0 0 0 0", True), ("U", "0 1 -1 0 0", True), ("U", "m s^-1", True), ("U", "velocity", True),
        ("U", "1 -2 -1 0 0 0 0", False), ("U", "0 3 -1 0 0 0 0", False), ("U", "cm/s", False), ("U", "", False),
        ("U", "0 1 -1", False), ("U", "a b", False),
        ("nut", "0 2 -1 0 0 0 0", True), ("nut", "m^2/s", True), ("nut", "1 -1 -1 0 0 0 0", False),
    ],
)  # fmt: skip
def test_dimensions_are_those_of_the_quantity(tmp_path, name, dimensions, fits):
    case(tmp_path / "case")
    Writer(tmp_path / "case").raw_field(
        "1", name, "uniform (1 2 3)" if name == "U" else "uniform 1e-3", dimensions
    )
    if fits:
        assert read(tmp_path / "case/1").velocity.shape == (24, 3)
    else:
        with pytest.raises(WindFileError, match=rf"case/1/{name}: its dimensions \[.*\] are not those of"):
            read(tmp_path / "case/1")


def test_a_field_without_dimensions_is_taken_as_metres_per_second(tmp_path):
    case(tmp_path / "case")
    Writer(tmp_path / "case").write("1/U", "volVectorField", b"internalField uniform (0.1 0 0);")
    assert "m/s" in read(tmp_path / "case/1").remarks[0]
    assert list(site(tmp_path).facts().remarks) == list(read(tmp_path / "case/1").remarks)


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b"\xff\xfe"])
def test_byte_order_marks(tmp_path, mark):
    case(tmp_path / "case")
    before = read(tmp_path / "case/1")
    for name in ("1/U", "constant/polyMesh/points", "constant/polyMesh/owner"):
        text = (tmp_path / "case" / name).read_bytes()
        (tmp_path / "case" / name).write_bytes(
            mark + (text if mark[0] == 0xEF else text.decode().encode("utf-16-le"))
        )
    after = read(tmp_path / "case/1")
    np.testing.assert_array_equal(before.place, after.place)
    np.testing.assert_array_equal(before.velocity, after.velocity)


def test_regions(tmp_path):
    x = case(tmp_path / "case", ("1", "2"), region="air")
    Writer(tmp_path / "case", region="wall").mesh(*box((2, 2, 2), graded))
    Writer(tmp_path / "case", region="wall").field("2", "T", np.full(8, 300.0))
    for name in ("case", "case/air"):
        found = played(tmp_path / name)
        assert [path for _, path in found.files] == [tmp_path / f"case/{n}/air" for n in (1, 2)]
        np.testing.assert_array_equal(read(found.files[1][1]).velocity, 2 * speeds(x))
    assert "region air" in played(tmp_path / "case").remarks[0]
    for name in ("case/2", "case/2/air"):
        np.testing.assert_array_equal(read(tmp_path / name).velocity, 2 * speeds(x))
        assert len(site(tmp_path, name).files) == 1
    Writer(tmp_path / "case", region="wall").field("2", "U", np.ones((8, 3)))
    for name in ("case", "case/2"):
        with pytest.raises(WindFileError, match="several regions with a velocity U: air, wall"):
            site(tmp_path, name)
    np.testing.assert_array_equal(read(tmp_path / "case/2/wall").velocity, np.ones((8, 3)))
    assert len(played(tmp_path / "case/air").files) == 2


def test_a_decomposed_case_of_regions(tmp_path):
    points, cells = box((4, 2, 2), graded)
    parts = np.split(np.arange(16), [6])
    for writer, part in zip(
        decomposed(tmp_path / "case", points, cells, parts, region="fluid"), parts, strict=True
    ):
        writer.field("3", "U", speeds(means(points, cells)[part]))
    ((_, path),) = played(tmp_path / "case").files
    np.testing.assert_array_equal(read(path).velocity, speeds(means(points, cells)))


@pytest.mark.parametrize("axis", "xyz")
def test_one_layer_of_cells_along_an_axis(tmp_path, axis):
    count = [3, 3, 3]
    count["xyz".index(axis)] = 1
    points, cells = box(count, lambda x: x * [2.0, 1.5, 1.0] + 1e-17)
    writer = Writer(tmp_path / "case")
    writer.mesh(points, cells)
    writer.field("1", "U", np.full((9, 3), 0.1))
    for dim in (2, 3):
        if dim == 2 and axis == "z":
            assert site(tmp_path, dim=2).levels == pytest.approx((0.0, 1.0))
            continue
        with pytest.raises(WindFileError, match=f"one layer of cells along {axis} .*{dim}-D run"):
            site(tmp_path, dim=dim)


def test_a_wedge_is_no_plane_flow(tmp_path):
    points, cells = box(
        (4, 3, 1), lambda x: np.stack([x[..., 0], x[..., 1] + 0.5, (x[..., 2] - 0.5) * (x[..., 1] + 0.5)], -1)
    )
    writer = Writer(tmp_path / "case")
    writer.mesh(points, cells)
    writer.field("1", "U", np.full((12, 3), 0.1))
    for dim in (2, 3):
        with pytest.raises(WindFileError, match=r"along z, 0.5 to 1.5 m thick: a wedge"):
            site(tmp_path, dim=dim)


@pytest.mark.parametrize(
    ("inner", "what"), [("uniform $nut0", r"0/nut: .*\$nut0"), ("", "0/nut: is missing")]
)
def test_an_eddy_viscosity_that_some_times_lack_is_left_out(tmp_path, inner, what):
    case(tmp_path / "case", ("0", "1", "2"), {"fvSchemes": EULER})
    for time in ("1", "2"):
        Writer(tmp_path / "case").raw_field(time, "nut", "uniform 1e-3", "0 2 -1 0 0 0 0")
    if inner:
        Writer(tmp_path / "case").raw_field("0", "nut", inner, "0 2 -1 0 0 0 0")
        assert read(tmp_path / "case/0").eddy_viscosity is None
    found = site(tmp_path)
    assert [found.read(path).eddy_viscosity for _, path in found.files] == [None, None, None]
    (remark,) = found.facts().remarks
    assert re.search(what, remark)
    assert site(tmp_path, "case/1").first.eddy_viscosity is not None
    assert site(tmp_path, "case/1").facts().remarks == ()


def test_a_flow_in_another_unit_is_reported(tmp_path):
    case(tmp_path / "case")
    assert (
        Site(ImportedWind(kind="imported", files="case"), (0.11, 0.07, 0.05), tmp_path).facts().remarks == ()
    )
    (remark,) = (
        Site(ImportedWind(kind="imported", files="case"), (0.002, 0.0012, 0.0008), tmp_path).facts().remarks
    )
    assert "1e+03 times" in remark


def test_a_second_mesh_counts_for_later_times(tmp_path):
    """snappyHexMesh without -overwrite writes its meshes into 1, 2 and 3."""
    case(tmp_path / "case", ("0", "5"), {"fvSchemes": EULER})
    Writer(tmp_path / "case").write("3/polyMesh/faces", "faceList", b"0()")
    assert played(tmp_path / "case/0").files == [(0.0, tmp_path / "case/0")]
    for name in ("case", "case/5"):
        with pytest.raises(WindFileError, match=r"3/polyMesh: .* snappyHexMesh"):
            series(tmp_path / name)


def test_a_foam_file_of_paraview_and_the_collated_form(tmp_path):
    case(tmp_path / "case", ("1", "2"))
    (tmp_path / "case/case.foam").touch()
    assert played(tmp_path / "case/case.foam").files == played(tmp_path / "case").files
    (tmp_path / "other/processors4/constant").mkdir(parents=True)
    with pytest.raises(WindFileError, match="reconstructPar"):
        series(tmp_path / "other")


ROOM = """
duration: 5
domain: {size: [2, 1.2, 0.8], spacing: 0.2}
wind: {kind: imported, files: case}
gas: {kind: eulerian, sources: [{position: [0.5, 0.6, 0.4], rate: 1 mg/s}]}
"""


def test_check_prints_what_was_read(tmp_path):
    case(tmp_path / "case", ("0", "2", "4"), {"fvSchemes": EULER})
    Writer(tmp_path / "case").raw_field("1", "U", "uniform $U0")
    (tmp_path / "room.yaml").write_text(ROOM)
    facts = load(tmp_path / "room.yaml").resources.facts["wind"]
    fastest = 4 * np.linalg.norm(read(tmp_path / "case/2").velocity / 2, axis=1).max()
    for part in (
        "4 s from 0 s on, 2 s apart",
        "24 cell centres",
        f"{fastest:.3g} m/s",
        "x -5 to -3 m",
        "z 0 to 0.8 m",
    ):
        assert part in facts.text
    assert any("case/1: is left out" in remark for remark in facts.remarks)
    (tmp_path / "room.yaml").write_text(ROOM.replace("case}", "case, origin: [-4.0, -1, 0]}"))
    with pytest.raises(ScenarioError, match=r"use at most 2 m, and -5 as number 1 of"):
        load(tmp_path / "room.yaml")
