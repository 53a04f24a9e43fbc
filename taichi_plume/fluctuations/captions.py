"""Captions of the plots and tables of a page of statistics."""

MEASURED = (
    "{gas} at {points}: {where}. From t = {begin:.4g} to {end:.4g} s, {samples} samples, {every}. A sample counts for "
    "the time up to halfway to its neighbours."
)
THRESHOLD = (
    "A whiff is a period with a concentration above the threshold of {threshold:.3g} ppm ({why}); a blank is a period "
    "below the threshold."
)
STRENGTH = (
    "Intermittency: fraction of the time in whiffs. Mean: with standard error from the integral time. 99 % / mean: "
    "99th percentile over the mean."
)
WIND = "Turbulence intensity: root mean square fluctuation of a component over the mean speed."
MAPS = (
    "Mean over time, rms fluctuation over the mean, and intermittency. Colours end at the 99.5th percentile of the "
    "cells; white: obstacles, and in the map of fluctuations cells with less than a thousandth of the largest mean."
)
PROFILES = "Means and rms fluctuations over time at the points."
NEAREST = " Lines: least-squares Gaussian fit to the means."
WIDTHS = "Width and centre of the Gaussian fit to the mean of each row."
CORRELATION = (
    "Correlation of the fluctuations at two points over their separation. The length is the integral up to the first "
    "zero."
)
WHIFFS = (
    "In turbulence the durations of whiffs and blanks follow approximately a power law T^-3/2, from the shortest times "
    "to about half the travel time from the source with the wind (Celani, Villermaux and Vergassola 2014, "
    "doi:10.1103/PhysRevX.4.041015)."
)
LAWS = "Density of durations in logarithmic bins. Solid: power law fitted in its range; dashed: T^-3/2."
RANGE = (
    "Cut: whiffs or blanks at the start or end of the record, which are left out. Exponent: maximum likelihood "
    "in the given range; interval by a bootstrap over blocks of time, as points see the same gusts. Without --range, "
    "the range ends at half the travel time from the source with the mean wind, but not below the 99 % quantile, and "
    "starts where the remaining durations are closest to a power law (Clauset, Shalizi and Newman 2009, "
    "doi:10.1137/070710111), at five samples or later."
)
RESOLVED = (
    "Each sensor measures the record, as in a run. A sensor keeps a whiff if the reading rises through the threshold "
    "between the start of this whiff and the start of the next whiff. For this the reading must reach the threshold, "
    "and must have fallen below the threshold in the blank before. The threshold of readings is the threshold of the "
    "air times the sensor's reading for 1 ppm of {gas}."
)
BARS = "First a metal oxide of 12 s and a detector of 50 ms, then all sensor models of scenarios with their defaults."
RECORDS = "At the point with the most whiffs, in their busiest period; readings in ppm of this gas. Dashed: threshold."
RISES = "Rises in all: more than the kept whiffs if noise crosses the threshold several times in a whiff."
BOUTS = (
    "A {sensor} measures the record. A bout is a rise of the smoothed derivative of the signal ln(R_air/R) by more "
    "than {threshold:.2g} 1/s, which noise hardly exceeds (Schmuker, Bahr and Huerta 2016, "
    "doi:10.1016/j.snb.2016.05.098). In a wind tunnel the number of bouts falls about linearly with the distance from "
    "the source."
)
BOUTS_PLOT = "A dot per point, of no more than six probes. Distance: from the nearest source."
WITHIN = (
    "Samples above the threshold, divided by their mean at each point, with maximum-likelihood fits of the gamma and "
    "lognormal distributions; distance: Kolmogorov-Smirnov."
)
SPECTRUM = "Power spectral density of the concentration (Welch's method), mean over the points of each probe."
FILES = (
    "The numbers are in statistics.json and statistics.parquet (a row per point), durations.parquet (a row per whiff "
    "and blank), spectra.parquet and, of a film, maps.nc."
)
