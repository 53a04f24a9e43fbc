"""Captions of a contest's tables and figures."""

from taichi_plume.scoring.trials import LEAST_VALUES
from taichi_plume.studies.intervals import FEWEST

MEASURED = (
    "A search is successful if a robot comes within 0.25 m of a source within the scenario's time; the robot is then "
    "stopped. NAME_declares is the algorithm NAME judged by its declarations: a search is successful if the first "
    "declared position is within 0.25 m of a source, and the first declaration ends the search, right or wrong. "
    "Time and way are those of successful searches; time with failures counts a failure with the whole time. "
    "Way / shortest way: length of the robot's path over the shortest path, around obstacles, from its start to the "
    "nearest source.",
    "Some algorithms declare a position of the source. Localisation error: distance from the declared position to the "
    "nearest source, for the first right declaration of a search or, without one, the last declaration. A declaration "
    "is false if no source is within 0.25 m. Outcome of a search: declared (a robot declared a source rightly), "
    "reached (no robot did, but a robot reached a source), neither. "
    "Robots that stop at a source before they declare have no declaration to judge: see NAME_declares for these.",
    "95 % confidence intervals are over airs: searches in one air are correlated, so whole airs are resampled with all "
    "their searches (cluster bootstrap). Success has Wilson's interval, in which each air counts once, if each air has "
    f"one search, if all airs have equal results, or if there are fewer than {FEWEST} airs. Then means have Student's "
    "interval on a scale without limits: the logarithm or, for times, which end with the run, the logit. So intervals "
    f"keep to the range of their quantity. There are no intervals below {LEAST_VALUES} airs. "
    "If the air does not depend on random numbers, success has Wilson's interval over the searches.",
    "All algorithms have the same robot, sensors, time, airs and starts: start k of air n is the same position for all "
    "of them. One robot searches, except for DAPSO, a swarm of five, whose time is that of the first to find a source. "
    "All algorithms have their defaults and are given these facts of the plume: threshold_ppm, a tenth of the highest "
    "mean concentration in the start area, at least 2 ppm, and the mean wind speed.",
)
WHOLE = (
    f"In brackets the 95 % interval over airs, from {LEAST_VALUES} airs on. The last column is the plain mean over the "
    "scenarios; random_walk is the baseline: an algorithm that is not better gains nothing from the gas."
)
FACTS = "Facts of the plume that all algorithms are given:"
ARENA = (
    "Mean gas at the sensors' height in the first minute of the first air, logarithmic; stars are sources."
)
COMPARED = (
    f"Means with 95 % confidence intervals over airs, from {LEAST_VALUES} airs on. A mean time of few successes is "
    "uncertain."
)
TABLE = (
    f"In brackets 95 % confidence intervals over airs; none without data and none below {LEAST_VALUES} airs."
)
NO_INTERVALS = f"No intervals where fewer than {LEAST_VALUES} airs have a value; --airs N gives more airs."
WORDS = "Algorithms that declared a position: distance to the nearest source, and outcomes of the searches."
FAILED = "Failed runs count neither as found nor as not found."
