"""Which part may know which: the README's picture, kept by walking the imports."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = "taichi_plume"
APPLICATION = {
    "recording",
    "results",
    "run",
    "assemble",
    "progress",
    "scores",
    "map_scores",
    "maps",
    "drawing",
    "layout",
    "scene",
    "disk",
    "filming",
    "plume_log",
}
FORBIDDEN = {
    "core": {"solvers", "agents", "validation"} | APPLICATION,
    "solvers": {"agents", "validation", "simulation"} | APPLICATION,
    "agents": {"solvers", "validation", "simulation"} | APPLICATION,
    "recording": {"solvers", "agents", "validation", "assemble", "run"},
}


def sources() -> dict[str, list[Path]]:
    core = [p for p in (ROOT / PACKAGE).glob("*.py") if p.stem not in APPLICATION | {"__init__"}]
    shown = [ROOT / PACKAGE / f"{name}.py" for name in APPLICATION - {"assemble", "run", "maps"}]
    return {
        "core": core,
        "solvers": list((ROOT / "solvers").glob("*.py")),
        "agents": list((ROOT / "agents").glob("*.py")),
        "recording": [path for path in shown if path.exists()],
    }


def imported(path: Path) -> set[str]:
    """The parts of our package that a file imports, at its top or anywhere inside."""
    parts = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: a relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            assert name.split(".")[0] not in {"solvers", "agents", "validation"}, (
                f"{path.name}: imports {name}"
            )
            if name.startswith(PACKAGE + "."):
                parts.add(name.split(".")[1])
    return parts


@pytest.mark.parametrize("layer", FORBIDDEN)
def test_parts_look_only_where_they_may(layer):
    files = sources()[layer]
    assert files
    for path in files:
        wrong = imported(path) & FORBIDDEN[layer]
        assert not wrong, f"{path.relative_to(ROOT)} imports {sorted(wrong)}"


def test_only_the_recording_knows_rerun():
    for path in [
        *(ROOT / PACKAGE).glob("*.py"),
        *(ROOT / "solvers").glob("*.py"),
        *(ROOT / "agents").glob("*.py"),
    ]:
        tree = ast.parse(path.read_text())
        names = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
        }
        names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        if any(name.split(".")[0] == "rerun" for name in names):
            assert path.stem in {"recording", "scene", "layout", "drawing"}
