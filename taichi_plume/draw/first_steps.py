"""First steps in an empty room: what a run still lacks, each with the tool that draws it."""

from collections.abc import Mapping
from html import escape
from typing import Any

from taichi_plume.draw.document import value_at

OUT = "outlet"


def first_steps(data: Mapping[str, Any]) -> dict[str, tuple[str, bool]]:
    """Return by its tool what a room needs, in order: what it is for, and whether the data have it.

    Air comes in and leaves through openings if it is computed; robots, or probes in their place, are optional.
    """
    openings = value_at(data, "wind.openings") or []
    kinds = [each.get("kind") for each in openings if isinstance(each, dict)]
    air = {
        "inlet": ("air comes in", any(kind != OUT for kind in kinds)),
        OUT: ("air leaves", OUT in kinds or len(kinds) > 1),
    }
    gas = data.get("gas") if isinstance(data.get("gas"), dict) else {}
    more = {
        "source": ("gas", any(gas.get(key) for key in ("sources", "releases", "parts"))),
        "robots": ("or a probe: readings", bool(data.get("robots") or data.get("probes"))),
    }
    return (air if value_at(data, "wind.kind") == "cfd" else {}) | more


def as_html(data: Mapping[str, Any]) -> str:
    """Return the list with links that choose the tools; "" once a run lacks nothing but what is optional."""
    steps = first_steps(data)
    if all(done for tool, (_, done) in steps.items() if tool != "robots"):
        return ""
    parts = [
        f"<span class='good'>✓ {tool}</span>"
        if done
        else f"<a href='#' data-act='draw:{tool}'>{tool}</a> ({escape(use)})"
        for tool, (use, done) in steps.items()
    ]
    return f"<b>Draw:</b> {' · '.join(parts)}; then <b>▶ Run</b>"
