"""What the runs of a study took, in words."""

import numpy as np
import pyarrow as pa

PAUSE = 60.0  # s without a run: longer ones count as interruptions


def told(costs: pa.Table) -> list[tuple[str, str]]:
    """Wall time, time per run, and how busy workers were; of `costs.parquet`."""
    if not len(costs):
        return []
    table = costs.sort_by("begun").to_pandas()
    table["end"] = table["begun"] + table["total_s"]
    pauses = table["begun"].to_numpy()[1:] - np.maximum.accumulate(table["end"].to_numpy())[:-1]
    table["stretch"] = np.concatenate([[0], np.cumsum(pauses > PAUSE)])
    there = table.groupby("stretch").agg({"begun": "min", "end": "max"})
    wall = float((there["end"] - there["begun"]).sum())
    stays = table.groupby(["stretch", "worker"]).agg({"begun": "min", "end": "max"})
    busy = table["total_s"].sum() / max(float((stays["end"] - stays["begun"]).sum()), 1e-9)
    each, beyond = table["total_s"].mean(), (table["total_s"] - table["simulation_s"]).mean()
    pauses_told = f", in {len(there)} stretches, pauses between them left out" if len(there) > 1 else ""
    return [
        ("wall time", _time(wall) + pauses_told),
        (
            "runs",
            f"{len(table):,}; {_time(each)} each, of which {_time(beyond)} beyond the simulation itself",
        ),
        (
            "workers",
            f"{stays.groupby('stretch').size().max():,}; at work {100 * min(1.0, busy):.0f} % of the time",
        ),
        ("kernels compiled", f"{table['compiled'].sum():,}"),
    ]


def _time(seconds: float) -> str:
    if seconds < 1:
        return f"{1000 * seconds:.3g} ms"
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"
