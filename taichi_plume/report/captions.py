"""Captions of the figures and tables of a report, for first-time readers."""

SCENE = (
    "The room {seen}, to scale. Stars are sources; grey are obstacles; coloured edges are openings with the way of "
    "their air{robots}."
)
TRIALS = "Wind and gas are the same for all trials: the interval says nothing of other airs, which other seeds make."
SHARED = (
    "The robots of {name} were in one arena with those of {others}, and may have met them; with rivals: true each "
    "group has its own."
)
SUCCESS = (
    "The share of trials in which a robot had found a source by then. A line that ends high and rises early is "
    "good."
)
MEAN = "Mean of {count} recorded pictures from {begin:g} to {end:g} s; the scale is {kind}. {trails}"
TRAILS = (
    "Lines are the ways of the robots, discs with a nose where they were at the end; those with a green rim have "
    "found the source.{part}"
)
SAID = (
    " Crosses are where a robot of their colour said that a source is: its first right word, with a green rim, or else "
    "its last, with a red one."
)
ASIDE = "Seen from the side: obstacles are pale, as they may stand before this plane or behind it."
SMELT = (
    "Grey: the true concentration where the sensor is; line: what the sensor says, late and smoothed as real ones "
    "are; both on a logarithmic scale. Dashed: the reading from which the algorithm takes it for gas; green: a source "
    "was found. Below, a lane for each robot: what its algorithm did, by colour.{part}"
)
MAPS = (
    "Left: gas as the map says at the end (of several trials the first), made of readings alone. Right: the mean of "
    "the true gas since the robots started. Both have the same logarithmic scale; grey is not known.{part}"
)
MAP_SCORES = (
    "Error and correlation against the gas of the last moment, over the cells that the map knows; the last column "
    "against the mean of the gas since the start. A correlation of 1 has the right shape, one of 0 none of it."
)
OVER_TIME = (
    "Each map against the mean of the true gas since the start, as time went on. Low errors and high correlations are "
    "good."
)
BELIEFS = (
    "How probable the first robot of each group, in the first trial, took a source to be in each place [1/m²]. Stars: "
    "the sources. Colours are logarithmic."
)
BELIEF_SCORES = (
    "Means over robots and trials, at the end. Expected distance: of the source that the robot believes in from the "
    "nearest true one. Probability within reach: that the believed source is within reach of a true one."
)
BUDGET = "What came in has to be what is there or has left."
"""Caption of the mass of the gas."""
UNFINISHED = (
    "This run has not ended by itself (status: {status}); the page shows what there is so far. To complete its files: "
    "python -m taichi_plume.repair {folder}"
)
NO_PICTURES = "There is neither a recording nor recorded fields, so the gas itself cannot be shown."
NO_MAPS = "The maps themselves are not in this folder (there is no maps.zarr to be read)."
CITE = "Simulated with taichi_plume {version}. Name the version, the seed and the scenario."
