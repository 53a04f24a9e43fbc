"""Three-stage, second-order Runge-Kutta time stepping of the flow, with projections (SSP-RK3 at its longest)."""

SHORT, LONG = 0.58, 1.0  # first stages, over the step
STABLE = 1.3  # Courant number up to which the short one is


def stages_for(courant: float) -> tuple[tuple[float, float, float], ...]:
    """`stages` of steps of up to a Courant number: those that damp least."""
    return stages(SHORT if courant <= STABLE else LONG)


def stages(first: float) -> tuple[tuple[float, float, float], ...]:
    """Of a step from u0, (k, c, g) of each stage: u becomes u0 + k (u - u0 + dt du/dt), what it will be c dt later, and
    is projected where g is not 0: the pressure has lagged for g dt then.

    All of second order, for any `first`, the length of the first stage over the step's. With 1 it is SSP-RK3 (Shu &
    Osher 1988, doi:10.1016/0021-9991(88)90177-5), which damps waves that the wind carries: the energy of one that goes
    by the angle a in a step becomes 1 - a⁴/12 of what it was. In general that is 1 - (2 C - 1/4) a⁴ + C² a⁶, with
    C = first/(2 + 4 first): from 1/2 on it grows by the last term only, which the upwind scheme of convection outweighs
    up to a Courant number of 1.3.

    Were the last projection the only one, short waves that the wind carries on by a cell or so would lose or gain
    energy. One after the first stage changes nothing.
    """
    second = 1.0 / (1.0 + 3.0 * first)
    third = (1.0 + 3.0 * first) / (2.0 + 4.0 * first)
    reached = second * (1.0 + first)
    return (first, first, 0.0), (second, reached, reached), (third, 1.0, third)
