"""Captions of the tables and figures of a study's page."""

OVER_AIRS = (
    "Searches in one air share its luck, so that intervals are over airs: all searches of an air are drawn together "
    "(cluster bootstrap). More airs make them narrower, more searches in each hardly. Airs of one seed at several "
    "points have their eddies and gusts in common, and count as one."
)
SHARED = (
    "Groups of a run were in one arena here, and may have met each other; with rivals: true each has its own."
)
FAILURES = "Time with failures counts a search that found nothing as the whole run."
APART = "Both met the same airs, whose effect on both cancels: if the interval excludes 0, they differ."
STILL = "Chance does not change the air here: other seeds make the same, and intervals are over searches."
ALONG = (
    "Means with intervals of 95 % confidence over airs; where other axes were varied too, over all of their values. "
    "Points of different lines are shifted a little, so that their intervals do not overlap."
)
RUNNING = "Each dot is a point of the study, the line a mean that runs over 15 % of the axis."
BETWEEN = "Means over all other axes with intervals of 95 % confidence over airs."
HEAT = "Means over all other axes. Empty cells have no run that counts."
INDICES = (
    "The first-order index of an axis is the share of the variance over all points that its value alone makes; the "
    "total index also counts what it makes together with others. An axis whose total index is near 0 hardly matters."
)
SOBOL = "Bars are the indices, lines their intervals of 95 % confidence over the points that were drawn."
ORDERS = (
    "From the three finest spacings: the order with which what was measured tends to a value, that value, and by how "
    "much the finest grid may be off (grid convergence index; Celik et al. 2008, doi:10.1115/1.2960953)."
)
SPACING = "Means over airs. Stars are what they tend to."
POINTS = "Means, and in brackets their intervals of 95 % confidence, where there are enough airs for one."
SOME_POINTS = (
    "Shown are the {best} best and the {worst} worst of {all:,} points by their {first}; results.points() has "
    "all. "
)
FAILED = "Failed runs count as nothing, neither as found nor as not found. --retry runs them again."
MISSING = "{missing:,} of {all:,} runs have not been made yet; the command at the end of this page goes on with them."
COSTS = (
    "A worker is at work while it executes runs, and present from the start of its first to the end of its last run. "
    "These times depend on the machine; nothing else on this page does."
)
AGAIN = (
    (
        "go on",
        "where the study's file lies, the first command makes what is missing and skips what is done; --retry also "
        "repeats what failed",
    ),
    (
        "add values",
        "values added to an axis, or more airs, are made by the same command; what is done is kept",
    ),
    ("this page", "the second command makes it again"),
)
