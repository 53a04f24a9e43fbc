"""Wall time of OpenFOAM's pimpleFoam for the arena of 4 x 3 x 0.5 m: LES and a gas, 0.7 m/s from one end.

The arena is empty or has the obstacles of configs/arena_3d.yaml, around which snappyHexMesh fits the cells. The solver
chooses its time step for a Courant number of 0.8 and corrects the pressure twice a step (PISO). Two processes share the
cells. The start and the first steps are not timed.
"""

import os
import signal
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path

SIZE = (4.0, 3.0, 0.5)  # m
PROCESSES = 2
START = 10  # steps that are not timed
COURANT = 0.8
DEBIAN = Path("/usr/share/openfoam")

MESH = """
vertices ((0 0 0) (4 0 0) (4 3 0) (0 3 0) (0 0 0.5) (4 0 0.5) (4 3 0.5) (0 3 0.5));
blocks (hex (0 1 2 3 4 5 6 7) (%d %d %d) simpleGrading (1 1 1));
boundary
(
    in { type patch; faces ((0 4 7 3)); }
    out { type patch; faces ((1 2 6 5)); }
    solid { type wall; faces ((0 1 5 4) (3 7 6 2) (0 3 2 1) (4 5 6 7)); }
);
"""
OBSTACLES = """
castellatedMesh true; snap true; addLayers false; mergeTolerance 1e-6;
geometry
{
    solid_pillar { type searchableCylinder; point1 (1 1.9 -0.1); point2 (1 1.9 0.6); radius 0.12; }
    solid_turned
    {
        type searchableRotatedBox; span (0.4 0.3 0.5); origin (2.26336 2.14064 -0.1);
        e1 (0.93969 0.34202 0); e3 (0 0 1);
    }
    solid_box { type searchableBox; min (2.125 0.725 -0.1); max (2.475 1.075 0.3); }
}
castellatedMeshControls
{
    maxLocalCells 10000000; maxGlobalCells 10000000; minRefinementCells 0; nCellsBetweenLevels 1;
    features (); refinementRegions {} resolveFeatureAngle 30; allowFreeStandingZoneFaces false;
    refinementSurfaces { "solid.*" { level (0 0); patchInfo { type wall; } } }
    locationInMesh (0.513 0.517 0.263);
}
snapControls
{
    nSmoothPatch 3; tolerance 2; nSolveIter 30; nRelaxIter 5; nFeatureSnapIter 10; implicitFeatureSnap true;
}
addLayersControls {}
meshQualityControls { #includeEtc "caseDicts/mesh/generation/meshQualityDict.cfg" }
"""
CONTROL = """
startFrom startTime; startTime 0; stopAt endTime; endTime 1000;
deltaT %.9g; adjustTimeStep yes; maxCo %g;
writeControl timeStep; writeInterval 1000000;
functions
{
    gas
    {
        type scalarTransport; libs (solverFunctionObjects); field gas; schemesField gas; D 1.2e-5;
        fvOptions
        {
            leak
            {
                type scalarSemiImplicitSource; selectionMode points; points ((1.01 1.51 0.26));
                volumeMode absolute; injectionRateSuSp { gas (2e-5 0); }
            }
        }
    }
}
"""
SCHEMES = """
ddtSchemes { default backward; }
gradSchemes { default Gauss linear; }
divSchemes
{
    default Gauss linear;
    div(phi,U) Gauss linearUpwind default;
    div(phi,gas) Gauss limitedLinear01 1;
}
laplacianSchemes { default Gauss linear %(gradient)s; }
interpolationSchemes { default linear; }
snGradSchemes { default %(gradient)s; }
"""
SOLUTION = """
solvers
{
    "p|pFinal" { solver GAMG; smoother GaussSeidel; tolerance 1e-5; relTol 0.01; }
    "(U|gas).*" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-6; relTol 0.01; }
}
PIMPLE { nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; }
"""
TURBULENCE = """
simulationType LES;
LES { LESModel Smagorinsky; turbulence on; delta cubeRootVol; cubeRootVolCoeffs { deltaCoeff 1; } }
"""
PARTS = """
numberOfSubdomains %d; method simple; simpleCoeffs { n (%d 1 1); delta 0.001; }
"""
# By field: class, unit, internal value, and boundary conditions at the inlet, the outlet and the walls
FIXED, FREE = "type fixedValue; value uniform", "type zeroGradient;"
FIELDS = {
    "U": ("volVectorField", "[0 1 -1 0 0 0 0]", "(0.7 0 0)", f"{FIXED} (0.7 0 0);", FREE, "type noSlip;"),
    "p": ("volScalarField", "[0 2 -2 0 0 0 0]", "0", FREE, f"{FIXED} 0;", FREE),
    "nut": ("volScalarField", "[0 2 -1 0 0 0 0]", "0", *["type calculated; value uniform 0;"] * 3),
    "gas": ("volScalarField", "[1 -3 0 0 0 0 0]", "0", f"{FIXED} 0;", FREE, FREE),
}


def arena(dx: float, steps: int, obstacles: bool, bashrc: str = "") -> float:
    """Return the wall time per simulated second with cells of `dx` [m].

    bashrc: script that sets OpenFOAM's environment; empty if the programs are on the PATH. Raises RuntimeError if a
    program is missing or fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder)
        for name, text in _files(dx, obstacles).items():
            (case / name).parent.mkdir(exist_ok=True)
            (case / name).write_text(text)
        for program in ("blockMesh", *["snappyHexMesh -overwrite"] * obstacles, "decomposePar"):
            _started(program, case, bashrc).communicate()
        solver = f"mpirun --allow-run-as-root --oversubscribe -np {PROCESSES} pimpleFoam -parallel"
        simulated, moments, log = [], [], []
        with _started(solver, case, bashrc) as process:
            assert process.stdout is not None
            try:
                for line in process.stdout:
                    log.append(line)
                    if line.startswith("Time ="):
                        simulated.append(float(line.split()[2]))
                    if line.startswith("ExecutionTime ="):
                        moments.append(time.perf_counter())
                    if len(moments) == steps + START:
                        break
            finally:  # also after an interruption: the case has no end of its own
                with suppress(OSError):
                    os.killpg(process.pid, signal.SIGTERM)
    if len(moments) != steps + START:
        raise RuntimeError(f"OpenFOAM made {len(moments)} of {steps + START} steps: {''.join(log[-20:])}")
    return (moments[-1] - moments[START - 1]) / (simulated[-1] - simulated[START - 1])


def _files(dx: float, obstacles: bool) -> dict[str, str]:
    """Return the texts of the OpenFOAM case by file name."""
    cells = tuple(round(length / dx) for length in SIZE)
    files = {
        "system/blockMeshDict": ("dictionary", MESH % cells),
        "system/controlDict": ("dictionary", CONTROL % (COURANT * dx, COURANT)),
        "system/snappyHexMeshDict": ("dictionary", OBSTACLES),
        "system/fvSchemes": (
            "dictionary",
            SCHEMES % {"gradient": "corrected" if obstacles else "orthogonal"},
        ),
        "system/fvSolution": ("dictionary", SOLUTION),
        "system/decomposeParDict": ("dictionary", PARTS % (PROCESSES, PROCESSES)),
        "constant/transportProperties": ("dictionary", "transportModel Newtonian; nu 1.5e-5;"),
        "constant/turbulenceProperties": ("dictionary", TURBULENCE),
    }
    for name, (kind, unit, within, *conditions) in FIELDS.items():
        patches = " ".join(
            f"{patch} {{ {rule} }}"
            for patch, rule in zip(("in", "out", '"solid.*"'), conditions, strict=True)
        )
        text = f"dimensions {unit}; internalField uniform {within}; boundaryField {{ {patches} }}"
        files[f"0/{name}"] = (kind, text)
    return {
        name: f"FoamFile {{ version 2.0; format ascii; class {kind}; object {Path(name).name}; }}\n{text}\n"
        for name, (kind, text) in files.items()
    }


def _started(command: str, case: Path, bashrc: str) -> subprocess.Popen[str]:
    """Start a program in a shell with OpenFOAM's environment; its output can be read line by line."""
    environment = dict(os.environ)
    if DEBIAN.is_dir():  # the Debian package has no bashrc
        environment = {"WM_PROJECT_DIR": str(DEBIAN), "FOAM_ETC": str(DEBIAN / "etc")} | environment
    line = f'. "$1" > /dev/null && {command}' if bashrc else command
    return subprocess.Popen(
        ["bash", "-c", line, "bash", bashrc],
        cwd=case,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
