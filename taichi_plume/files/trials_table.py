"""Columns of a table of trials (repetitions of a search): names, types, units and meanings."""

import pyarrow as pa

from taichi_plume.files.run_tables import column

TRIAL = (
    column("group", pa.string(), "1", "name of the group of robots"),
    column("algorithm", pa.string(), "1", "algorithm of the group"),
    column("trial", pa.int64(), "1", "number of the trial in its run"),
    column("searched", pa.bool_(), "1", "whether the trial had a source"),
    column("success", pa.bool_(), "1", "whether a source was found; null without a search"),
    column("found", pa.int64(), "1", "robots that found a source"),
    column("time_s", pa.float64(), "s", "time until the first robot found a source"),
    column("path_m", pa.float64(), "m", "path length of that robot"),
    column("overhead", pa.float64(), "1", "path_m over the straight distance to the nearest source"),
    column("shortest_m", pa.float64(), "m", "shortest path to a source, around obstacles"),
    column("team_path_m", pa.float64(), "m", "path length of all robots of the team"),
    column("acquisitions", pa.int64(), "1", "acquisitions (stops to measure) of the team"),
    column("hits", pa.int64(), "1", "detections of gas by the team"),
    column("bumps", pa.int64(), "1", "collisions of robots of the team"),
    column("pushes", pa.int64(), "1", "collisions of moving obstacles with the team; null if none moves"),
    column("pinned_s", pa.float64(), "s", "time of robots inside moving obstacles; null if none moves"),
    column("final_distance_m", pa.float64(), "m", "distance from a source at the end, of the nearest robot"),
    column("time_with_failures_s", pa.float64(), "s", "time_s; of a failure, the duration of the run"),
    column("outcome", pa.string(), "1", "declared (a source, rightly), reached (a source), or neither"),
    column("declared_time_s", pa.float64(), "s", "time until the first right, or else the last declaration"),
    column("localisation_error_m", pa.float64(), "m", "from that declared position to the nearest source"),
    column("declarations", pa.int64(), "1", "declarations of a source position by the team"),
    column("false_declarations", pa.int64(), "1", "declarations without a source within reach"),
    column("reached_time_s", pa.float64(), "s", "time until the first robot came within reach of a source"),
    column("shares_arena", pa.bool_(), "1", "whether robots of other groups were in the same arena"),
)
