"""A page on which a scenario is drawn, checked and run (`taichi-plume draw`); its only state is the YAML text.

The only package that imports bokeh and tornado (extra ``draw``). `objects` draws a text, `edits` changes the text.
"""

MAY_IMPORT = (
    "assembly",
    "execution",
    "files",
    "grid",
    "guard",
    "observed",
    "record",
    "report",
    "results",
    "scenario",
    "studies",
)
