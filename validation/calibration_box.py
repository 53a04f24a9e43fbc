"""Calibration of six gas sensors in a closed box, into which known amounts of ethanol are injected.

Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009) 393-402, section 2: a
hermetic box with a fan, 14 concentrations, a cubic of logarithms per sensor by least squares (equation 2). Size of the
box, amounts and waiting times are not given. Ours is a cube of 0.5 m, whose air eddies of 0.3 m/s stir as a small fan
does; 14 amounts bring it to 5 to 1000 ppm in equal ratios, one a minute. R is a sensor's mean resistance over the last
ten seconds before the next injection, R_0 that in clean air. The concentration of the fit is the amount injected over
the volume of the box, as in a laboratory; the true gas at the sensors is not used.

Wanted, as written down before any run: the gas at each sensor is within 1 % of that concentration. The cubics give
back the gas within 3 %: up to 1 % by noise and recovery of the sensors, 1 % by mixing, 1 % by a cubic in place of the
law. The sensors' readings, by the calibration that the simulator derives from the law of each unit
(agents/gas_laws.py), agree with the cubics within 3 % too. The error with another unit's cubic is reported, not judged.
"""

import numpy as np

from taichi_plume.agents.gas_laws import INJECTED
from taichi_plume.assembly.assemble import assemble
from taichi_plume.scenario.species import SPECIES
from taichi_plume.time_loop import Every
from taichi_plume.validation.case import Answer, Case, Curve, Expected, Keys
from taichi_plume.validation.searches import scenario_of

EDGE = 0.5  # m
WAIT = 60.0  # s between injections; before the first the air is clean
SHOT = 1.0  # s of an injection
LAST = 10.0  # s of a wait, in which sensors are read
READ = 0.5  # s between readings
ROUND = int(WAIT / READ)  # readings of a wait
PLACES = [[x, y] for x in (0.12, 0.25, 0.38) for y in (0.15, 0.35)]  # m
EXPECTED = {
    "gas at the sensors": Expected(tolerance=0.01),
    "cubic of the unit": Expected(tolerance=0.03),
    "cubic of the unit, and its readings": Expected(tolerance=0.03),
}

DISCUSSION = """\
Reproduced: the cubic of each sensor gives back the injected gas within 0.7 %, and agrees with the calibration that the
simulator derives from the sensor's law. With the cubic of another unit a reading can be wrong by a factor of five:
the paper calibrates each sensor for that reason. The paper gives no coefficients to compare with.

Stirring matters: under a lid that slides at 0.5 m/s, whose air is symmetric and steady, the gas still differed by 20 %
after a minute.
"""


def scenario(n: int) -> Keys:
    """Return the scenario of the box with n cells per edge, as keys of a YAML file."""
    spacing = EDGE / n
    rates = np.diff(INJECTED, prepend=0.0) * EDGE**3 / (SPECIES["ethanol"].ppm_per_density * SHOT)
    return {
        "name": "calibration_box",
        "seed": 1,
        "duration": WAIT * (len(INJECTED) + 1),
        "tick": READ,
        "domain": {"size": [EDGE] * 3, "spacing": spacing},
        "wind": {"kind": "synthetic", "speed": 0.3},
        "gas": {
            "kind": "eulerian",
            "sources": [
                {
                    "position": [0.5 * EDGE] * 3,
                    "rate": rate,
                    "start": WAIT * (k + 1),
                    "stop": WAIT * (k + 1) + SHOT,
                }
                for k, rate in enumerate(rates)
            ],
        },
        "robots": [
            {
                "name": "sensors",
                "count": len(PLACES),
                "start": {"kind": "positions", "positions": PLACES},
                "algorithm": {"kind": "casting", "speed": 0.0},
                "body": {"kind": "miniq"},
                "reach": 0.0,
                "sensors": {
                    "gas": {
                        "kind": "mox",
                        "model": "tgs800",
                        "period": READ,
                        "averaged": 500,
                        "calibration": "cubic",
                        "spread": 1.0,
                    }
                },
            }
        ],
    }


def calibrate(n: int) -> Answer:
    """Return the largest relative errors of the sensors' cubics, and a curve. Taichi must have been started."""
    sim = assemble(scenario_of(scenario(n)))
    rows: list[dict[str, np.ndarray]] = []
    sim.observers.append(Every(READ, lambda sim: rows.append(sim.swarm.snapshot())))
    sim.run()

    def plateaus(column: str) -> np.ndarray:
        """Return the means at the end of each wait, (1 + injections, sensors); the first is that of clean air."""
        values = np.array([row[column] for row in rows[-len(INJECTED) * ROUND - ROUND :]], float)
        return values.reshape(-1, ROUND, len(PLACES))[:, -int(LAST / READ) :].mean(axis=1)

    clean, *ohm = plateaus("resistance_ohm")
    x, log_c = np.log10(np.array(ohm) / clean), np.log10(INJECTED)
    k = np.array([np.linalg.lstsq(np.vander(each, 4), log_c, rcond=None)[0] for each in x.T])

    def by(fit: int) -> np.ndarray:
        """Return the gas [ppm] by the cubic of the unit that is `fit` places further, (injections, sensors)."""
        cubics = np.roll(k, -fit, axis=0)
        return np.column_stack([10 ** np.polyval(*pair) for pair in zip(cubics, x.T, strict=True)])

    def error(ppm: np.ndarray, reference: np.ndarray) -> float:
        return float(np.abs(ppm / reference - 1.0).max())

    injected, own = INJECTED[:, None], by(0)
    return {
        "gas at the sensors": error(plateaus("true_ppm")[1:], injected),
        "cubic of the unit": error(own, injected),
        "cubic of the unit, and its readings": error(own, plateaus("reading_ppm")[1:]),
        "cubic of another unit": error(by(1), injected),
        "first sensor": Curve("R/R_0", "ppm", 10 ** x[:, 0], own[:, 0], INJECTED, log_x=True, log_y=True),
    }


CASES = (
    Case(
        "calibration_box",
        "six sensors calibrated in a closed box with 14 injections",
        "Ferri et al. 2009, equations 1 and 2",
        calibrate,
        coarse=(8,),
        fine=(8, 12),
        expected=EXPECTED,
        evidence="exact",
        discussion=DISCUSSION,
    ),
)
