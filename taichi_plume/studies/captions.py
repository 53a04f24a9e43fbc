"""Captions of the tables and figures of a study's page."""

from taichi_plume.scoring.trials import LEAST_VALUES

OVER_AIRS = (
    "Searches in the same air are correlated, so intervals are over airs: all searches of an air are resampled "
    "together (cluster bootstrap). More airs narrow the intervals, more searches per air hardly do. Airs of one seed "
    "at several points have the same eddies and gusts, and count as one air."
)
SHARED = "Groups of a run were in one arena here and may have collided; with rivals: true each has an arena of its own."
FAILURES = "Time with failures: a search that found nothing counts with the duration of the run."
APART = "Both searched in the same airs (paired comparison): if the interval excludes 0, the two differ."
STILL = (
    "The air does not depend on random numbers: all seeds give the same air, and intervals are over searches."
)
ALONG = (
    f"Means over all values of the other axes, with 95 % confidence intervals over airs ({LEAST_VALUES} or more). "
    "Lines are shifted a little sideways, so that their intervals do not overlap."
)
RUNNING = "Each dot is a point of the study; the line is the running mean over 15 % of the axis."
BETWEEN = f"Means over all other axes with 95 % confidence intervals over airs, if there are {LEAST_VALUES} or more."
HEAT = "Means over all other axes. Empty cells have no valid run."
INDICES = (
    "The first-order Sobol index of an axis is the fraction of the variance that the axis explains alone; the total "
    "index includes interactions with other axes. An axis with a total index near 0 hardly matters."
)
SOBOL = "Bars are the indices, lines their 95 % confidence intervals over the sampled points."
ORDERS = (
    "From the three finest spacings: observed order of convergence, value extrapolated to zero spacing (Richardson), "
    "and uncertainty of the finest grid (grid convergence index; Celik et al. 2008, doi:10.1115/1.2960953)."
)
SPACING = "Means over airs. Stars are the extrapolated values."
POINTS = (
    "Means, with 95 % confidence intervals in brackets, which keep to the range of each quantity; there is none below "
    f"{LEAST_VALUES} airs."
)
SOME_POINTS = (
    "Shown are the {best} best and the {worst} worst of {all:,} points by their {first}; results.points() has "
    "all. "
)
FAILED = "Failed runs count neither as found nor as not found. --retry executes them again."
MISSING = "{missing:,} of {all:,} runs are missing; the command at the end of this page executes them."
COSTS = (
    "A worker is at work while it executes runs, and present from the start of its first to the end of its last run. "
    "Only these times depend on the machine."
)
AGAIN = (
    (
        "resume",
        "in the folder of the study's file, the first command executes the missing runs; --retry also repeats failed "
        "runs",
    ),
    (
        "add values",
        "the same command executes the new runs after values or airs were added; finished runs are kept",
    ),
    ("this page", "the second command writes this page again"),
)
