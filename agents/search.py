"""The table of search algorithms.

To add one: derive a class from `algorithm.KernelAlgorithm` in a file of its own, its parameters as a model with a
`kind` in scenario/algorithms.py, and enter it in ALGORITHMS. One object drives the robots of all groups that have
chosen it: the n-th is robot `members.robot[n]` of the swarm, and counts as `members.number[n]` where random numbers
are drawn; a class with `PER_GROUP` has an object per group. Of its robots it reads the swarm's `reading`, `wind`,
`wind_known`, `blocked`, `believed_heading` and `odometer` (and `believed_position`, if the robots are to have
positioning) and writes `speed_command`, `turn_rate_command` and `state`. True poses are not for it: what a robot
senses around it, such as walls and mates, it puts into its map by `swarm.as_believed`. It may say where a source is,
by `swarm.declare`; one that has maps of where it believes the source to be offers them as `beliefs`, and they are
recorded and scored.

The numbers of its model reach kernels by `parameters`, so that others compile nothing. `legs` and `potential` drive for
it, `acquisition` listens, and `radio` carries messages between the robots of a team.
"""

from taichi_plume.agents.algorithm import Algorithm
from taichi_plume.agents.casting import Casting
from taichi_plume.agents.casting_3d import Casting3D
from taichi_plume.agents.dapso import Dapso
from taichi_plume.agents.ecoli import EColi
from taichi_plume.agents.external import ExternalAlgorithm
from taichi_plume.agents.hit_map import HitMap
from taichi_plume.agents.infotaxis import Infotaxis
from taichi_plume.agents.least_known import LeastKnown
from taichi_plume.agents.lineup import LineUp
from taichi_plume.agents.particle_filter import ParticleFilter
from taichi_plume.agents.random_walk import RandomWalk
from taichi_plume.agents.space_aware_infotaxis import SpaceAwareInfotaxis
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
    "space_aware_infotaxis": SpaceAwareInfotaxis,
    "dapso": Dapso,
    "lineup": LineUp,
    "sweep": Sweep,
    "least_known": LeastKnown,
    "random_walk": RandomWalk,
    "external": ExternalAlgorithm,
}
