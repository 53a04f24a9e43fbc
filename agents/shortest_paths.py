"""Shortest paths (path planning) over a floor of square cells, around obstacles."""

from taichi_plume.engine import ti

FAR = 1e9  # m: no path
MOST_SWEEPS = 1000  # each four passes over all cells; paths around n corners take about n sweeps
ROOT_OF_TWO = 2**0.5
CLOSER = 1e-5  # m by which a path must be shorter than the previous one


class Ways:
    """Shortest paths between the centres of all floor cells, at least `room` [m] from all obstacles.

    A path is straight if the line of sight is free. Otherwise it goes from cell to cell (of eight neighbours) after the
    last cell in sight. A segment is free if the clearance all along is above `room`, so walls thinner than a cell
    count. `free[a]`: whether cell a has that clearance. `length[a, b]`: path length [m], FAR without a path. `via[a,
    b]`: last cell in sight of a on the path to b, -1 without a path. Cells are numbered with the last axis fastest.
    """

    def __init__(self, clearance: object, cell: float, room: float):
        self.clearance, self.cell = clearance, cell
        self.low = (float(clearance.low[0]), float(clearance.low[1]))
        self.shape = tuple(
            max(1, round((high - low) / cell)) for low, high in zip(self.low, clearance.high, strict=True)
        )
        self.count = self.shape[0] * self.shape[1]
        self.step = 0.5 * clearance.resolution  # m; a wall, even the thinnest, blocks more of a stretch
        self.free = ti.field(ti.i32, self.count)
        self.open = ti.field(ti.i32, (self.count, 8))  # whether the way to each neighbour is free
        self.length = ti.field(ti.f32, (self.count, self.count))
        self.via = ti.field(ti.i16, (self.count, self.count))
        self._look(room)
        self._find(room)

    @ti.func
    def center(self, a):
        """Return the centre (2,) [m] of the cell with index a."""
        return ti.Vector(self.low) + self.cell * (ti.Vector([a // self.shape[1], a % self.shape[1]]) + 0.5)

    @ti.func
    def cell_of(self, p):
        """Return the index of the cell nearest to the point p [m]."""
        at = ti.cast(ti.floor((p - ti.Vector(self.low)) / self.cell), ti.i32)
        at = ti.math.clamp(at, 0, ti.Vector(self.shape) - 1)
        return at[0] * self.shape[1] + at[1]

    @ti.func
    def free_cell_of(self, p):
        """Return the index of the free cell nearest to the point p [m]; -1 if no cell is free."""
        best, nearest = self.cell_of(p), 0.0
        if self.free[best] == 0:
            best, nearest = -1, FAR
            for a in range(self.count):
                distance = (self.center(a) - p).norm()
                if self.free[a] == 1 and distance < nearest:
                    best, nearest = a, distance
        return best

    @ti.func
    def _sees(self, p, q, room):
        """Return whether the straight line from p to q [m] keeps a clearance above `room` [m] from all obstacles."""
        whole = (q - p).norm()
        e = (q - p) / ti.max(whole, CLOSER)
        s, free = 0.0, self.clearance.distance(q) > room
        while s < whole and free:
            gap = self.clearance.distance(p + s * e) - room
            free = gap > 0.0
            s += ti.max(gap, self.step)
        return free

    @ti.func
    def _neighbour(self, a, k):
        """Return the index of the k-th of the eight neighbours of cell a, -1 if the neighbour is off the floor."""
        j = k + ti.cast(k >= 4, ti.i32)  # cells of nine, without the middle
        x, y = a // self.shape[1] + j // 3 - 1, a % self.shape[1] + j % 3 - 1
        inside = x >= 0 and x < self.shape[0] and y >= 0 and y < self.shape[1]
        return ti.select(inside, x * self.shape[1] + y, -1)

    @ti.kernel
    def _look(self, room: float):
        for a in range(self.count):
            self.free[a] = ti.cast(self.clearance.distance(self.center(a)) > room, ti.i32)
            for k in range(8):
                b = self._neighbour(a, k)
                self.open[a, k] = 0
                if b >= 0:
                    self.open[a, k] = ti.cast(self._sees(self.center(a), self.center(b), room), ti.i32)

    @ti.kernel
    def _find(self, room: float):
        for a in range(self.count):
            for b in range(self.count):
                self.length[a, b], self.via[a, b] = FAR, ti.cast(-1, ti.i16)
                apart = self.center(b) - self.center(a)
                if self.free[a] == 1 and (a == b or self._sees(self.center(a), self.center(b), room)):
                    self.length[a, b], self.via[a, b] = apart.norm(), ti.cast(b, ti.i16)  # type: ignore
            shorter, sweeps = True, 0
            while shorter and sweeps < MOST_SWEEPS:
                shorter = False
                sweeps += 1
                for way in range(4):
                    for m in range(self.count):
                        x, y = m // self.shape[1], m % self.shape[1]
                        x = ti.select(way % 2 == 1, self.shape[0] - 1 - x, x)
                        y = ti.select(way >= 2, self.shape[1] - 1 - y, y)
                        if self._shorten(a, x * self.shape[1] + y):
                            shorter = True

    @ti.func
    def _shorten(self, a, b):
        """Shorten the path from cell a to b through a neighbour of b if possible; return whether it got shorter."""
        shorter = False
        if self.free[b] == 1 and self.via[a, b] != b:
            for k in range(8):
                c = self._neighbour(b, k)
                if c >= 0 and self.open[b, k] == 1 and self.length[a, c] < FAR:
                    j = k + ti.cast(k >= 4, ti.i32)
                    step = ti.select(j % 2 == 0, ROOT_OF_TWO, 1.0) * self.cell
                    if self.length[a, c] + step < self.length[a, b] - CLOSER:
                        self.length[a, b] = self.length[a, c] + step
                        self.via[a, b] = self.via[a, c]
                        shorter = True
        return shorter
