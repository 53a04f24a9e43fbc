"""Prior of the source's position on the cells of a belief, from the key `prior` of a search algorithm.

The prior probability of cell b is w_b / Σ w, with the mean weight w_b of the key's weights over the cell. A belief
starts from the prior, and by Bayes' rule the posterior after readings z is proportional to w_b Π P(z | source in b).
"""

import numpy as np

from taichi_plume.agents.members import Members
from taichi_plume.scenario.loading import ScenarioError

INSIDE = 0.5**0.5  # cell edges from the centre to a corner


def prior_weights(members: Members, cell: float) -> np.ndarray:
    """Return the weights (nx, ny) of square cells of edge `cell` [m] of the search area, with mean 1.

    They are 1 without a prior. The prior is that of the first group. Raises ScenarioError if the prior is zero outside
    of obstacles.
    """
    clearance = members.swarm.clearance
    low, extent = np.array(clearance.low), np.array(clearance.high) - clearance.low
    nx, ny = (max(1, round(length / cell)) for length in extent)
    prior = members.swarm.priors.get(members.numbers[0])
    if prior is None:
        return np.ones((nx, ny))
    weights = prior.on(low, cell, (nx, ny))
    centres = low + cell * (np.moveaxis(np.indices((nx, ny)), 0, -1) + 0.5)
    in_air = clearance.obstacle_distance_at(centres) > -INSIDE * cell
    require_prior(members, (weights * in_air)[None])
    return weights / weights.mean()


def require_prior(members: Members, beliefs: np.ndarray) -> None:
    """Raise ScenarioError if the prior of some robot, (robots, nx, ny), is zero in all cells that gas can reach."""
    if not beliefs.any(axis=(1, 2)).all():
        what = (
            "is zero in all cells that gas and robots can reach; give weight to places outside of obstacles"
        )
        raise ScenarioError([f"robots[{members.numbers[0]}].algorithm.prior: {what}"])
