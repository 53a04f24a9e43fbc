"""Files are opened for reading by `guard/safe_open.py` alone, so that no pipe, device or link is opened unchecked."""

import ast
from pathlib import Path

import pytest
from test_imports import FREE, PACKAGE, ROOMS, ROOT, tree

GUARD = ROOT / PACKAGE / "guard" / "safe_open.py"
FILES = [
    path
    for folder in [ROOT / PACKAGE, *(folder for name, folder in ROOMS.items() if name not in FREE)]
    for path in sorted(folder.glob("*.py") if folder.name == PACKAGE else folder.rglob("*.py"))
    if path != GUARD
]
LIBRARIES = {
    "np": ("load", "loadtxt", "genfromtxt", "fromfile", "memmap"),
    "pq": ("ParquetFile", "read_table", "read_schema", "read_metadata", "ParquetDataset"),
    "pa": ("OSFile", "memory_map"),
    "pandas": ("read_csv", "read_parquet", "read_json", "read_table"),
    "polars": ("read_parquet", "scan_parquet", "read_csv"),
    "h5py": ("File",),
    "zarr": ("open", "open_group", "open_array", "open_consolidated"),
    "xarray": ("open_zarr", "open_dataset"),
    "Image": ("open",),
    "rr.chunk": ("RrdReader",),
    "zipfile": ("ZipFile",),
    "sqlite3": ("connect",),
    "os": ("open",),
    "io": ("open", "open_code"),
    "shutil": ("rmtree", "copyfile", "copy", "copy2", "copytree", "move"),
}
"""Functions that open a file by its path."""
CHECKED = {
    "contests/execution.py: fixed": "a file of the package",
    "files/bundled.py: example": "a file of the package",
    "report/html.py: page": "a file of the package",
    "report/references.py: library": "a file of the package",
    "guard/sandbox.py: _confine": "/proc",
    "execution/result.py: _processor": "/proc",
    "studies/workers.py: cores": "/sys",
    "files/disk.py: written_whole": "a file that it has created",
    "files/disk.py: remove": "a folder",
    "files/bundled.py: copied": "a file of the package",
    "draw/workplace.py: discard": "removes a folder that is no link and lies in that of the command",
    "files/run_tables.py: _save": "a file that the run has created",
    "record/live.py: _fault": "a file in a temporary folder",
    "envs/onnx_export.py: export_onnx": "a file in a temporary folder",
    "report/pictures.py: of": "a film that it has written",
    "execution/repair.py: _lines": "`RunFolder.again` has refused links and irregular files",
    "files/plumesim_log.py: shorten": "`RunFolder.again` has refused links and irregular files",
    "record/stream.py: take_over": "`RunFolder.again` has refused links and irregular files",
    "files/hdf5_arrays.py: _layout": "`open_array` has opened the path",
    "files/hdf5_arrays.py: open_hdf5": "`open_array` has opened the path",
    "record/old_recordings.py: _chunks": "`unopenable` has accepted the path",
    "files/zarr_groups.py: __init__": "`irregular` has accepted the folder",
    "files/zarr_groups.py: opened": "this process has created the group",
    "files/zarr_groups.py: open_dataset": "`Group` has opened the folder",
}
"""Functions that may open a file by its path, each with the reason."""


def reads(call: ast.Call) -> bool:
    """Return whether a call opens a file for reading by its path."""
    called = call.func
    if isinstance(called, ast.Name):
        return called.id == "open" and not _in_memory(call) and _mode(call, 1)
    if not isinstance(called, ast.Attribute):
        return False
    owner = ast.unparse(called.value)
    if owner in LIBRARIES:
        return called.attr in LIBRARIES[owner] and not _in_memory(call) and _mode(call, 1)
    if called.attr in ("read_text", "read_bytes"):
        return True
    methods = {"encoding", "errors", "newline", "buffering", "mode"}  # keys of `Path.open`
    return (
        called.attr == "open"
        and len(call.args) < 2
        and {key.arg for key in call.keywords} <= methods
        and (not call.args or isinstance(call.args[0], ast.Constant))
        and _mode(call, 0)
    )


def _mode(call: ast.Call, place: int) -> bool:
    """Return whether the mode of an `open` permits reading."""
    modes = [*call.args[place : place + 1], *(key.value for key in call.keywords if key.arg == "mode")]
    if not modes:
        return True
    if isinstance(modes[0], ast.Constant):
        return "r" in str(modes[0].value)
    return "O_WRONLY" not in ast.unparse(modes[0])


def _in_memory(call: ast.Call) -> bool:
    """Return whether a call reads bytes in memory, or the null device."""
    start = ast.unparse(call.args[0]) if call.args else ""
    return start.startswith(("io.BytesIO(", "BytesIO(", "os.devnull"))


def unchecked(path: Path) -> set[str]:
    """Return the functions of a source file that open files for reading by path, as "FILE: FUNCTION"."""
    found: set[str] = set()
    home = ROOT / PACKAGE if path.is_relative_to(ROOT / PACKAGE) else ROOT

    def visit(node: ast.AST, function: str, opened: frozenset[str]) -> None:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            function, opened = node.name, frozenset()
        if isinstance(node, ast.With):
            for item in node.items:
                guarded = ast.unparse(item.context_expr).startswith("open_regular(")
                if guarded and isinstance(item.optional_vars, ast.Name):
                    opened |= {item.optional_vars.id}
        if isinstance(node, ast.Call) and reads(node):
            if not (node.args and ast.unparse(node.args[0]) in opened):
                found.add(f"{path.relative_to(home)}: {function}")
        for child in ast.iter_child_nodes(node):
            visit(child, function, opened)

    visit(tree(path), "", frozenset())
    return found


def test_files_are_opened_by_the_guard_alone():
    found = set().union(*map(unchecked, FILES))
    assert found == CHECKED.keys()
    assert len(FILES) > 150


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("path.read_text()", True),
        ("path.open()", True),
        ("path.open('rb')", True),
        ("path.open('rb+')", True),
        ("path.open(encoding='utf-8')", True),
        ("open(path)", True),
        ("pq.ParquetFile(path)", True),
        ("np.load(path)", True),
        ("os.open(path, os.O_RDONLY)", True),
        ("path.open('wb')", False),
        ("open(path, 'w')", False),
        ("np.load(io.BytesIO(content))", False),
        ("os.open(path, os.O_WRONLY)", False),
        ("h5py.File(path, 'w')", False),
        ("session.open(address, timeout=1)", False),
    ],
)
def test_calls_that_read_by_path_are_found(line, expected):
    call = ast.parse(line, mode="eval").body
    assert isinstance(call, ast.Call)
    assert reads(call) is expected
