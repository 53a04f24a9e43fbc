"""Random numbers: a seed, many independent named streams; the same numbers for any order of threads.

On the host: numpy generators. In kernels: Philox4x32-10, a counter-based generator (Salmon et al. 2011,
doi:10.1145/2063384.2063405), keyed by (seed, stream) and counted by (index, tick, draw).
"""

import zlib

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.elementary import cos_sin, log


def stream_id(name: str) -> int:
    """Return a 32-bit key of a component's name, the same on every machine."""
    return zlib.crc32(name.encode())


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the host's random generator for a seed and a component `name`."""
    return np.random.default_rng([seed, stream_id(name)])


@ti.func
def _high_product(a: ti.u32, b: ti.u32) -> ti.u32:
    return ti.cast((ti.cast(a, ti.u64) * ti.cast(b, ti.u64)) >> 32, ti.u32)


@ti.func
def philox(seed: ti.u32, stream: ti.u32, index: ti.i32, tick: ti.i32, draw: ti.i32):
    """Return four random 32-bit words for one (index, tick, draw) of a random stream."""
    x = ti.Vector([ti.cast(index, ti.u32), ti.cast(tick, ti.u32), ti.cast(draw, ti.u32), ti.u32(0)])
    key0, key1 = seed, stream
    for _ in ti.static(range(10)):
        a = ti.u32(0xD2511F53)
        b = ti.u32(0xCD9E8D57)
        x = ti.Vector(
            [
                _high_product(b, x[2]) ^ x[1] ^ key0,
                b * x[2],
                _high_product(a, x[0]) ^ x[3] ^ key1,
                a * x[0],
            ]
        )
        key0 += ti.u32(0x9E3779B9)
        key1 += ti.u32(0xBB67AE85)
    return x


@ti.func
def uniform4(seed: ti.u32, stream: ti.u32, index: ti.i32, tick: ti.i32, draw: ti.i32):
    """Return four numbers uniform in (0, 1) for one (index, tick, draw) of a random stream."""
    x = philox(seed, stream, index, tick, draw)
    return (ti.cast(x >> ti.u32(8), ti.f32) + 0.5) * (1.0 / 16777216.0)


@ti.func
def normal4(seed: ti.u32, stream: ti.u32, index: ti.i32, tick: ti.i32, draw: ti.i32):
    """Return four standard normal numbers for (index, tick, draw) (Box & Muller 1958, doi:10.1214/aoms/1177706645)."""
    u = uniform4(seed, stream, index, tick, draw)
    a = ti.sqrt(-2.0 * log(u[0])) * cos_sin(2.0 * np.pi * u[1])
    b = ti.sqrt(-2.0 * log(u[2])) * cos_sin(2.0 * np.pi * u[3])
    return ti.Vector([a[0], a[1], b[0], b[1]])
