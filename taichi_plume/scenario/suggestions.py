"""Suggestions for unknown names in error messages: similar known names, and advice for words such as "door"."""

import difflib
import re
from collections.abc import Collection
from functools import cache

# Everyday words after each advice: the vocabulary has no such name, or has it in another section than expected.
_EVERYDAY = {
    "a door or window is an opening in wind.openings: kind: outlet where air goes in or out freely, kind: inlet with a "
    "speed where it blows in; leave out a closed door": "door doors doorway gate window windows tür türe porte fenster",
    "a vent is an opening in wind.openings: kind: outlet, or kind: fan with a negative speed where air is drawn out": (
        "vent vents exhaust extractor suction hood exit duct grille drain outflow pressure_outlet"
    ),
    "air that is blown in is an opening in wind.openings: kind: inlet, or kind: fan": (
        "inflow supply blower ventilator ventilation diffuser entrance velocity_inlet air_conditioner ac hvac"
    ),
    "a table is a kind: box in obstacles; in 3-D its center and size say at what height it lies": (
        "table tables desk bench shelf tabletop counter tisch"
    ),
    "furniture is a kind: box in obstacles, or a kind: mesh from a file": (
        "chair chairs stool sofa couch bed cupboard cabinet wardrobe rack furniture crate car vehicle bookshelf stuhl"
    ),
    "a rectangle is a kind: box": "rectangle rect cube cuboid block square brick aabb barrier partition",
    "the sides of the room are walls without being named; a wall inside it is a kind: box in obstacles": (
        "wall walls wand mur room"
    ),
    "a person is a kind: cylinder in obstacles, with a motion if it walks, and what warms the air is in "
    "wind.buoyancy.heat.heaters": "person people human man woman pedestrian walker",
    "a round pillar is a kind: cylinder": "circle disc disk pillar column pole post tube pipe barrel bin tree tank",
    "a ball is a kind: sphere": "ball bubble dome",
    "a body over a polygon is a kind: prism": "polygon extrusion triangle hexagon",
    "a body from a file is a kind: mesh (STL, OBJ or PLY)": "stl obj ply cad model trimesh",
    "a floor plan is a kind: map (map_server's YAML and picture)": (
        "floorplan floor_plan occupancy occupancy_grid slam grid_map pgm costmap"
    ),
    "a heater is in wind.buoyancy.heat.heaters, or a warm wall in wind.buoyancy.heat.walls": (
        "heater heaters radiator stove oven fire hotplate lamp computer heizung"
    ),
    "a gas leak is in gas.sources": "leak leaks emitter release source odor odour",
    "gas sensors are kind: mox, kind: pid, kind: tdlas or kind: ideal; for one gas alone take kind: ideal with its "
    "lag and noise": "co2 co ndir electrochemical ec h2s nose enose e_nose catalytic infrared ir gas smell mq fid qcm",
    "an optical gas sensor is kind: tdlas, which reads the integral along its beam": "laser ogi open_path rmld",
    "no sensor of this kind is simulated: robots carry gas sensors and an anemometer, and know where obstacles are": (
        "lidar camera sonar ultrasound_range radar imu gps bumper rgbd depth infrared_range temperature humidity"
    ),
    "an anemometer with a hot wire is kind: thermal": "hotwire hot_wire hot_film wire",
    "an anemometer without moving parts is kind: ultrasonic": "sonic cup vane pitot windvane anemometer",
    "a wind that is the same everywhere is kind: uniform; velocity: [0, 0] is still air": (
        "constant steady none still calm zero off homogeneous laminar static"
    ),
    "a computed flow is kind: cfd": "navier_stokes navier-stokes les rans solver simulated computed lbm k_epsilon",
    "a flow from elsewhere is kind: imported": "openfoam gaden csv vtk paraview file files field import simscale",
    "random eddies without a solver are kind: synthetic": "turbulent turbulence random noise eddies brownian farrell",
    "puffs or filaments that the wind carries are kind: puffs": (
        "filament filaments puff lagrangian particle particles whiffs farrell"
    ),
    "a plume by a formula is kind: gaussian_plume (the mean) or kind: meandering; one computed on the grid is "
    "kind: eulerian": "plume gaussian gauss analytic analytical static pasquill",
    "gas on the grid is kind: eulerian": "grid advection advection_diffusion diffusion euler cfd field concentration",
    "a recorded plume is kind: movie, or kind: playback for a run of this simulator": "video recording recorded film",
    "casts across the wind are kind: casting, kind: surge_cast or kind: surge_spiral": (
        "cast zigzag zig_zag moth silkworm cast_and_surge surge upwind anemotaxis dung_beetle"
    ),
    "climbing the gradient is kind: ecoli (run and tumble) or kind: spiral": (
        "chemotaxis gradient gradient_ascent bacteria run_and_tumble hill_climbing braitenberg ecoli_chemotaxis"
    ),
    "another algorithm is a Python file of yours: kind: own": (
        "a_star astar dijkstra rrt custom python user algorithm script bug planner slam frontier potential_field"
    ),
    "an algorithm that was learnt is kind: policy": "rl ppo dqn sac reinforcement neural learned learnt network agent",
    "robots that are driven from outside are kind: external": "ros ros2 manual teleop keyboard joystick remote",
    "lanes to and fro are kind: sweep": "lawnmower lawn_mower coverage boustrophedon raster lanes",
    "swarm optimisation is kind: dapso": "pso swarm particle_swarm gso aco",
    "random legs are kind: random_walk": "random levy levy_walk brownian walk wander",
    "an algorithm with a belief is kind: infotaxis, kind: particle_filter or kind: hit_map": (
        "bayes bayesian pomdp entropy entrotaxis belief grid_filter mcmc kalman"
    ),
    "a map with variance is kind: gmrf or kind: kernel_dmv": (
        "kriging gp gaussian_process kernel_dm kernel kde gas_distribution markov"
    ),
    "a map of the wind is kind: wind_gmrf": "wind wind_map gw_gmrf anemometer airflow",
    "weights by the distance are kind: inverse_distance": "idw nearest interpolation average",
    "robots at random places are kind: area": "random rectangle box uniform region anywhere",
    "robots at given places are kind: positions": "point points position at fixed list place places",
    "robots in a row are kind: line": "grid row column formation",
    "a probe at one place is kind: point": "position at probe single",
    "x- is left, x+ right, y- front, y+ back, z- the floor, z+ the ceiling": (
        "left right front back bottom top floor ceiling west east south north x y z links rechts"
    ),
    "write species: ethanol": "alcohol etoh c2h5oh c2h6o ethylalcohol wine",
    "write species: methane": "natural_gas ch4 lng biogas",
    "write species: carbon_dioxide": "co2",
    "write species: carbon_monoxide": "co smoke",
    "write species: ammonia": "nh3",
    "write species: hydrogen": "h2",
    "write species: hydrogen_sulfide": "h2s",
    "write species: sulfur_dioxide": "so2",
    "write species: nitrogen_dioxide": "no2 nox",
    "write species: sulfur_hexafluoride": "sf6 tracer",
    "write species: 2-propanol": "isopropanol ipa isopropyl isopropyl_alcohol propanol",
    "write species: propane": "lpg c3h8",
}
# Names of keys that mean the same to people, in each line.
_SYNONYMS = [
    set(line.split())
    for line in (
        "speed velocity wind_speed flow_speed",
        "position positions location pos place at coordinates xy xyz center centre origin",
        "size width length dimensions dims extent edges shape",
        "diameter radius r d",
        "count number n num amount quantity",
        "rate emission emission_rate strength source_rate mass_flow flux flow_rate",
        "spacing resolution dx cell cell_size grid_size grid step",
        "duration time end simulation_time t_end length",
        "tick dt timestep time_step step",
        "kind type class",
        "species gas substance chemical compound",
        "yaw_deg heading_deg angle rotation yaw orientation heading theta",
        "face side wall boundary",
        "file files path filename mesh_file",
        "reach capture_radius goal_radius success_radius",
        "max_speed speed velocity v_max",
        "robots agents robot drones team",
        "obstacles objects walls furniture geometry",
        "sources source emitters leaks",
        "openings boundaries inlets outlets boundary_conditions vents fans",
        "sensors sensor noses",
        "algorithm strategy controller behaviour behavior policy planner",
        "wind air flow airflow",
        "domain room world environment grid",
        "threshold_ppm threshold detection_threshold",
        "localization localisation odometry mocap motion_capture tracking gps pose_error",
        "seed random_seed rng",
        "warm_up warmup spinup spin_up",
    )
]
_NEAR = 0.6  # difflib's ratio of names that are written alike


def plain(name: object) -> str:
    """Return a name in lower case without spaces, dashes and underscores."""
    return re.sub(r"[\W_]+", "", str(name).casefold())


@cache
def _everyday() -> dict[str, list[str]]:
    """Return the advice for each everyday word such as "door"; the words are written as `plain` returns them."""
    found: dict[str, list[str]] = {}
    for advice, words in _EVERYDAY.items():
        for word in words.split():
            found.setdefault(plain(word), []).append(advice)
    return found


def nearest(got: object, names: Collection[str], cutoff: float = _NEAR) -> str:
    """Return the one of `names` spelled most like `got`, ignoring capitals; "" if none. cutoff: least similarity."""
    folded, word = {name.casefold(): name for name in names}, str(got).strip().casefold()
    spelled = [name for name in names if plain(name) == plain(got)]
    if word not in folded and len(spelled) == 1:
        return spelled[0]
    close = difflib.get_close_matches(word, folded, n=1, cutoff=cutoff)
    return folded[close[0]] if close else ""


def advice(got: object, names: Collection[str]) -> str:
    """Return advice for an everyday word that means one of `names`, or belongs to another section; "" otherwise."""
    hints = _everyday().get(plain(got), [])
    named = "|".join(map(re.escape, names))
    fits = [hint for hint in hints if re.search(rf"(kind:|species:) ({named})(?![\w-])", hint)]
    elsewhere = [hint for hint in hints if " in " in hint or "kind:" not in hint]
    return next(iter([*fits, *elsewhere]), "")


def meant_key(got: object, keys: Collection[str], cutoff: float = _NEAR) -> str:
    """Return the key that was probably meant by `got`: a synonym or spelled alike; "" if there is none."""
    same = {plain(word) for group in _SYNONYMS if plain(got) in map(plain, group) for word in group}
    return next((key for key in keys if plain(key) in same), "") or nearest(got, keys, cutoff)


def hint(got: object, names: Collection[str]) -> str:
    """Return a hint about a name `got` that is not one of `names`, to stand before their list in a message; or ""."""
    close = nearest(got, names)
    if plain(close) != plain(got) and (text := advice(got, names)):
        return f"{text}; "
    return f"did you mean '{close}'? " if close else ""
