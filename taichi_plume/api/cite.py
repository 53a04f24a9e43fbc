"""BibTeX entries of the papers behind a run or a scenario."""

from pathlib import Path

from taichi_plume.assembly.preparation import Source, read
from taichi_plume.files.run_folder import is_run, read_json
from taichi_plume.report.references import bibtex
from taichi_plume.results.run import Run, open_run
from taichi_plume.version import __version__


def cite(source: Run | Source) -> str:
    """Return BibTeX entries of taichi_plume and of the papers that a run or a scenario uses.

    The papers are those of its search algorithms, gas maps, gases and winds; a comment above each entry names the part
    that uses the paper. source: run, folder of a run, or a scenario as for `simulate`. The text is UTF-8. Raises
    InputError.

    >>> import taichi_plume as tp
    >>> print(tp.cite("playback"))
    @misc{taichi_plume,
      author = {{The developers of taichi\\_plume}},
      ...
    }
    <BLANKLINE>
    % gas plumesim log: PlumeSim; wind plumesim log: PlumeSim
    @inproceedings{cabrita2010,
      author = {Cabrita, Gonçalo and Sousa, Pedro and Marques, Lino},
      ...
    """
    if isinstance(source, str | Path) and is_run(Path(source)):
        source = open_run(source)
    if isinstance(source, Run):
        return bibtex(
            source.scenario, str(read_json(source.folder / "result.json").get("version", __version__))
        )
    return bibtex(read(source), __version__)
