"""Columns of a table of trials: names, types, units and meanings."""

import pyarrow as pa

from taichi_plume.files.table_parts import column

TRIAL = (
    column("group", pa.string(), "1", "name of the group of robots"),
    column("algorithm", pa.string(), "1", "its algorithm"),
    column("trial", pa.int64(), "1", "number of the trial in its run"),
    column("searched", pa.bool_(), "1", "whether there was a source to be found"),
    column("success", pa.bool_(), "1", "whether a source was found; null where none was searched"),
    column("found", pa.int64(), "1", "robots that found a source"),
    column("time_s", pa.float64(), "s", "time until the first robot found a source"),
    column("path_m", pa.float64(), "m", "way driven by that robot"),
    column("overhead", pa.float64(), "1", "this way over the straight one to the nearest source"),
    column("shortest_m", pa.float64(), "m", "the shortest way to a source, around what stands"),
    column("team_path_m", pa.float64(), "m", "way driven by all robots of the team"),
    column("acquisitions", pa.int64(), "1", "how often robots of the team stopped to measure"),
    column("hits", pa.int64(), "1", "how often they noticed gas"),
    column("bumps", pa.int64(), "1", "how often they met something"),
    column("pushes", pa.int64(), "1", "how often moving obstacles ran into them; null if no obstacle moves"),
    column(
        "pinned_s",
        pa.float64(),
        "s",
        "time that they were inside moving obstacles; null if no obstacle moves",
    ),
    column("final_distance_m", pa.float64(), "m", "of the robot that ended nearest to a source"),
    column("time_with_failures_s", pa.float64(), "s", "time, where a failure counts as the whole run"),
    column(
        "outcome",
        pa.string(),
        "1",
        "declared (a robot said rightly where a source is), reached (one came to it), or neither",
    ),
    column(
        "declared_time_s", pa.float64(), "s", "time until the first right declaration, or else the last one"
    ),
    column("localisation_error_m", pa.float64(), "m", "from the place declared then to the nearest source"),
    column("declarations", pa.int64(), "1", "how often robots of the team said where a source is"),
    column("false_declarations", pa.int64(), "1", "how often there was none within reach of that place"),
    column("reached_time_s", pa.float64(), "s", "time until the first robot came within reach of a source"),
    column("shares_arena", pa.bool_(), "1", "whether robots of other groups were in the same arena"),
)
