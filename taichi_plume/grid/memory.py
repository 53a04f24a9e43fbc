"""Fields as NumPy views of their memory, on the CPU: filling and reading them compiles and launches no kernel.

A kernel for a few numbers takes 0.1 s to compile, 0.01 to 0.05 s to trace and load from the cache, and up to 0.1 ms to
launch; writing to memory takes microseconds. Only kernels know the address of a field, and a kernel per tree of fields
(SNode tree) is enough, as the layout of a tree is known.
"""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang import impl

from taichi_plume.grid.kernels import Field, on_cpu

KINDS = {ti.f32: np.float32, ti.i32: np.int32, ti.u32: np.uint32, ti.f64: np.float64}
SNodeType = ti._lib.core.SNodeType
PAGE = 4096  # bytes; a tree begins on a page of its own
Two = ti.types.vector(2, ti.u64)


def view(field: Field) -> np.ndarray | None:
    """Return a NumPy view of a field's memory: shape of the field, and components. The field must stay alive.

    None on a GPU, or for a field of unknown layout; use kernels then.
    """
    runtime = impl.get_runtime()
    # Addresses of the trees. Taichi makes a new runtime at each start: addresses found before are not used again.
    roots = vars(runtime).setdefault("roots_in_place", {})
    known = vars(field).get("in_place")
    if known is None or known[0] is not roots:
        runtime.materialize()
        known = field.in_place = roots, _view(field, roots) if on_cpu() else None
    return known[1]


def views(fields: Sequence[Field]) -> list[np.ndarray] | None:
    """Return NumPy views of several fields' memory; None if a field has no view."""
    places = [view(field) for field in fields]
    return None if any(place is None for place in places) else places  # pyright: ignore


def _view(field: Field, roots: dict[int, int | None]) -> np.ndarray | None:
    vector = isinstance(field, ti.MatrixField)
    parts = [field.get_scalar_field(k) for k in range(field.n)] if vector else [field]
    if (vector and field.m != 1) or field.dtype not in KINDS:
        return None
    root = _root(parts[0], roots)
    places = [_layout(part) for part in parts]
    if root is None or None in places:
        return None
    offsets, strides = zip(*places, strict=True)
    step = offsets[1] - offsets[0] if len(parts) > 1 else np.dtype(KINDS[field.dtype]).itemsize
    regular = all(offset == offsets[0] + k * step for k, offset in enumerate(offsets))
    if not regular or len(set(strides)) > 1:
        return None
    shape, steps = (*field.shape, *[len(parts)] * vector), (*strides[0], *[step] * vector)
    length = sum((n - 1) * step for n, step in zip(shape, steps, strict=True)) + 8
    memory: Any = (ctypes.c_char * length).from_address(root + offsets[0])
    return np.ndarray(shape, KINDS[field.dtype], memory, strides=steps)


def _layout(field: Field) -> tuple[int, tuple[int, ...]] | None:
    """Return a scalar field's offset from the start of its SNode tree, and its stride along each axis, in bytes."""
    at = field.snode.ptr
    offset, strides = at.offset_bytes_in_parent_cell, dict.fromkeys(range(len(field.shape)), 0)
    while (at := at.parent).type == SNodeType.dense:
        step, above = at.cell_size_bytes, _extents(at.parent)
        for d, n in sorted(_extents(at).items(), reverse=True):  # the last axis of a level is contiguous
            if above.get(d, 1) != n:
                if strides[d] or n != field.shape[d]:
                    return None  # an axis that is cut into blocks
                strides[d], step = step, step * n
        offset += at.offset_bytes_in_parent_cell
    return (offset, tuple(strides.values())) if at.type == SNodeType.root else None


def _extents(node: ti._lib.core.SNode) -> dict[int, int]:
    """Return the number of entries along each axis that is divided at an SNode or above it."""
    axes = node.get_physical_index_position()[: node.num_active_indices()]
    return {d: node.get_shape_along_axis(i) for i, d in enumerate(axes)}


def _root(field: Field, roots: dict[int, int | None]) -> int | None:
    """Return the address of a scalar field's SNode tree, checked by its page and the field's last entry; else None."""
    tree = field.snode._snode_tree_id
    place = _layout(field)
    if tree not in roots and place is not None:
        first, last = [0] * len(field.shape), [n - 1 for n in field.shape]

        @ti.kernel
        def ends() -> Two:
            return Two(ti.get_addr(field, first), ti.get_addr(field, last))

        offset, strides = place
        begin, end = (int(address) for address in ends())
        span, root = sum(n * step for n, step in zip(last, strides, strict=True)), begin - offset
        roots[tree] = root if root % PAGE == 0 and end - begin == span else None
    return roots.get(tree)
