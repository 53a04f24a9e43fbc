"""Layout of OpenFOAM cases: parts, regions, times, and whether the times are iterations of a steady solver.

    CASE/constant/[REGION/]polyMesh       the mesh; of a decomposed case in each processorN
    CASE/TIME/[REGION/]U                  the velocity at a time
    CASE/system/controlDict               `application`
    CASE/system/[REGION/]fvSchemes        `ddtSchemes`

Steady are the SIMPLE family of solvers and potentialFoam, whatever the schemes say, and every solver with a steady or
pseudo-transient (local time step) scheme. Iterations of these are no seconds.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_plume.files.openfoam_file import dictionary, exists, unresolved_macro
from taichi_plume.files.wind_points import MOST_NUMBER, WindFileError

TIME = re.compile(r"\d+(\.\d*)?(e[-+]?\d+)?", re.IGNORECASE)
PROCESSOR = re.compile(r"processor(\d{1,9})")
STEADY_SCHEMES = {"steadyState", "localEuler", "CoEuler", "SLTS"}
"""Time schemes without one time for all cells."""
STEADY_SOLVERS = re.compile(r"simple\w*|\w*Simple\w*|\w*[pP]otentialFoam|adjoint\w*|boundaryFoam")
MOST_NAMES = 10  # listed in a message


@dataclass(frozen=True)
class Series:
    """Times [s] of a case with their folders, in order, and remarks on what was assumed or left out."""

    files: list[tuple[float, Path]]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Moment:
    """A time of a case: its folder is CASE/TIME or, of a region, CASE/TIME/REGION."""

    case: Path
    time: str
    region: str = ""

    @property
    def folders(self) -> list[tuple[Path, Path]]:
        """Folders (mesh, fields) of each part: the whole case, or its processors."""
        return [
            (_mesh(part, self.region), part / self.time / self.region)
            for part in parts(self.case, self.region, self.time)
        ]


def moment_of(path: Path) -> Moment | None:
    """Return the time of a case that a path names; None if it names none. Raises WindFileError on several regions."""
    if not is_time(path):
        return None
    if TIME.fullmatch(path.name):
        return Moment(path.parent, path.name, _region(path.parent, path.name))
    return Moment(path.parent.parent, path.parent.name, path.name)


def is_time(path: Path) -> bool:
    """Return whether a path CASE/TIME or CASE/TIME/REGION names a time of a case; the folder itself need not exist."""
    if TIME.fullmatch(path.name):
        return is_case(path.parent)
    return TIME.fullmatch(path.parent.name) is not None and path.name in regions(path.parent.parent)


def is_case(path: Path) -> bool:
    """Return whether a path is the folder of an OpenFOAM case, reconstructed or decomposed, with or without regions."""
    return any(os.path.isdir(_mesh(part)) for part in (path, path / "processor0")) or bool(regions(path))


def regions(case: Path) -> list[str]:
    """Return the names of the regions of a case that have a mesh of their own."""
    names: set[str] = set()
    for part in (case, case / "processor0"):
        try:
            folders = list((part / "constant").iterdir())
        except OSError:
            continue
        names |= {folder.name for folder in folders if os.path.isdir(folder / "polyMesh")}
    return sorted(names)


def series(path: Path) -> Series | None:
    """Return the times to play of CASE, CASE/REGION or CASE/NAME.foam, or the one time of CASE/TIME.

    None if the path is none of these. Raises WindFileError.
    """
    if moment := moment_of(path):
        for part in parts(moment.case, moment.region, moment.time)[:1]:
            _require_one_mesh(part, moment.region, float(moment.time))
        return Series([(0.0, path)])
    if path.suffix.lower() in (".foam", ".openfoam"):  # ParaView's name of the case around it
        path = path.parent
    if os.path.isdir(path) and is_case(path):
        region = _region(path)
        remark = (f"{path}: only its region {region} has a velocity U, which is read",) if region else ()
        return _series(path, region, remark)
    if path.name in regions(path.parent):
        return _series(path.parent, path.name, ())
    if os.path.isdir(path) and any(re.fullmatch(r"processors\d+.*", name) for name in os.listdir(path)):
        raise WindFileError(f"{path}: has its parts in collated form (processorsN); run reconstructPar first")
    return None


def _series(case: Path, region: str, remarks: tuple[str, ...]) -> Series:
    part = parts(case, region)[0]
    names = times(part, region)
    if not names:
        raise WindFileError(f"{case}: has no time folder with a file {Path(region) / 'U'}")
    late = max(names)
    if late > MOST_NUMBER:
        raise WindFileError(f"{case / names[late]}: its time is above {MOST_NUMBER:g} s")
    remarks += tuple(
        f"{part / name}: is left out: {part / names[float(name)]} is of the same time"
        for name in _time_names(part, region)
        if name != names[float(name)]
    )
    is_steady, reason = steadiness(case, region)
    files, fault = [], ""
    for key in sorted(names, reverse=bool(is_steady)):
        folder = part / names[key] / region
        if macro := unresolved_macro(folder / "U"):
            what = f"its internalField is a macro of OpenFOAM ({macro}), which is not resolved"
            fault = f"{folder / 'U'}: {what}"
            remarks += (f"{case / names[key] / region}: is left out: {what}",)
            continue
        files.append((key, case / names[key] / region))
        if is_steady:
            break
    _require_one_mesh(part, region, files[0][0] if is_steady and files else late)
    if not files:
        raise WindFileError(f"{fault}; no other time has a readable velocity")
    if is_steady:
        last, path = files[0]
        others = f"the last of {len(names)} times ({last:g})" if len(names) > 1 else f"its time ({last:g})"
        remarks += (
            f"{case}: is steady ({reason}): its times are iterations, no seconds; {others} is taken as a steady wind; "
            f"{case.name}/TIME names another",
        )
        return Series([(0.0, path)], remarks)
    if len(files) > 1 and is_steady is None:
        remarks += (f"{case}: {reason}; its times are taken as seconds",)
    return Series(files, remarks)


def _require_one_mesh(part: Path, region: str, last: float) -> None:
    """Raise WindFileError if a time up to `last` [s] of a case or processor folder has a mesh of its own."""
    for name in sorted(filter(TIME.fullmatch, os.listdir(part)), key=float, reverse=True):
        mesh = part / name / region / "polyMesh"
        if float(name) <= last and (exists(mesh / "points") or exists(mesh / "faces")):
            raise WindFileError(
                f"{mesh}: is a second mesh besides constant/polyMesh: the mesh moves or changes, which is not read; a "
                "mesh of snappyHexMesh (without -overwrite) can take the place of constant/polyMesh"
            )


def _region(case: Path, time: str = "") -> str:
    """Return "" for the mesh of the case itself, or the only region with a velocity. Raises WindFileError.

    time: name of the time that is needed; by default any.
    """
    names = regions(case)
    if not names:
        return ""
    has_velocity = []
    for name in ("", *names):
        folders = [part for part in (case, case / "processor0") if os.path.isdir(_mesh(part, name))]
        if any(exists(part / time / name / "U") if time else times(part, name) for part in folders):
            has_velocity.append(name)
    if "" in has_velocity or (not has_velocity and os.path.isdir(_mesh(case))):
        return ""
    if len(has_velocity) != 1:
        listed = ", ".join((has_velocity or names)[:MOST_NAMES])
        what = "several regions with a velocity U" if has_velocity else "regions, none with a velocity U"
        raise WindFileError(f"{case / time}: has {what}: {listed}; name one, as {case.name}/REGION")
    return has_velocity[0]


def _mesh(part: Path, region: str = "") -> Path:
    return part / "constant" / region / "polyMesh"


def parts(case: Path, region: str = "", time: str = "") -> list[Path]:
    """Return [case], or its processor folders if only these hold the time. Raises WindFileError if it is no case.

    time: name of the time to read, by default all times.
    """
    whole = [case] if _mesh(case, region).is_dir() else []
    split = _processors(case, region)
    if not whole and not split:
        name = Path("constant") / region / "polyMesh"
        raise WindFileError(f"{case}: is no case of OpenFOAM: neither the folder nor processor0 has {name}")
    if not whole or not split:
        return whole or split
    if time:
        return whole if exists(case / time / region / "U") else split
    return split if times(split[0], region).keys() - times(case, region).keys() else whole


def _processors(case: Path, region: str) -> list[Path]:
    """Return the processor folders with a mesh, in order. Raises WindFileError if one lacks among them."""
    try:
        matches = [PROCESSOR.fullmatch(name) for name in os.listdir(case)]
    except OSError:
        return []
    numbers = sorted(int(match[1]) for match in matches if match)
    meshed = [n for n in numbers if _mesh(case / f"processor{n}", region).is_dir()]
    for n in range(numbers[-1] + 1 if meshed else 0):
        if n not in numbers:
            raise WindFileError(f"{case / f'processor{n}'}: is missing, but there is processor{numbers[-1]}")
        if n not in meshed and times(case / f"processor{n}", region):
            raise WindFileError(f"{_mesh(case / f'processor{n}', region)}: is missing")
    return [case / f"processor{n}" for n in meshed]


def times(part: Path, region: str = "") -> dict[float, str]:
    """Return the names of the times of a case or processor folder that have a velocity, by their value."""
    return {float(name): name for name in _time_names(part, region)}


def _time_names(part: Path, region: str) -> list[str]:
    """Return the sorted names of the folders of times that have a velocity; several may name one time (2, 2.0)."""
    try:
        names = sorted(name for name in os.listdir(part) if TIME.fullmatch(name))
    except OSError as error:
        raise WindFileError(f"{part}: cannot be read: {error.strerror or error}") from None
    return [name for name in names if exists(part / name / region / "U")]


# ---------------------------------------------------------------- steady or transient


def steadiness(case: Path, region: str = "") -> tuple[bool | None, str]:
    """Return whether a case is steady, None if its files do not say so, and what they say."""
    system, faults = case / "system", []
    places = dict.fromkeys((region, ""))
    schemes = next(filter(None, (_entries(system / place / "fvSchemes", faults) for place in places)), {})
    control = _entries(system / "controlDict", faults)
    stated = (
        " ".join(str(control.get(key, "")) for key in ("application", "solver")).replace('"', " ").split()
    )
    solver = next((name for name in map(os.path.basename, stated) if STEADY_SOLVERS.fullmatch(name)), "")
    if solver:
        return True, f"system/controlDict: application {solver}"
    listed = schemes.get("ddtSchemes")
    scheme = _time_scheme(listed)
    steady = sorted(STEADY_SCHEMES.intersection(scheme.split()))
    if steady:
        return True, f"system/fvSchemes: ddtSchemes {steady[0]}"
    directive = (listed if isinstance(listed, dict) else schemes).get("#", "")
    if scheme and not scheme.startswith(("$", "#")) and scheme != "none" and not directive:
        return False, f"system/fvSchemes: ddtSchemes {scheme}"
    what = f"states ddtSchemes {scheme}" if scheme else "does not state ddtSchemes in system/fvSchemes"
    what += f" and has {directive}, which is not resolved" if directive else ""
    return None, "; ".join([f"{what}, so whether the case is steady is unknown", *faults])


def _entries(path: Path, faults: list[str]) -> dict[str, Any]:
    try:
        return dictionary(path) if exists(path) else {}
    except WindFileError as error:
        faults.append(str(error))
        return {}


def _time_scheme(schemes: object) -> str:
    """Return the scheme of ddt(U) in a dictionary `ddtSchemes`, else its default; "" without one."""
    if not isinstance(schemes, dict):
        return ""
    scheme = str(schemes.get("default", ""))
    for key, value in schemes.items():
        if any(text == key.replace(" ", "") or _matches(key, text) for text in ("ddt(U)", "ddt(rho,U)")):
            scheme = str(value)
    return scheme


def _matches(pattern: str, text: str) -> bool:
    try:
        return len(pattern) < 100 and re.fullmatch(pattern, text) is not None
    except re.error:
        return False
