"""The palette: kinds of objects that the pointer draws, with icons, in groups that can be folded."""

from collections.abc import Callable
from urllib.parse import quote

from bokeh.layouts import column
from bokeh.models import Button, InlineStyleSheet, RadioButtonGroup
from bokeh.models.ui import UIElement

SELECT = "select"
WIDTH = 124
GROUPS = {
    "": (SELECT,),
    "air": ("inlet", "outlet", "honeycomb", "fan", "heater"),
    "bodies": ("box", "cylinder", "sphere", "polygon", "mesh", "map", "walker"),
    "gas": ("source",),
    "robots": ("robots", "robot line", "robot area", "arena"),
    "measuring": ("probe", "probe line"),
}
"""Kinds by the headings of their groups."""
_DASHED = "' stroke-dasharray='3 2.5"
ICONS = {
    SELECT: "M5 2.5l9.5 8.5-5 .6 3 4.9-2.1 1.2-2.9-5-3.2 3.1z",
    "inlet": "M3 3v14M6 10h11M13 6l4 4-4 4",
    "outlet": "M13 3v4M13 13v4M3 10h14M13.5 6.5L17 10l-3.5 3.5",
    "honeycomb": "M7 2.5l4 2.2v4.6L7 11.5 3 9.3V4.7zM13 8.5l4 2.2v4.6l-4 2.2-4-2.2v-4.6",
    "fan": "M10 2.5a7.5 7.5 0 100 15 7.5 7.5 0 000-15M10 10c-3-2-2-5.5 0-5.5s1.5 3.5 0 5.5c3.2-1.6 5.5.5 5 2.2"
    "s-3.7.6-5-2.2c.2 3.6-2.7 4.7-4 3.4s.8-3.2 4-3.4",
    "heater": "M6 17c-2.5-3 2-5 0-9M10 17c-2.5-3 2-5 0-9M14 17c-2.5-3 2-5 0-9M4 4h12",
    "box": "M4 5h12v10H4z",
    "cylinder": "M4 5.5c0-3.5 12-3.5 12 0v9c0 3.5-12 3.5-12 0zM4 5.5c0 3.5 12 3.5 12 0",
    "sphere": "M10 3a7 7 0 100 14 7 7 0 000-14M3 10c0 3.5 14 3.5 14 0",
    "polygon": "M4 16L3 7l6-4 8 5-3 8z",
    "mesh": "M10 3L2.5 16.5h15zM6.3 9.7h7.4L10 16.5z",
    "map": "M3 5l4.7-2 4.6 2L17 3v12l-4.7 2-4.6-2L3 17zM7.7 3v12M12.3 5v12",
    "walker": "M10.5 2.5a1.5 1.5 0 100 3 1.5 1.5 0 000-3M10.5 7L9 12l-3 5.5"
    "M9 12l3.5 2 1 3.5M5.5 10.5l5-3.5 4 3.5",
    "source": "M6 15.5a3.3 3.3 0 01-.3-6.6 4.5 4.5 0 018.6-.7 3.7 3.7 0 01.2 7.3z",
    "robots": "M4 8h12v8H4zM10 8V4.5M8.5 3.5h3M7.5 11.5v.5M12.5 11.5v.5",
    "robot line": "M3 10h1M9.5 10h1M16 10h1M3.5 8.5a1.5 1.5 0 100 3 1.5 1.5 0 000-3"
    "M10 8.5a1.5 1.5 0 100 3 1.5 1.5 0 000-3"
    "M16.5 8.5a1.5 1.5 0 100 3 1.5 1.5 0 000-3",
    "robot area": "M3 4h14v12H3zM7 8v.5M12.5 9.5v.5M8.5 12.5v.5M14 13v.5M10.5 6.5v.5",
    "arena": "M3 4h14v12H3z" + _DASHED,
    "probe": "M10 3v4M10 13v4M3 10h4M13 10h4M10 9.7v.6",
    "probe line": "M3 16L17 4M2 14.8l2.4 2.4M6.7 10.8l2.4 2.4M11.3 6.8l2.4 2.4M15.8 2.8l2.4 2.4",
}  # fmt: skip
"""Outlines of the icons, as paths of SVG in a square of 20 units."""


class Palette:
    """Buttons of the kinds. taken: called with the kind once it has been chosen; kind: the present one."""

    def __init__(self, sheet: InlineStyleSheet, taken: Callable[[str], None]):
        self.kind, self._taken = SELECT, taken
        self.groups: dict[str, RadioButtonGroup] = {}
        rows: list[UIElement] = []
        for name, kinds in GROUPS.items():
            group = self.groups[name] = RadioButtonGroup(
                labels=list(kinds), active=0 if SELECT in kinds else None, orientation="vertical", width=WIDTH,
                stylesheets=[sheet, InlineStyleSheet(css=_icons(kinds))], css_classes=["palette"],
            )  # fmt: skip
            group.on_change("active", lambda _attr, _old, new, kinds=kinds: self._pressed(kinds, new))
            rows += [*([self._heading(name, group)] if name else []), group]
        self.layout = column(*rows, spacing=0)

    def _heading(self, name: str, group: RadioButtonGroup) -> Button:
        heading = Button(label=f"▾ {name}", width=WIDTH, css_classes=["heading"], name=f"heading {name}")

        def fold() -> None:
            group.visible = not group.visible
            heading.label = f"{'▾' if group.visible else '▸'} {name}"

        heading.on_click(fold)
        return heading

    def take(self, kind: str) -> None:
        """Choose a kind; a name without a button is ignored."""
        group, kinds = next(
            ((self.groups[name], kinds) for name, kinds in GROUPS.items() if kind in kinds), (None, ())
        )
        if group is not None:
            group.active = kinds.index(kind)

    def _pressed(self, kinds: tuple[str, ...], active: int | None) -> None:
        if active is None:
            return
        self.kind = kinds[active]
        for group in self.groups.values():
            if group.labels != list(kinds):
                group.active = None
        self._taken(self.kind)


def _icons(kinds: tuple[str, ...]) -> str:
    """Return the style sheet that puts an icon before each label."""
    rules = []
    for n, kind in enumerate(kinds, 1):
        svg = (
            "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 20 20' fill='none' stroke='black' stroke-width='1.5' "
            f"stroke-linecap='round' stroke-linejoin='round'><path d='{ICONS[kind]}'/></svg>"
        )
        rules.append(
            f'.bk-btn:nth-child({n})::before {{ mask-image: url("data:image/svg+xml,{quote(svg)}"); }}'
        )
    return "\n".join(rules)
