"""Place and strength of a source in the rooms of the contest, beside the searches whose belief has the place alone.

All searches are rivals in the same airs, each with a sensor that follows in a second and with one of 5 s up and 20 s
down. A search ends with its first declaration, or after 300 s without. A declaration is right within RIGHT of a source.
A strength is right within a factor of 2, and its interval of 90 % should hold the true rate in 85 to 95 % of searches.

Wanted, written down before the runs, over all six rooms with 24 airs each: the intervals of the strength hold the truth
in 85 to 95 %; three of four strengths are right; and right declarations are at least as frequent as with the best of
the other searches, with either sensor.
"""

from functools import cache, partial
from importlib.resources import files

import numpy as np
import yaml

from taichi_plume.assembly.assemble import assemble
from taichi_plume.scoring.beliefs import estimates
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import Condition, Experiment, Range, Results, over_airs
from taichi_plume.validation.searches import afresh, outcomes, scenario_of

ROOMS = ("open_2d", "obstacles", "closed_room", "meandering", "two_sources", "open_3d")
AIRS, DURATION, RIGHT = 24, 300.0, 0.3  # s; m
SENSORS: dict[str, Keys] = {
    "fast": {"rise_time": 0.5, "decay_time": 1.0},
    "slow": {"rise_time": 5.0, "decay_time": 20.0},
}
SEARCHES: dict[str, Keys] = {
    "source_term": {"kind": "source_term"},
    "infotaxis": {"kind": "infotaxis"},
    "infotaxis, deconvolved": {"kind": "infotaxis", "lag": "deconvolved"},
    "hit_map": {"kind": "hit_map", "lag": "ignored"},
    "hit_map, deconvolved": {"kind": "hit_map", "lag": "deconvolved"},
    "particle_filter": {"kind": "particle_filter"},
}
OURS = "source_term"
BEFORE = ("infotaxis", "hit_map", "particle_filter")


def scene(room: str, air: int) -> Keys:
    """Return the scenario of a room and an air, with a group for each search and sensor."""
    text = files("taichi_plume.contests").joinpath("scenarios", f"{room}.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    (searcher,) = data["robots"]
    facts = {key: value for key, value in searcher["algorithm"].items() if key != "kind"}

    def group(name: str, search: Keys, sensor: str) -> Keys:
        known = facts if search["kind"] == "infotaxis" else {"threshold_ppm": facts["threshold_ppm"]}
        sensors = searcher["sensors"] | {"gas": searcher["sensors"]["gas"] | SENSORS[sensor]}
        return searcher | {
            "name": f"{name}, {sensor}",
            "trials": 1,
            "found": "declared",
            "reach": RIGHT,
            "algorithm": known | search,
            "sensors": sensors,
        }

    robots = [group(name, search, sensor) for sensor in SENSORS for name, search in SEARCHES.items()]
    return data | {"seed": 1000 + air, "duration": DURATION, "rivals": True, "robots": robots}


@cache
def searched(room: str, air: int) -> dict[str, dict[str, float]]:
    """Return by search and sensor whether it declared rightly or wrongly, when, and how the strength was estimated."""
    afresh()
    sim = assemble(scenario_of(scene(room, air)))
    sim.run()
    places, rates = sim.scenario.targets_at(sim.t)[:, :2], sim.scenario.rates
    found = {}
    for name, columns in outcomes(sim).items():
        right = columns["outcome"][0] == "declared"
        spoke = columns["declarations"][0] > 0
        time = columns["declared_time_s"][0] if right else DURATION
        found[name] = {"right": float(right), "wrong": float(spoke and not right), "time": time}
        group = next(each for each in sim.swarm.groups if each.name == name)
        terms = estimates(sim, group)
        if terms is not None:
            best = terms[0][0]
            true = rates[np.linalg.norm(places - best.place, axis=1).argmin()]
            found[name] |= {
                "place": float(np.linalg.norm(places - best.place, axis=1).min()),
                "strength": float(abs(np.log(best.rate / true)) <= np.log(2.0)),
                "covered": float(best.low <= true <= best.high),
                "declared": float(spoke),
            }
    return found


def compared(trials: int, rooms: tuple[str, ...]) -> Results:
    """Return shares of right and wrong declarations, times, and right and covered strengths, over airs."""
    runs = [searched(room, air) for room in rooms for air in range(max(1, trials))]
    of, results = np.arange(len(runs)), {}

    def values(name: str, what: str) -> np.ndarray:
        return np.array([run[name].get(what, np.nan) for run in runs])

    for sensor in SENSORS:
        for name in SEARCHES:
            for what, share in (("right", True), ("wrong", True), ("time [s]", False)):
                each = values(f"{name}, {sensor}", what.split(" ")[0])
                results[f"{what}, {sensor}: {name}"] = over_airs(each, of, share)
        best = max(BEFORE, key=lambda name: values(f"{name}, {sensor}", "right").mean())
        gain = values(f"{OURS}, {sensor}", "right") - values(f"{best}, {sensor}", "right")
        results[f"right, {sensor}: {OURS} less the best other"] = over_airs(gain, of)
        for title, what, share in (
            ("strength within a factor of 2", "strength", True),
            ("strength in its interval of 90 %", "covered", True),
            ("error of the place [m]", "place", False),
        ):
            results[f"{title}, {sensor}"] = over_airs(values(f"{OURS}, {sensor}", what), of, share)
    return results


EXPECTED = {
    key: bound
    for sensor in SENSORS
    for key, bound in (
        (f"strength in its interval of 90 %, {sensor}", Range(0.85, 0.95)),
        (f"strength within a factor of 2, {sensor}", Range(least=0.75)),
        (f"right, {sensor}: {OURS} less the best other", Range(least=0.0)),
    )
}
DISCUSSION = """Over 144 searches with either sensor, the intervals of 90 % hold the true strength in 88 % (fast)
and 94 % (slow), and 91 and 94 % of the strengths are right within a factor of 2. The median error of the place is 8 cm.

With slow sensors 69 % of the searches declare rightly within 300 s, beside 15 % of the particle filter, 13 % of the
hit map and 6 % of infotaxis, whose readings lag. Deconvolved, as the hit map now is by default, it has 67 %, and
infotaxis 32 %.

Missed: with fast sensors 65 % declare rightly, fewer than the 72 % of the hit map, which dares more: 24 % of its
declarations are wrong, 4 % of those of source terms; infotaxis has 74 % wrong. Most searches without a declaration
would have needed more time. In the closed room nobody finds the place, where air drifts at 3 cm/s: the error is about
0.6 m and the spread says so; infotaxis and the hit map declare wrongly in each search there. Behind the walls of
`obstacles` with fast sensors 62 % of the strengths are right and 79 % in their intervals: the wind there is known from
too few places.

The shape of the errors of the model and the correlation length were chosen from twelve other airs of five of these
rooms, with the model sensor's own lag. Nothing was tuned after the runs that are reported.
"""
CASES = (
    Experiment(
        "source_terms",
        "place and strength of a source in six rooms, beside searches whose belief has the place alone",
        "the true sources; bounds of our own, written down before",
        (
            Condition("all rooms", partial(compared, rooms=ROOMS), expected=EXPECTED),
            *(Condition(room, partial(compared, rooms=(room,))) for room in ROOMS),
        ),
        evidence="exact",
        trials=AIRS,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
