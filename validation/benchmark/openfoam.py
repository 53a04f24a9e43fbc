"""Wall time of OpenFOAM's pisoFoam for the empty arena of 4 x 3 x 0.5 m: LES and a gas, 0.7 m/s from one end.

The time step has a Courant number of 0.8 at 0.9 m/s. Two processes share the cells. The start and the first steps are
not timed.
"""

import os
import subprocess
import tempfile
import time
from pathlib import Path

SIZE = (4.0, 3.0, 0.5)  # m
SPEED = 0.7  # m/s
PROCESSES = 2
START = 3  # steps that are not timed
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
CONTROL = """
startFrom startTime; startTime 0; stopAt endTime; endTime %.9g; deltaT %.9g;
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
laplacianSchemes { default Gauss linear orthogonal; }
interpolationSchemes { default linear; }
snGradSchemes { default orthogonal; }
"""
SOLUTION = """
solvers
{
    "p|pFinal" { solver GAMG; smoother GaussSeidel; tolerance 1e-5; relTol 0.01; }
    "(U|gas).*" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-6; relTol 0.01; }
}
PISO { nCorrectors 2; }
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


def arena(dx: float, steps: int, bashrc: str = "") -> float:
    """Return the wall time per simulated second with cells of `dx` [m].

    bashrc: script that sets OpenFOAM's environment; empty if the programs are on the PATH. Raises RuntimeError if a
    program is missing or fails.
    """
    dt = 0.8 * dx / 0.9
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder)
        for name, text in _files(dx, dt, steps + START).items():
            (case / name).parent.mkdir(exist_ok=True)
            (case / name).write_text(text)
        for program in ("blockMesh", "decomposePar"):
            _begun(program, case, bashrc).communicate()
        solver = f"mpirun --allow-run-as-root --oversubscribe -np {PROCESSES} pisoFoam -parallel"
        moments = []
        with _begun(solver, case, bashrc) as process:
            assert process.stdout is not None
            log = []
            for line in process.stdout:
                log.append(line)
                if line.startswith("ExecutionTime ="):
                    moments.append(time.perf_counter())
    if len(moments) != steps + START:
        raise RuntimeError(f"OpenFOAM made {len(moments)} of {steps + START} steps: {''.join(log[-20:])}")
    return (moments[-1] - moments[START - 1]) / (steps * dt)


def _files(dx: float, dt: float, steps: int) -> dict[str, str]:
    """Return the texts of the OpenFOAM case by file name."""
    cells = tuple(round(length / dx) for length in SIZE)
    files = {
        "system/blockMeshDict": ("dictionary", MESH % cells),
        "system/controlDict": ("dictionary", CONTROL % (steps * dt, dt)),
        "system/fvSchemes": ("dictionary", SCHEMES),
        "system/fvSolution": ("dictionary", SOLUTION),
        "system/decomposeParDict": ("dictionary", PARTS % (PROCESSES, PROCESSES)),
        "constant/transportProperties": ("dictionary", "transportModel Newtonian; nu 1.5e-5;"),
        "constant/turbulenceProperties": ("dictionary", TURBULENCE),
    }
    for name, (kind, unit, within, *conditions) in FIELDS.items():
        patches = " ".join(
            f"{patch} {{ {rule} }}" for patch, rule in zip(("in", "out", "solid"), conditions, strict=True)
        )
        text = f"dimensions {unit}; internalField uniform {within}; boundaryField {{ {patches} }}"
        files[f"0/{name}"] = (kind, text)
    return {
        name: f"FoamFile {{ version 2.0; format ascii; class {kind}; object {Path(name).name}; }}\n{text}\n"
        for name, (kind, text) in files.items()
    }


def _begun(command: str, case: Path, bashrc: str) -> subprocess.Popen[str]:
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
    )
