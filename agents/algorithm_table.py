"""Table of the search algorithms by kind.

To add an algorithm: derive a class from `algorithm.KernelAlgorithm` in its own file, write its parameters as a model
with a `kind` in scenario/algorithms.py, belief_algorithms.py or team_algorithms.py, and enter the class in ALGORITHMS.
One object drives the robots of all groups with that algorithm: member n is robot `members.robot[n]` of the swarm, and
counts as `members.number[n]` for random numbers; a class with `PER_GROUP` has an object per group. An algorithm reads
the swarm's `reading`, `wind`, `wind_known`, `blocked`, `believed_heading` and `odometer` (and `believed_position`, if
the robots are to have positioning) and writes `speed_command`, `turn_rate_command` and `state`. An algorithm must not
read true poses: `swarm.as_believed` rotates sensed vectors to walls and teammates into a robot's map. `swarm.declare`
declares a source. The attribute `beliefs`, if any, offers belief maps, which are recorded and scored.

Kernels read the model's parameters through `parameters`, so that new values need no compilation. `path_segments` and
`potential` drive for an algorithm, `acquisition` samples, and `radio` carries messages between the robots of a team.
"""

from taichi_plume.agents.algorithm import Algorithm
from taichi_plume.agents.casting import Casting
from taichi_plume.agents.casting_3d import Casting3D
from taichi_plume.agents.dapso import Dapso
from taichi_plume.agents.ecoli import EColi
from taichi_plume.agents.external import ExternalAlgorithm
from taichi_plume.agents.hit_map import HitMap
from taichi_plume.agents.infotaxis import Infotaxis, SpaceAwareInfotaxis
from taichi_plume.agents.least_known import LeastKnown
from taichi_plume.agents.lineup import LineUp
from taichi_plume.agents.particle_filter import ParticleFilter
from taichi_plume.agents.random_walk import RandomWalk
from taichi_plume.agents.source_term import SourceTerm
from taichi_plume.agents.spiral import Spiral
from taichi_plume.agents.surge_cast import SurgeCast
from taichi_plume.agents.surge_spiral import SurgeSpiral
from taichi_plume.agents.sweep import Sweep

ALGORITHMS: dict[str, type[Algorithm]] = {
    "casting": Casting,
    "casting_3d": Casting3D,
    "surge_cast": SurgeCast,
    "surge_spiral": SurgeSpiral,
    "spiral": Spiral,
    "ecoli": EColi,
    "infotaxis": Infotaxis,
    "particle_filter": ParticleFilter,
    "hit_map": HitMap,
    "source_term": SourceTerm,
    "space_aware_infotaxis": SpaceAwareInfotaxis,
    "dapso": Dapso,
    "lineup": LineUp,
    "sweep": Sweep,
    "least_known": LeastKnown,
    "random_walk": RandomWalk,
    "external": ExternalAlgorithm,
}
