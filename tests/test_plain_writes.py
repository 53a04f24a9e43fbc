"""Files are written by `disk.written_whole` and its sisters, which follow no link and leave no half file.

The syntax trees of the whole package are searched for calls that write to a path. The path must be a temporary file of
`files/disk.py`, or a new file (mode "x"), or one of the few in ALLOWED.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ("taichi_plume", "solvers", "agents")
SISTERS = {
    "written_whole",
    "new_beside",
    "new_folder_beside",
    "_fresh",
}  # the last one fills a list of `new_beside`
SAFE = "fresh"  # parameter that takes a file of the sisters
OF_RECEIVER = {"write_text", "write_bytes", "touch"}
OF_FIRST = {
    "savefig", "to_netcdf", "to_csv", "to_parquet", "to_json", "to_feather", "to_excel", "save", "savez",
    "savez_compressed", "savetxt", "tofile", "ParquetWriter", "CSVWriter", "truncate",
}  # fmt: skip
OF_SECOND = {"copy", "copy2", "copyfile", "copytree", "write_table", "write_csv", "write_feather"}
MODULES = {"shutil", "np", "numpy", "pq", "os", "pa"}  # whose functions take paths
OTHERS = {"webbrowser", "zenoh", "zarr", "Image", "opener"}  # whose `open` takes no path, or creates nothing
WITH_MODE = {"open", "File", "ZipFile"}
NEW_FILE = {"O_EXCL"}
LOCKED = "a file of a locked folder, in which links are refused before the lock"
OWN = "a temporary folder of the process"
ALLOWED = {
    ("taichi_plume/contests/page.py", "mean_plume"): "a file of `written_whole`, opened",
    ("taichi_plume/report/theme.py", "NotebookFigure.savefig"): "the file that the user names",
    ("taichi_plume/draw/runs.py", "Run.start"): OWN,
    ("taichi_plume/draw/downloads.py", "zipped"): OWN,
    (
        "taichi_plume/execution/forces_table.py",
        "ForceTable.resume",
    ): LOCKED,
    (
        "taichi_plume/execution/plume_log.py",
        "PlumeLogger._open",
    ): LOCKED,
    (
        "taichi_plume/execution/repair.py",
        "_lines",
    ): LOCKED,
    (
        "taichi_plume/files/plumesim_log.py",
        "shorten",
    ): LOCKED,
    (
        "taichi_plume/files/run_tables.py",
        "GrowingTable._save",
    ): LOCKED,
    (
        "taichi_plume/record/stream.py",
        "Stream._abandon",
    ): LOCKED,
    (
        "taichi_plume/files/run_folder.py",
        "cut",
    ): LOCKED,
    ("taichi_plume/record/live.py", "open_viewer"): OWN,
    ("taichi_plume/record/live.py", "web_viewer_files"): OWN,
    ("taichi_plume/serve/zenoh_link.py", "ZenohLink.__init__"): OWN,
    (
        "taichi_plume/studies/workers.py",
        "_begin_process",
    ): LOCKED,
}


def root(node: ast.expr | None) -> str:
    """The name at which an expression begins, such as `folder` of `folder.path / "x"` and of `Path(folder)`."""
    while True:
        if isinstance(node, ast.Attribute | ast.Subscript):
            node = node.value
        elif isinstance(node, ast.BinOp):
            node = node.left
        elif isinstance(node, ast.Call):
            node = node.args[0] if node.args and isinstance(node.func, ast.Name) else node.func
        else:
            return node.id if isinstance(node, ast.Name) else ""


def name_of(call: ast.expr) -> str:
    func = call.func if isinstance(call, ast.Call) else None
    return func.attr if isinstance(func, ast.Attribute) else func.id if isinstance(func, ast.Name) else ""


def mode_of(call: ast.Call, at: int) -> str:
    """The mode of a call like `open`; "r" by default, "w" if it is a variable `mode`."""
    given = [key.value for key in call.keywords if key.arg == "mode"] or call.args[at : at + 1]
    if not given:
        return "r"
    if isinstance(given[0], ast.Name):
        return "w" if given[0].id == "mode" else "r"
    return str(given[0].value) if isinstance(given[0], ast.Constant) else "r"


def written(call: ast.Call) -> ast.expr | None:
    """The path to which a call writes; None if it writes to none, or to a new file alone."""
    name, method = name_of(call), isinstance(call.func, ast.Attribute)
    receiver = call.func.value if isinstance(call.func, ast.Attribute) else None
    module = root(receiver) in MODULES
    if root(receiver) in OTHERS or (call.args and ast.unparse(call.args[0]) == "os.devnull"):
        return None
    if name in OF_RECEIVER and method:
        return receiver
    if name == "open" and root(receiver) == "os":
        flags = {node.attr for node in ast.walk(call) if isinstance(node, ast.Attribute)}
        writes = flags & {"O_WRONLY", "O_RDWR", "O_CREAT", "O_TRUNC", "O_APPEND"}
        return call.args[0] if writes and not flags & NEW_FILE else None
    if name in WITH_MODE:
        own = name == "open" and method and not module  # a method of a path
        mode = mode_of(call, 0 if own else 1)
        if "x" in mode or not set(mode) & set("wa+"):
            return None
        return receiver if own else call.args[0] if call.args else None
    if name in OF_FIRST and call.args and (module or name not in ("save", "truncate")):
        return call.args[0]
    if name in OF_SECOND and module and len(call.args) > 1 and root(receiver) not in ("np", "numpy"):
        return call.args[1]
    return None


def bindings(scope: ast.AST) -> dict[str, ast.expr]:
    """The expression of each name that a `with`, an assignment or a loop of a function binds."""
    bound: dict[str, ast.expr] = {}
    for node in ast.walk(scope):
        if isinstance(node, ast.With):
            for item in node.items:
                for name in ast.walk(item.optional_vars) if item.optional_vars else ():
                    if isinstance(name, ast.Name):
                        bound.setdefault(name.id, item.context_expr)
        elif isinstance(node, ast.Assign | ast.For):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                for name in ast.walk(target):
                    if isinstance(name, ast.Name):
                        bound.setdefault(name.id, node.value if isinstance(node, ast.Assign) else node.iter)
    return bound


def is_temporary(path: ast.expr, bound: dict[str, ast.expr], depth: int = 0) -> bool:
    """Whether a path is, by the bindings of its function, a temporary file of `files/disk.py`."""
    if name_of(path) in SISTERS:
        return True
    if name_of(path) == "zip" and isinstance(path, ast.Call):
        return any(is_temporary(each, bound, depth + 1) for each in path.args)
    if name_of(path) in ("open", "BytesIO", "StringIO"):
        return "IO" in name_of(path) or is_temporary(_opened(path), bound, depth + 1)
    name = root(path)
    if name == SAFE and name not in bound:
        return True
    return name in bound and depth < 9 and is_temporary(bound[name], bound, depth + 1)


def _opened(call: ast.expr) -> ast.expr:
    assert isinstance(call, ast.Call)
    return call.func.value if isinstance(call.func, ast.Attribute) else call.args[0]


def functions(scope: ast.AST, name: str = "") -> Iterator[tuple[str, ast.AST, list[ast.Call]]]:
    """Name (with its class), tree and calls of a module and of each function; calls of inner functions are theirs."""
    calls, inner = [], []
    waiting = list(ast.iter_child_nodes(scope))
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner.append(node)
            continue
        if isinstance(node, ast.Call):
            calls.append(node)
        waiting += ast.iter_child_nodes(node)
    yield name, scope, calls
    for node in inner:
        yield from functions(node, f"{name}.{node.name}".lstrip("."))


def plain_writes(source: str) -> list[tuple[str, str]]:
    """Function and text of each call that writes to a path which is no temporary file."""
    found = []
    for name, scope, calls in functions(ast.parse(source)):
        bound = bindings(scope)
        for call in calls:
            path = written(call)
            if path is not None and not is_temporary(path, bound):
                found.append((name, ast.unparse(call)))
    return found


def test_files_are_written_whole():
    paths = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    places = {
        (path.relative_to(ROOT).as_posix(), function): text
        for path in paths
        if "validation" not in path.parts
        for function, text in plain_writes(path.read_text(encoding="utf-8"))
    }
    assert {place: text for place, text in places.items() if place not in ALLOWED} == {}
    assert ALLOWED.keys() <= places.keys(), "a write that is gone needs no leave"


@pytest.mark.parametrize(
    "line",
    [
        "path.write_text('a')", "Path(path).write_bytes(b'')", "(folder / 'x').open('wb')", "open(path, 'a')",
        "path.open(mode='r+b')", "open(path, mode)", "os.open(path, os.O_CREAT | os.O_WRONLY)", "np.savez(path, a=1)",
        "np.savetxt(folder / 'x', a)", "figure.savefig(out)", "data.to_netcdf(path)", "shutil.copyfile(a, path)",
        "pq.ParquetWriter(path, schema)", "zipfile.ZipFile(path, 'w')", "h5py.File(path, 'w')", "os.truncate(path, 1)",
        "with path.with_suffix('.new') as fresh: fresh.write_bytes(a)",
        "other = path.with_name('x')\n    with other.open('wb') as file: np.savez(file, a)",
    ],
)  # fmt: skip
def test_a_plain_write_is_found(line):
    assert plain_writes(f"def write(path):\n    {line}\n")


@pytest.mark.parametrize(
    "line",
    [
        "path.open('rb')", "open(path)", "path.open('xb')", "os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY)",
        "np.load(path)", "zipfile.ZipFile(path)", "state.save()", "shutil.copy",
        "with written_whole(path) as fresh: fresh.write_text('a')",
        "with disk.written_whole(path) as part, part.open('wb') as file: np.savez(file, a)",
        "part = disk.new_beside(path)\n    part.write_bytes(a)",
        "figure.savefig(fresh)",
    ],
)  # fmt: skip
def test_a_safe_write_is_none(line):
    assert not plain_writes(f"def write(path, fresh):\n    {line}\n")
