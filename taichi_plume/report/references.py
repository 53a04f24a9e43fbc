"""References: papers behind the algorithms, gas maps, gases and winds of a run, for the report's section on citing.

The modules' docstrings cite the same papers beside the equations. Add a new kind's papers here, too.
"""

from taichi_plume.scenario.scenario import Scenario

FERRI = (
    "Ferri, Caselli, Mattoli, Mondini, Mazzolai & Dario, Robotics and Autonomous Systems 57 (2009) 393-402."
)
LOCHMATTER = (
    'Lochmatter & Martinoli, "Theoretical analysis of three bio-inspired plume tracking algorithms", ICRA 2009, '
    "doi:10.1109/ROBOT.2009.5152521."
)
MARJOVI = 'Marjovi & Marques, "Multi-Robot Odor Distribution Mapping in Realistic Time-Variant Conditions", ICRA 2014'
PLUMESIM = (
    'PlumeSim: Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010.'
)
TURDUEV = (
    "Turduev, Cabrita, Kırtay, Gazi & Marques, Autonomous Agents and Multi-Agent Systems 28 (2014) 72-100"
)
SEARCHES: dict[str, str] = {
    "casting": 'Lochmatter & Martinoli, "Tracking odor plumes in a laminar wind field with bio-inspired algorithms", '
    "ISER 2008.",
    "casting_3d": "Casting to all sides of the wind as moths do: Rutkowski, Edwards, Willis, Quinn & Causey, "
    '"Moth-inspired plume tracking strategies in three-dimensions", ICRA 2005; Rutkowski, Willis & Quinn, '
    '"Simulated odor tracking in a plane normal to the wind direction", ICRA 2006.',
    "surge_cast": LOCHMATTER,
    "surge_spiral": LOCHMATTER,
    "spiral": FERRI,
    "ecoli": "Russell, Bab-Hadiashar, Shepherd & Wallace, Robotics and Autonomous Systems 45 (2003) 83-97. Its "
    f"parameters: {FERRI}",
    "infotaxis": "Vergassola, Villermaux & Shraiman, Nature 445 (2007) 406-409, doi:10.1038/nature05464.",
    "space_aware_infotaxis": "Loisy & Eloy, Proc. R. Soc. A 478 (2022) 20220118, doi:10.1098/rspa.2022.0118.",
    "particle_filter": 'Li, Meng, Wang & Zeng, "Odor source localization using a mobile robot in outdoor airflow '
    'environments with a particle filter algorithm", Autonomous Robots 30 (2011) 281-292, '
    "doi:10.1007/s10514-011-9219-2. Resampling: Kitagawa 1996, doi:10.1080/10618600.1996.10474692; roughening: Gordon, "
    "Salmond & Smith 1993, doi:10.1049/ip-f-2.1993.0015.",
    "hit_map": 'Ojeda, Monroy & Gonzalez-Jimenez, "Information-driven gas source localization exploiting gas and wind '
    'local measurements for autonomous mobile robots", IEEE Robotics and Automation Letters 6 (2021) 1320-1326, '
    'doi:10.1109/LRA.2021.3057290 (GrGSL), and "Robotic gas source localization with probabilistic mapping and online '
    'dispersion simulation", IEEE Trans. Robotics (2024), arXiv:2304.08879 (PMFS).',
    "dapso": 'Akat & Gazi, "Decentralized asynchronous particle swarm optimization", IEEE Swarm Intelligence Symposium '
    f"2008, used for gas maps by {TURDUEV}. Constriction: Clerc & Kennedy, IEEE Trans. Evolutionary Computation 6 "
    "(2002) 58-73. Exploration that a reading ends: Li, Li, Lee & Zhang, PLoS ONE 9 (2014) e111970.",
    "lineup": 'Marjovi & Marques, "Optimal swarm formation for odor plume finding", IEEE Trans. Cybernetics 44 (2014) '
    "2302-2315, and Autonomous Robots 35 (2013) 93-109.",
    "sweep": f"The systematic search with which swarms are compared by {TURDUEV}.",
    "least_known": f"{MARJOVI}, eq 6.",
}
MAPS: dict[str, str] = {
    "time_series": f"{MARJOVI}, eq 4-7.",
    "inverse_distance": f"{MARJOVI}, eq 1-3.",
    "kernel_dmv": "Lilienthal, Reggente, Trincavelli, Blanco & Gonzalez, IROS 2009 (DM+V); Asadi et al. 2011 (older "
    "readings count less); Reggente & Lilienthal 2009 (DM+V/W: stretched along the wind).",
    "gmrf": "Monroy, Blanco & Gonzalez-Jimenez, Autonomous Robots 2016.",
}
GASES: dict[str, str] = {
    "puffs": "Farrell et al. 2002, doi:10.1023/A:1016283702837, improved. Exact steps of the random wind: Gillespie "
    "1996, doi:10.1103/PhysRevE.54.2084.",
    "plumesim_gaussian": PLUMESIM,
    "plumesim_meandering": PLUMESIM,
    "plumesim_log": PLUMESIM,
    "fluent": PLUMESIM,
}
WINDS: dict[str, str] = {
    "synthetic": "Kinematic simulation: Fung et al. 1992, doi:10.1017/S0022112092001423. No air through walls: Bridson "
    "et al. 2007, doi:10.1145/1276377.1276435. Dissipation: Metais & Lesieur 1992, doi:10.1017/S0022112092000733; "
    "Sreenivasan 1995, doi:10.1063/1.868656.",
    "plumesim_log": PLUMESIM,
}


def papers(scenario: Scenario) -> list[tuple[str, str]]:
    """Return (name, papers) of each search algorithm, gas map, gas and wind of a scenario that is based on papers."""
    used = [(SEARCHES, "search algorithm", group.algorithm.kind) for group in scenario.robots]
    used += [(MAPS, "gas map", gas_map.kind) for gas_map in scenario.maps]
    used += [(GASES, "gas", gas.kind) for _, gas in scenario.gases]
    used.append((WINDS, "wind", scenario.wind.kind))
    rows = [(f"{part} {kind}".replace("_", " "), table[kind]) for table, part, kind in used if kind in table]
    return list(dict(rows).items())
