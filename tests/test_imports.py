"""Which room may know which: each states it in its `MAY_IMPORT`, kept by walking the imports."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = "taichi_plume"
ROOMS = {
    folder.name: folder
    for folder in [*(ROOT / PACKAGE).iterdir(), *ROOT.iterdir()]
    if (folder / "__init__.py").exists() and folder.name != PACKAGE
}
SECTIONS = [path.stem for path in (ROOT / PACKAGE / "scenario").glob("*.py") if path.stem != "__main__"]
SCENARIO = ", ".join(f"{PACKAGE}.scenario.{name}" for name in SECTIONS)
HEAVY = {"taichi", "scipy", "open3d", "matplotlib", "rerun", "zarr"}
GROUND = ("quantities", "version")  # modules that import no other
FREE = {"validation"}  # it looks at everything, as the application at the top of the package does


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def modules(node: ast.AST, path: Path) -> list[str]:
    """The dotted names that a statement imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, f"{path.name}: a relative import"
        return [f"{node.module}.{alias.name}" for alias in node.names]
    return []


def imported(path: Path) -> Iterator[str]:
    """What a file imports, at its top or anywhere inside."""
    for node in ast.walk(tree(path)):
        yield from modules(node, path)


@pytest.mark.parametrize("room", sorted(set(ROOMS) - FREE))
def test_rooms_look_only_where_they_may(room):
    may = import_module(f"{PACKAGE}.{room}").MAY_IMPORT
    for path in ROOMS[room].rglob("*.py"):
        for name in imported(path):
            first, _, rest = name.partition(".")
            assert not (ROOT / first / "__init__.py").exists() or first == PACKAGE, (
                f"{path.relative_to(ROOT)}: {name} is a second name of {PACKAGE}.{name}"
            )
            known = (
                first != PACKAGE
                or rest.startswith("__main__")
                or any(f"{rest}.".startswith(f"{one}.") for one in (room, *may, *GROUND))
            )
            assert known, f"{path.relative_to(ROOT)} imports {name}; {room} may import {may}"


def test_only_the_recording_knows_rerun():
    for path in [*(ROOT / PACKAGE).glob("*.py"), *(p for room in ROOMS.values() for p in room.rglob("*.py"))]:
        if ROOMS["record"] not in path.parents:
            assert not any(name.split(".")[0] == "rerun" for name in imported(path)), path


def test_heavy_packages_are_imported_only_where_used():
    """Each step imports more, in one process; a command with a fault imports no more than its checks."""
    code = ["import sys"]
    for imports, heavy in (
        ("taichi_plume, taichi_plume.cli.examples", {"taichi", "numpy", "pydantic"}),
        (SCENARIO, HEAVY),
        ("taichi_plume.assembly.preparation", HEAVY),
        ("taichi_plume.cli.run", HEAVY | {"pyarrow"}),
        ("taichi_plume.assembly.assemble", HEAVY - {"taichi", "scipy"} | {"scipy.signal", "scipy.stats"}),
        ("taichi_plume.execution.result, taichi_plume.solvers.gas", {"scipy.stats", "scipy.optimize"}),
    ):
        code += [f"import {imports}", "taichi_plume.cli.run.main(['nowhere.yaml'])" * ("cli.run" in imports)]
        code += [f"print(*(set({sorted(heavy)}) & sys.modules.keys()))"]
    assert printed("\n".join(code), ROOT) == []


def printed(code: str, folder: Path) -> list[str]:
    """Words that a program prints."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout.split()


@pytest.mark.parametrize("wheel", [False, True])
def test_the_packages_are_found_without_links(tmp_path, wheel):
    """In a checkout git may leave a text file where a link was; in a wheel nothing beside the package belongs to it."""
    package = tmp_path / PACKAGE
    package.mkdir()
    for name in ("__init__.py", "version.py"):
        (package / name).write_bytes((ROOT / PACKAGE / name).read_bytes())
    for name in ("solvers", "agents", "validation"):
        inside, beside = package / name, tmp_path / name
        (inside if wheel else beside).mkdir()
        ((inside if wheel else beside) / "__init__.py").touch()
        if not wheel:
            inside.write_text(f"../{name}")
    code = (
        "import taichi_plume as p, taichi_plume.solvers, taichi_plume.agents, taichi_plume.validation;"
        "print(p.solvers.__file__, len(p.__path__))"
    )
    place = package if wheel else tmp_path
    assert printed(code, tmp_path) == [str(place / "solvers" / "__init__.py"), "1" if wheel else "2"]
    assert not any(path.is_symlink() for folder in ROOMS.values() for path in (folder, *folder.rglob("*")))
