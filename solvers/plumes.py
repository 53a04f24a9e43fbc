"""Gaussian plumes of steady sources in a uniform wind: the mean plume, and the meandering plume moved by gusts.

    c = Q/U prod_k exp(-(q_k - q0_k - Y_k)²/(2 s_k²))/(sqrt(2 pi) s_k)

over the axes k across the wind, in 2-D divided by the depth of the slab. s_k grows with the distance x downwind. In the
mean plume Y is zero. In the meandering plume Y is the displacement of the air by gusts since it passed the source, x/U
ago: plume and anemometers see the same gusts. The straight rays that are often used instead, Y = x v(t - x/U)/U, are
equal for x << U T, T the gusts' integral time: the width of both means is the intensity of the gusts times x. Farther
away the air loses the memory of its gusts, and the mean plume widens as by diffusion, with the root of x.
"""

from taichi_plume.engine import ti
from taichi_plume.grid.fields import Gas
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.closed_forms import GaussianPlumeGas, MeanderingGas
from taichi_plume.scenario.vocabulary import Face
from taichi_plume.solvers.gaussian_kernels import gaussian, walls_along
from taichi_plume.solvers.gusts import OrnsteinUhlenbeck
from taichi_plume.solvers.uniform_wind import UniformSolver, memory


def most_walls(faces: tuple[Face, ...], dim: int) -> tuple[int, ...]:
    """Return the largest number of mirror walls along each axis across the wind, for any wind along the walls.

    With a ground or a ceiling the wind is horizontal, and the second axis across the wind is vertical.
    """
    level, upright = (sum((face[0] == "z") == flat for face in faces) for flat in (False, True))
    return tuple(min(2, most) for most in (level, upright or level)[: dim - 1])


class Plumes(Gas):
    """Gas as Gaussian plumes of steady sources, mean or meandering.

    Variance of the Gaussians: radius² + (b radius + c) x + d x², with b, c, d per axis across the wind. Fields: per
    source its place [m], radius [m] and flow [kg/m or kg/m²]; speed and axes of the wind, growth (b, c, d) and walls
    along each axis across the wind; fluctuation, the variance of the logarithm of the width.
    """

    STATE = ("width",)

    def __init__(
        self,
        gas: GaussianPlumeGas | MeanderingGas,
        grid: Grid,
        wind: UniformSolver,
        t: float = 0.0,
        seed: int = 0,
        name: str = "gas",
    ):
        """t: start of the run [s]; name: name of the gas, which selects its random numbers."""
        self.dim, self.wind, self.species = grid.dim, wind, gas.vapour
        self.count = len(gas.sources)
        self.meanders = gas.kind == "meandering"
        self.most = most_walls(gas.reflecting(grid.dim), grid.dim)
        self.width: OrnsteinUhlenbeck | None = None
        model, depth = wind.model, grid.depth if self.dim == 2 else 1.0
        fluctuation = gas.width_fluctuation
        self.place = ti.filled_vectors([source.position for source in gas.sources])
        self.flow = ti.filled([source.rate / model.speed / depth for source in gas.sources])
        self.radius = ti.filled([source.radius for source in gas.sources])
        self.speed, self.fluctuation = ti.filled(model.speed), ti.filled(fluctuation**2)
        self.axes = ti.filled_vectors(model.frame)
        self.growth = ti.filled_vectors(gas.growth(self.dim - 1, model.speed))
        self.walls = ti.filled_vectors(walls_along(gas.reflecting(self.dim), model.frame[1:], grid.extent))
        if self.meanders:
            assert model.gusts is not None, "a meandering plume needs a wind with gusts"
            reach, rng = memory(model, grid.extent), generator(seed, f"{name}.width_fluctuation")
            self.width = OrnsteinUhlenbeck([fluctuation], model.gusts.time, t, reach, rng)

    def advance(self, t: float, dt: float) -> None:
        if self.width is not None:
            self.width.advance(t + dt)

    @ti.func
    def concentration(self, x: Template, t: float):
        total = 0.0
        for n in range(self.count):
            along = self._component(x - self.place[n], 0)
            if along > 0.0:
                total += self._cross_section(x, along, n)
        return total

    @ti.func
    def _cross_section(self, x: Template, along: float, n: ti.i32):
        """Return the concentration of source n's plume at x, at the distance `along` [m] downwind of the source."""
        age = along / self.speed[None]
        carried = ti.Vector.zero(ti.f32, self.dim - 1)
        widening = 1.0
        if ti.static(self.meanders):
            carried = self.wind.gusts.before(age)[0]
            wider = self.width.before(age)[1]
            widening = ti.exp(2.0 * wider[0] - self.fluctuation[None])
        c = self.flow[n]
        for k in ti.static(range(self.dim - 1)):
            radius, g, walls = self.radius[n], self.growth[k], self.walls[k]
            variance = radius**2 + (g[0] * radius + g[1] + g[2] * along) * along
            if ti.static(k == 0 and self.meanders):
                variance *= widening
            centre = self._component(self.place[n], k + 1) + carried[k]
            c *= gaussian(self._component(x, k + 1), centre, variance, walls[0], walls[1], self.most[k])
        return c

    @ti.func
    def _component(self, x: Template, k: Template):
        """Return the component of the vector x along axis k of the wind's frame: 0 downwind, others across."""
        return self.axes[k].dot(x)
