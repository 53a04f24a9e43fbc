"""Space-aware infotaxis: infotaxis that also wants to be near the source.

Loisy & Eloy, Proc. R. Soc. A 478 (2022) 20220118, doi:10.1098/rspa.2022.0118. All is as in `infotaxis`, but for what a
step is to make small: the mean over what may come of it, a detection or none, of

    J = log2(D + 2^(H - 1) - 1/2),

0 if the source is found. D is the mean way to the source along the axes, in steps, and 2^H the number of places among
which a belief of entropy H [bit] is even. In the paper a place is a step wide; here it counts as so much of one as it
covers, at least as one in all.
"""

import taichi as ti

from taichi_plume.agents.beliefs import LEAST
from taichi_plume.agents.infotaxis import AnyInfotaxis

NEAR = 1e-3  # of a step: nothing counts as nearer, or its logarithm would outweigh all else


@ti.data_oriented
class SpaceAwareInfotaxis(AnyInfotaxis):
    """The space-aware infotaxis algorithm for the robots of one group, each with a belief of its own."""

    @ti.func
    def _cost(self, n, p):
        """Mean of J after an acquisition at p."""
        told = self._outcomes(n, p)
        step = self.p.step[n]
        cost = 0.0
        for k in ti.static(range(2)):
            w = told[k, 0]
            if w > LEAST:
                entropy = ti.log(w) - told[k, 1] / w  # nat
                places = ti.max(1.0, ti.exp(entropy) * (self.belief.cell / step) ** 2)
                cost += w * ti.log(ti.max(told[k, 2] / (w * step) + 0.5 * places - 0.5, NEAR)) / ti.log(2.0)
        return cost
