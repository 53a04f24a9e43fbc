"""References: papers behind the algorithms, gas maps, gases and winds of a run, as plain text and as BibTeX.

The modules' docstrings cite the same papers beside the equations. Add a new kind's papers to `PAPERS` and to its table.
"""

import re
from typing import NamedTuple

from taichi_plume.scenario.scenario import Scenario

IROS = "IEEE/RSJ International Conference on Intelligent Robots and Systems"
ICRA = "IEEE International Conference on Robotics and Automation"
LONGEST_VERSION = 40  # characters


class Paper(NamedTuple):
    """Bibliographic data of a paper.

    key: that of the BibTeX entry. authors: as BibTeX has them, "Family, Given and Family, Given"; given names may be
    missing. title: empty if only the DOI identifies the paper. venue: journal, proceedings or book. doi, arxiv:
    identifiers without address. entry: BibTeX type.
    """

    key: str
    authors: str
    title: str
    venue: str
    year: int
    volume: str = ""
    pages: str = ""
    doi: str = ""
    arxiv: str = ""
    entry: str = "article"

    def text(self) -> str:
        """Return the reference as a line of plain text, without a full stop."""
        families = [author.partition(",")[0] for author in self.authors.split(" and ")]
        if families[-1] == "others":
            names = f"{', '.join(families[:-1])} et al."
        else:
            names = " & ".join(filter(None, (", ".join(families[:-1]), families[-1])))
        year = f" ({self.year})" if str(self.year) not in self.venue else ""
        pages = self.pages and (f" {self.pages}" if self.entry == "article" else f", {self.pages}")
        where = f"{self.venue} {self.volume}".rstrip() + year + pages
        quoted = f'"{self.title}"' if self.title else ""
        doi, arxiv = self.doi and f"doi:{self.doi}", self.arxiv and f"arXiv:{self.arxiv}"
        return ", ".join(filter(None, (names, quoted, where, doi, arxiv)))

    def bibtex(self) -> str:
        """Return the reference as a BibTeX entry."""
        fields = {
            "author": self.authors,
            "title": self.title and f"{{{_escaped(self.title)}}}",  # the inner braces keep capitals
            "journal" if self.entry == "article" else "booktitle": self.venue,
            "year": str(self.year),
            "volume": self.volume,
            "pages": self.pages.replace("-", "--"),
            "doi": self.doi,
            "eprint": self.arxiv,
            "eprinttype": self.arxiv and "arXiv",
        }
        fields |= {name: _escaped(value) for name, value in fields.items() if name != "title"}
        return _entry(self.entry, self.key, fields)


class Use(NamedTuple):
    """A paper that a kind is based on. key: that of the paper; remark: the part of the kind that rests on the paper."""

    key: str
    remark: str = ""


PAPERS = {
    paper.key: paper
    for paper in (
        Paper(
            "akat2008", "Akat, S. Burak and Gazi, Veysel", "Decentralized asynchronous particle swarm optimization",
            "IEEE Swarm Intelligence Symposium", 2008, entry="inproceedings",
        ),
        Paper(
            "asadi2011",
            "Asadi, Sahar and Reggente, Matteo and Stachniss, Cyrill and Plagemann, Christian and "
            "Lilienthal, Achim J.",
            "Statistical gas distribution modelling using kernel methods",
            "Intelligent Systems for Machine Olfaction: Tools and Methodologies", 2011, pages="153-179",
            entry="incollection",
        ),
        Paper(
            "bridson2007", "Bridson, Robert and Hourihan, Jim and Nordenstam, Marcus",
            "Curl-noise for procedural fluid flow", "ACM Transactions on Graphics", 2007, "26", "46",
            "10.1145/1276377.1276435",
        ),
        Paper(
            "cabrita2010", "Cabrita, Gonçalo and Sousa, Pedro and Marques, Lino",
            "Player/Stage simulation of olfactory experiments", f"{IROS} (IROS 2010)", 2010, entry="inproceedings",
        ),
        Paper(
            "clerc2002", "Clerc, M. and Kennedy, J.",
            "The particle swarm - explosion, stability, and convergence in a multidimensional complex space",
            "IEEE Transactions on Evolutionary Computation", 2002, "6", "58-73",
        ),
        Paper(
            "farrell2002", "Farrell, Jay A. and Murlis, John and Long, Xuezhu and Li, Wei and Cardé, Ring T.",
            "Filament-based atmospheric dispersion model to achieve short time-scale structure of odor plumes",
            "Environmental Fluid Mechanics", 2002, "2", "143-169", "10.1023/A:1016283702837",
        ),
        Paper(
            "ferri2009",
            "Ferri, Gabriele and Caselli, Emanuele and Mattoli, Virgilio and Mondini, Alessio and "
            "Mazzolai, Barbara and Dario, Paolo",
            "SPIRAL: A novel biologically-inspired algorithm for gas/odor source localization in an indoor "
            "environment with no strong airflow",
            "Robotics and Autonomous Systems", 2009, "57", "393-402",
        ),
        Paper(
            "fung1992", "Fung and others", "", "Journal of Fluid Mechanics", 1992, doi="10.1017/S0022112092001423"
        ),
        Paper(
            "gillespie1996", "Gillespie, D. T.",
            "Exact numerical simulation of the Ornstein-Uhlenbeck process and its integral", "Physical Review E",
            1996, "54", "2084-2091", "10.1103/PhysRevE.54.2084",
        ),
        Paper(
            "gordon1993", "Gordon, N. J. and Salmond, D. J. and Smith, A. F. M.",
            "Novel approach to nonlinear/non-Gaussian Bayesian state estimation", "IEE Proceedings F", 1993, "140",
            "107-113", "10.1049/ip-f-2.1993.0015",
        ),
        Paper(
            "kitagawa1996", "Kitagawa, Genshiro",
            "Monte Carlo filter and smoother for non-Gaussian nonlinear state space models",
            "Journal of Computational and Graphical Statistics", 1996, "5", "1-25",
            "10.1080/10618600.1996.10474692",
        ),
        Paper(
            "li2011", "Li and Meng and Wang and Zeng",
            "Odor source localization using a mobile robot in outdoor airflow environments with a particle filter "
            "algorithm",
            "Autonomous Robots", 2011, "30", "281-292", "10.1007/s10514-011-9219-2",
        ),
        Paper(
            "li2014", "Li, Shoutao and Li, Lina and Lee, Gordon and Zhang, Hao",
            "A hybrid search algorithm for swarm robots searching in an unknown environment", "PLoS ONE", 2014, "9",
            "e111970",
        ),
        Paper(
            "lilienthal2009",
            "Lilienthal, Achim J. and Reggente, Matteo and Trincavelli, Marco and Blanco, Jose Luis and "
            "Gonzalez, Javier",
            "A statistical approach to gas distribution modelling with mobile robots - The Kernel DM+V algorithm",
            f"{IROS} (IROS 2009)", 2009, entry="inproceedings",
        ),
        Paper(
            "lochmatter2009", "Lochmatter, T. and Martinoli, A.",
            "Theoretical analysis of three bio-inspired plume tracking algorithms", f"{ICRA} (ICRA 2009)", 2009,
            doi="10.1109/ROBOT.2009.5152521", entry="inproceedings",
        ),
        Paper(
            "lochmatter2009tracking", "Lochmatter, T. and Martinoli, A.",
            "Tracking odor plumes in a laminar wind field with bio-inspired algorithms",
            "International Symposium on Experimental Robotics (ISER 2008)", 2009, pages="473-482",
            entry="inproceedings",
        ),
        Paper(
            "loisy2022", "Loisy, Aurore and Eloy, Christophe",
            "Searching for a source without gradients: how good is infotaxis and how to beat it",
            "Proceedings of the Royal Society A", 2022, "478", "20220118", "10.1098/rspa.2022.0118",
        ),
        Paper(
            "marjovi2013", "Marjovi, Ali and Marques, Lino",
            "Optimal spatial formation of swarm robotic gas sensors in odor plume finding", "Autonomous Robots", 2013,
            "35", "93-109",
        ),
        Paper(
            "marjovi2014", "Marjovi, Ali and Marques, Lino", "Optimal swarm formation for odor plume finding",
            "IEEE Transactions on Cybernetics", 2014, "44", "2302-2315",
        ),
        Paper(
            "marjovi2014mapping", "Marjovi, Ali and Marques, Lino",
            "Multi-robot odor distribution mapping in realistic time-variant conditions", f"{ICRA} (ICRA 2014)", 2014,
            entry="inproceedings",
        ),
        Paper(
            "metais1992", "Métais, Olivier and Lesieur, Marcel", "", "Journal of Fluid Mechanics", 1992,
            doi="10.1017/S0022112092000733",
        ),
        Paper(
            "monroy2016", "Monroy, Javier G. and Blanco, Jose-Luis and Gonzalez-Jimenez, Javier",
            "Time-variant gas distribution mapping with obstacle information", "Autonomous Robots", 2016, "40", "1-16",
        ),
        Paper(
            "ojeda2021", "Ojeda, Pepe and Monroy, Javier and Gonzalez-Jimenez, Javier",
            "Information-driven gas source localization exploiting gas and wind local measurements for autonomous "
            "mobile robots",
            "IEEE Robotics and Automation Letters", 2021, "6", "1320-1326", "10.1109/LRA.2021.3057290",
        ),
        Paper(
            "ojeda2024", "Ojeda, Pepe and Monroy, Javier and Gonzalez-Jimenez, Javier",
            "Robotic gas source localization with probabilistic mapping and online dispersion simulation",
            "IEEE Transactions on Robotics", 2024, arxiv="2304.08879",
        ),
        Paper(
            "reggente2009", "Reggente, Matteo and Lilienthal, Achim J.",
            "Using local wind information for gas distribution mapping in outdoor environments with a mobile robot",
            "Proceedings of IEEE Sensors", 2009, pages="1715-1720", entry="inproceedings",
        ),
        Paper(
            "russell2003", "Russell, R. A. and Bab-Hadiashar, A. and Shepherd and Wallace, G.",
            "A comparison of reactive robot chemotaxis algorithms", "Robotics and Autonomous Systems", 2003, "45",
            "83-97",
        ),
        Paper(
            "rutkowski2005", "Rutkowski and Edwards and Willis, Mark A. and Quinn, Roger D. and Causey",
            "Moth-inspired plume tracking strategies in three-dimensions", f"{ICRA} (ICRA 2005)", 2005,
            entry="inproceedings",
        ),
        Paper(
            "rutkowski2006", "Rutkowski and Willis, Mark A. and Quinn, Roger D.",
            "Simulated odor tracking in a plane normal to the wind direction", f"{ICRA} (ICRA 2006)", 2006,
            entry="inproceedings",
        ),
        Paper(
            "sreenivasan1995", "Sreenivasan, K. R.", "On the universality of the Kolmogorov constant",
            "Physics of Fluids", 1995, "7", "2778-2784", "10.1063/1.868656",
        ),
        Paper(
            "turduev2014", "Turduev and Cabrita, Gonçalo and Kırtay and Gazi, Veysel and Marques, Lino",
            "Experimental studies on chemical concentration map building by a multi-robot system using bio-inspired "
            "algorithms",
            "Autonomous Agents and Multi-Agent Systems", 2014, "28", "72-100",
        ),
        Paper(
            "vergassola2007", "Vergassola, Massimo and Villermaux, Emmanuel and Shraiman, Boris I.",
            "'Infotaxis' as a strategy for searching without gradients", "Nature", 2007, "445", "406-409",
            "10.1038/nature05464",
        ),
    )
}  # fmt: skip
"""Papers by key, sorted."""

PLUMESIM = (Use("cabrita2010", "PlumeSim"),)
SEARCHES: dict[str, tuple[Use, ...]] = {
    "casting": (Use("lochmatter2009tracking"),),
    "casting_3d": (
        Use("rutkowski2005", "Casting to all sides of the wind as moths do"),
        Use("rutkowski2006", "Likewise"),
    ),
    "surge_cast": (Use("lochmatter2009"),),
    "surge_spiral": (Use("lochmatter2009"),),
    "spiral": (Use("ferri2009"),),
    "ecoli": (Use("russell2003"), Use("ferri2009", "Parameters")),
    "infotaxis": (Use("vergassola2007"),),
    "space_aware_infotaxis": (Use("loisy2022"),),
    "particle_filter": (
        Use("li2011"),
        Use("kitagawa1996", "Resampling"),
        Use("gordon1993", "Roughening"),
    ),
    "hit_map": (Use("ojeda2021", "GrGSL"), Use("ojeda2024", "PMFS")),
    "dapso": (
        Use("akat2008"),
        Use("turduev2014", "Use for gas maps"),
        Use("clerc2002", "Constriction"),
        Use("li2014", "Exploration that a reading ends"),
    ),
    "lineup": (Use("marjovi2014"), Use("marjovi2013")),
    "sweep": (Use("turduev2014", "Systematic search with which swarms are compared"),),
    "least_known": (Use("marjovi2014mapping", "Eq 6"),),
}
MAPS: dict[str, tuple[Use, ...]] = {
    "time_series": (Use("marjovi2014mapping", "Eq 4-7"),),
    "inverse_distance": (Use("marjovi2014mapping", "Eq 1-3"),),
    "kernel_dmv": (
        Use("lilienthal2009", "DM+V"),
        Use("asadi2011", "Older readings count less"),
        Use("reggente2009", "DM+V/W, stretched along the wind"),
    ),
    "gmrf": (Use("monroy2016"),),
}
GASES: dict[str, tuple[Use, ...]] = {
    "puffs": (
        Use("farrell2002", "Improved filament model"),
        Use("gillespie1996", "Exact steps of the random wind"),
    ),
    "plumesim_gaussian": PLUMESIM,
    "plumesim_meandering": PLUMESIM,
    "plumesim_log": PLUMESIM,
    "fluent": PLUMESIM,
}
WINDS: dict[str, tuple[Use, ...]] = {
    "synthetic": (
        Use("fung1992", "Kinematic simulation"),
        Use("bridson2007", "No air through walls"),
        Use("metais1992", "Dissipation"),
        Use("sreenivasan1995", "Dissipation"),
    ),
    "plumesim_log": PLUMESIM,
}


def used(scenario: Scenario) -> dict[str, tuple[Use, ...]]:
    """Return the papers of each search algorithm, gas map, gas and wind of a scenario that is based on papers."""
    parts = [(SEARCHES, "search algorithm", group.algorithm.kind) for group in scenario.robots]
    parts += [(MAPS, "gas map", gas_map.kind) for gas_map in scenario.maps]
    parts += [(GASES, "gas", gas.kind) for _, gas in scenario.gases]
    parts.append((WINDS, "wind", scenario.wind.kind))
    return {f"{part} {kind}".replace("_", " "): table[kind] for table, part, kind in parts if kind in table}


def papers(scenario: Scenario) -> list[tuple[str, str]]:
    """Return (name, references in plain text) of each part of a scenario that is based on papers."""
    return [(name, " ".join(f"{_line(use)}." for use in uses)) for name, uses in used(scenario).items()]


def _line(use: Use) -> str:
    return f"{use.remark}: {PAPERS[use.key].text()}" if use.remark else PAPERS[use.key].text()


def bibtex(scenario: Scenario, version: str) -> str:
    """Return BibTeX entries of taichi_plume and of the papers that a scenario uses, each below a comment on its use."""
    uses: dict[str, list[str]] = {}
    for name, several in used(scenario).items():
        for key, remark in several:
            uses.setdefault(key, []).append(f"{name}: {remark}" if remark else name)
    entries = [f"% {'; '.join(uses[key])}\n{PAPERS[key].bibtex()}" for key in sorted(uses)]
    return "\n\n".join([software(version), *entries])


def software(version: str) -> str:
    """Return the BibTeX entry of a version of taichi_plume, with the data of CITATION.cff."""
    fields = {
        "author": "{The developers of taichi_plume}",
        "title": "{taichi_plume: air flow, odour plumes, robots with gas sensors and gas maps from one file}",
        "note": f"Version {re.sub(r'[^A-Za-z0-9.+-]', '', version)[:LONGEST_VERSION]}",
    }
    return _entry("misc", "taichi_plume", {name: _escaped(value) for name, value in fields.items()})


def _escaped(text: str) -> str:
    """Return a text in which the special characters of LaTeX that occur in references are escaped."""
    return re.sub(r"([&%#_$])", r"\\\1", text)


def _entry(kind: str, key: str, fields: dict[str, str]) -> str:
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])
