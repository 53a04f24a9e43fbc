"""Captions of the plots and tables of a page of statistics."""

MEASURED = (
    "{gas} at {points}: {where}. From t = {begin:.4g} to {end:.4g} s, {samples} samples, {every}. A sample counts for "
    "the time up to halfway to its neighbours."
)
THRESHOLD = (
    "There is gas where its concentration is above the threshold of {threshold:.3g} ppm ({why}); a whiff is a time "
    "with gas, a blank one without."
)
STRENGTH = (
    "Intermittency: share of the time with gas. Mean: with its standard error, by the integral time. 99 % / mean: what "
    "is exceeded for a hundredth of the time."
)
WIND = "Turbulence intensity: root of the mean square fluctuation of a component over the mean speed."
MAPS = (
    "Mean over time, fluctuation over it, and share of the time with gas. Colours end at what half a "
    "hundredth of the cells exceed; white: obstacles, and for the fluctuation less than a thousandth of the most gas."
)
PROFILES = "Means and fluctuations of the points over time."
NEAREST = " Lines: the Gaussian nearest to the means."
WIDTHS = "Of the Gaussian nearest to the mean of each row that has one."
CORRELATION = (
    "Of the fluctuations at two points, against how far they are apart. The length is the integral up to the first "
    "zero."
)
WHIFFS = (
    "In turbulence, how long whiffs and blanks last is about a power law T^-3/2 between the shortest times and about "
    "half the time that the wind takes from the source (Celani, Villermaux and Vergassola 2014, "
    "doi:10.1103/PhysRevX.4.041015)."
)
LAWS = (
    "Density of durations in bins that are even in their logarithm. Solid: the power law that fits best in its range; "
    "dashed: T^-3/2."
)
RANGE = (
    "Cut: left out, as the record's start or end cuts them. Exponent: by maximum likelihood in the range that is "
    "given; its interval by resampling blocks of time, as points see the same gusts. Unless --range gives it, the "
    "range ends at half the time that the mean wind takes from the source, or beyond, where a hundredth is longer, and "
    "begins where what follows is nearest to a power law (Clauset, Shalizi and Newman 2009, "
    "doi:10.1137/070710111), at five samples or later."
)
RESOLVED = (
    "Each sensor was given the record, as in a run. It keeps a whiff if its reading rises through the threshold "
    "between the begin of this whiff and that of the next one: a robot that compares readings with the threshold "
    "counts it as another one. For this the reading has to reach the threshold, and to have fallen below it in the "
    "blank before. The threshold of readings is that of the air times what the sensor reads for a ppm of {gas}."
)
BARS = "All sensor models of scenarios with their defaults, and first a metal oxide of 12 s and a detector of 50 ms."
RECORDS = "At the point with the most whiffs, when most frequent; readings in ppm of this gas. Dashed: the threshold."
RISES = "Rises in all: more than the kept ones where noise crosses the threshold several times in a whiff."
WITHIN = (
    "Samples above the threshold, over their mean at each point, with the gamma and lognormal distribution that fit "
    "best; distance: the largest between the cumulated shares (Kolmogorov-Smirnov)."
)
SPECTRUM = "Power spectral density of the concentration (Welch's method), mean over the points of each probe."
FILES = (
    "The numbers are in statistics.json and statistics.parquet (a row per point), durations.parquet (a row per whiff "
    "and blank), spectra.parquet and, of a film, maps.nc."
)
