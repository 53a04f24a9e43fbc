"""Captions of the figures and tables of a report, for first-time readers."""

SCENE = (
    "The room {seen}, to scale. Stars are sources; obstacles are grey; coloured edges are openings with the direction "
    "of their air{robots}."
)
TRIALS = "Wind and gas are the same for all trials: the interval does not cover other airs, which need other seeds."
SHARED = (
    "The robots of {name} were in one arena with those of {others}, and may have met them; with rivals: true each "
    "group has its own."
)
SUCCESS = (
    "Fraction of trials in which a robot had found a source by a time. A good line rises early and ends high."
)
MEAN = "Mean of {count} recorded pictures from {begin:g} to {end:g} s; the scale is {kind}. {trails}"
TRAILS = (
    "Lines are the paths of the robots, pointed discs their positions at the end; robots with a green rim have "
    "found the source.{part}"
)
DECLARED = (
    " Crosses are positions of a source that the robot of their colour declared: the first right declaration, with a "
    "green rim, or else the last, with an orange rim."
)
ASIDE = "Seen from the side: obstacles are pale, as they may stand before this plane or behind it."
SMELT = (
    "Grey: true concentration at the sensor; line: reading of the sensor, with the lag and smoothing of a real sensor; "
    "both on a logarithmic scale. Dashed: threshold of the algorithm for gas; green: a source was found. Below, a "
    "lane for each robot: state of its algorithm, by colour.{part}"
)
DECISIONS = (
    "Quantities by which the algorithms decide, of the first robots; a line ends where its robot has none. Their "
    "meanings are in the metadata of robots.parquet and in the documentation of the algorithms."
)
MAPS = (
    "Left: estimate of the map at the end (of several trials the first), from readings alone. Right: the mean of the "
    "true gas since the robots started. Both have the same logarithmic scale; grey is unknown.{part}"
)
WIND_MAPS = (
    "Left: estimate of the wind at the end (of several trials the first), from anemometers alone. Right: the mean "
    "wind since the robots started. Colours are the speed; grey is unknown.{part}"
)
WIND_HEADS = (
    "map", "cells known", "error against the mean wind [m/s]", "direction error against the mean wind [deg]",
    "error against the wind at the end [m/s]",
)  # fmt: skip
WIND_SCORES = (
    "Errors are means of the length of the difference over the known cells; direction errors are mean angles, weighted "
    "by the true speed."
)
ERROR, CORRELATION = "error against the mean gas [ppm]", "correlation with the mean gas"
"""Scores of a gas map against the mean of the true gas since the start."""
GAS_TITLES = {"error_ppm": ERROR, "correlation": CORRELATION}
WIND_TITLES = {"error_m_s": WIND_HEADS[2], "direction_error_deg": WIND_HEADS[3]}
MAP_HEADS = (
    "map", "cells known", ERROR, CORRELATION,
    "error against the gas at the end [ppm]", "correlation with the gas at the end",
)  # fmt: skip
MAP_SCORES = (
    "Errors are mean absolute errors over the cells known to the map, against the gas at the end of the run or against "
    "the mean of the gas since the start. A map with a correlation of 1 has the right shape, with 0 an unrelated shape."
)
OVER_TIME = (
    "Mean absolute error and correlation of each map against the mean of the true gas since the start. Low errors and "
    "high correlations are good."
)
BELIEFS = (
    "Belief (posterior) of the first robot of each group, in the first trial: probability density of the source's "
    "position [1/m²]; before it the prior, if the scenario gives one. Stars: the sources. Colours are logarithmic."
)
BELIEF_SCORES = (
    "Means over robots and trials, at the end. Expected distance: from the believed source to the nearest true "
    "source. Probability within reach: that the believed source is within reach of a true source."
)
ESTIMATED_SOURCES = (
    "Estimated sources of the first robots, over all trials, at the end. Probability: of at least so many sources."
)  # fmt: skip
BUDGET = "Mass balance: the gas that came in equals the gas in the room plus the gas that left."
"""Caption of the mass of the gas."""
UNFINISHED = (
    "This run has not ended by itself (status: {status}); the page shows the files so far. To complete the files: "
    "python -m taichi_plume repair {folder}"
)
NO_PICTURES = "There is neither a recording nor recorded fields, so the gas itself cannot be shown."
NO_MAPS = "The folder has no maps to show (no maps.zarr that can be read)."
CITE = "Simulated with taichi_plume {version}. Name the version, the seed and the scenario."
