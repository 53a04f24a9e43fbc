"""Kernels at module level or in classes, compiled once for all parts that are alike."""

import gc
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np

from taichi_plume.engine import device_loops, process, replacements  # noqa: F401  change how Taichi builds kernels
from taichi_plume.engine.arguments import declare_array, setter_of
from taichi_plume.engine.conditions import name_in_source, same
from taichi_plume.engine.fields import KINDS, SLACK, on_cpu, settle
from taichi_plume.engine.library import (
    AutodiffMode,
    KernelSyntaxError,
    MatrixType,
    argument_index,
    begin_kernel,
    build_stmts,
    compile_kernel,
    cook_dtype,
    core,
    declared_matrix,
    declared_scalar,
    end_kernel,
    impl,
    kernel_arguments,
    kernel_context,
    kernel_impl,
    launch_context,
    ndarray_type,
    taichi,
)
from taichi_plume.engine.trace import Trace

DTYPES = {np.dtype(kind): dtype for dtype, kind in KINDS.items()}
SCALARS = {float: taichi.f32, int: taichi.i32, bool: taichi.i32}
Template = type(taichi.template())

compiled = 0
"""Number of kernels compiled, or loaded from the cache, in this process."""


_instances: dict[Any, list["Instance"]] = {}


class Instance:
    """Compiled kernel with the conditions under which it may be used."""

    def __init__(self, kernel: "Kernel", parts: Sequence[Any], arguments: Sequence[Any], name: str):
        global compiled
        compiled += 1
        self.name = f"{name}_{compiled}"
        self.program = impl.get_runtime().prog
        self.trace = Trace(parts)
        self.arrays = kernel.kinds_of(arguments)
        collects = gc.isenabled()
        gc.disable()  # a trace makes many objects, all of which stay until its end
        try:
            self.traced = self._traced(kernel, parts)
        finally:
            if collects:
                gc.enable()
        with kernel.compiling():
            self.compiled = compile_kernel(self.program, self.traced)
        self.steps = self.trace.steps
        self.extra = [(compute, setter) for _, compute, setter in self.trace.arguments.values()]
        del self.trace, Trace.current  # they hold the parts

    def _traced(self, kernel: "Kernel", parts: Sequence[Any]) -> Any:
        runtime = impl.get_runtime()
        runtime.materialize()
        function, shell, trace = kernel.function, kernel.shell, self.trace
        context, statements = kernel_context(function, shell)
        annotations = dict(zip(kernel.names, kernel.annotations, strict=True))

        def generate(target: Any) -> None:
            if runtime.inside_kernel:
                raise KernelSyntaxError("a kernel cannot call another kernel")
            begin_kernel(shell, context, target)
            arrays = iter(self.arrays)
            runtime.src_info_stack.append("")
            try:
                for kind in shell.return_type or ():
                    kernel_arguments.decl_ret(kind)
                target.finalize_rets()
                with context.variable_scope_guard():
                    of_function = trace.wrap(0, same, None, function)
                    context.global_vars = {**function.__globals__, **of_function.free()}
                    for n, name in enumerate(kernel.parts, 1):
                        context.create_variable(name, trace.wrap(n, same, None, parts[n]))
                    arguments: list[Any] = []
                    for name in kernel.scalars:
                        kind = annotations[name]
                        if isinstance(kind, ndarray_type.NdarrayType):
                            dtype, ndim = next(arrays)
                            value: Any = declare_array(dtype, 0, ndim, name)
                        elif isinstance(kind, MatrixType):
                            value = declared_matrix(kind, name)
                        else:
                            value = declared_scalar(SCALARS.get(kind, kind), name)
                        context.create_variable(name, value)
                        context.kernel_args.append(name)
                        arguments.append(value)
                    device_loops.begin(arguments)
                    build_stmts(context, statements)
                target.finalize_params()
            finally:
                runtime.src_info_stack.clear()
                end_kernel()

        return self.program.create_kernel(generate, self.name, AutodiffMode.NONE)

    def values(self, parts: Sequence[Any]) -> list[Any] | None:
        """Return the values that the kernel reads from parts; None if a condition does not hold."""
        values = list(parts)
        try:
            for parent, step, key, check in self.steps:
                value = step(values if parent < 0 else values[parent], key)
                if check is not None and not (
                    values[check.other] is value if hasattr(check, "other") else check(value)
                ):
                    return None
                values.append(value)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError):
            return None
        return values


class Bound:
    """Kernel with its parts: call it with the remaining arguments."""

    def __init__(self, kernel: "Kernel", instance: Instance, values: list[Any]):
        self.kernel, self.instance = kernel, instance
        self.program = instance.program
        self.extra = [(compute(values), setter) for compute, setter in instance.extra]
        self.setters = [
            (_argument_setter(kind, n), argument_index(n)) for n, kind in enumerate(kernel.scalar_annotations)
        ]
        self.returns = kernel.shell.return_type
        self.first = len(self.setters)
        self.fixed = tuple(self._fixed())
        self.reusable = on_cpu()  # elsewhere a launch spoils its context
        self.context = self._context() if self.reusable else None
        self.last: list[Any] = [None] * self.first  # arguments of the last launch, which the context has

    @property
    def usable(self) -> bool:
        """Whether Taichi has not been restarted, in a process that was not forked since."""
        return self.program is impl.get_runtime().prog and not process.forked

    def _fixed(self) -> Iterator[tuple[Any, ...]]:
        """Yield the functions that set the arguments that stay, each with its own arguments after the context."""
        kind = core.KernelLaunchContext
        for n, (value, setter) in enumerate(self.extra, self.first):
            if setter == "field" and value.flat is None:
                yield kind.set_arg_ndarray, argument_index(n), value.device.arr
            elif setter == "field":
                yield kind.set_struct_arg_int, (n, 0, 0), len(value.flat) + SLACK
                yield kind.set_struct_arg_uint, (n, 1), value.flat.ctypes.data
            elif setter.startswith("struct_"):
                put = getattr(kind, f"set_struct_arg_{setter.removeprefix('struct_')}")
                yield from ((put, (n, k), number) for k, number in enumerate(value))
            else:
                yield getattr(kind, f"set_arg_{setter}"), argument_index(n), value

    def _context(self) -> Any:
        context = launch_context(self.instance.traced)
        for put, index, value in self.fixed:
            put(context, index, value)
        return context

    def __call__(self, *arguments: Any) -> Any:
        context, last = self.context or self._context(), self.last
        if len(arguments) != len(last):
            raise TypeError(f"{self.kernel.__name__} takes {len(last)} arguments, got {len(arguments)}")
        for n, argument in enumerate(arguments):
            if argument is not last[n] or self.context is None:
                put, place = self.setters[n]
                put(context, place, argument)
                last[n] = argument if isinstance(argument, int | float) else None  # others may change inside
        self.program.launch_kernel(self.instance.compiled, context)
        if self.returns:
            if not self.reusable:
                taichi.sync()
            return self.kernel.shell.construct_kernel_ret(context, self.returns[0], (0,))
        return None


def _put_array(context: Any, index: Any, value: Any) -> None:
    """Set an argument that is a NumPy array or a tensor of torch."""
    is_array = isinstance(value, np.ndarray)
    if not (value.flags.c_contiguous if is_array else value.is_contiguous()):
        raise ValueError("an array argument of a kernel must be contiguous")
    pointer = value.ctypes.data if is_array else int(value.data_ptr())
    context.set_arg_external_array_with_shape(index, pointer, value.nbytes, tuple(value.shape), 0)


def _argument_setter(kind: Any, n: int) -> Callable[[Any, Any, Any], None]:
    if isinstance(kind, ndarray_type.NdarrayType):
        return _put_array
    if isinstance(kind, MatrixType):

        def put(context: Any, index: Any, value: Any) -> None:
            for k in range(kind.n):
                context.set_struct_arg_float((n, k), float(value[k]))

        return put
    return getattr(core.KernelLaunchContext, f"set_arg_{setter_of(cook_dtype(SCALARS.get(kind, kind)))}")


class Kernel:
    """Kernel: a function of parts (self, and arguments annotated as Template), numbers and arrays."""

    def __init__(self, function: Callable, compiling: Callable = nullcontext):
        self.function, self.compiling = function, compiling
        parameters = list(inspect.signature(function).parameters.values())
        self.names = [p.name for p in parameters]
        self.annotations = [p.annotation for p in parameters]
        is_part = [isinstance(a, Template) or a is inspect.Parameter.empty for a in self.annotations]
        self.places = [n for n, part in enumerate(is_part) if part]
        self.parts = [p.name for p, part in zip(parameters, is_part, strict=True) if part]
        self.scalars = [p.name for p, part in zip(parameters, is_part, strict=True) if not part]
        self.scalar_annotations = [a for a, part in zip(self.annotations, is_part, strict=True) if not part]
        self.shell: Any = kernel_impl.Kernel(function, AutodiffMode.NONE, "self" in self.names)
        self.__name__ = function.__name__
        self.__doc__ = function.__doc__

    def kinds_of(self, arguments: Sequence[Any]) -> tuple:
        """Return dtype and number of axes of each array argument."""
        return tuple(
            (DTYPES[value.dtype], value.ndim)
            for value, kind in zip(arguments, self.scalar_annotations, strict=True)
            if isinstance(kind, ndarray_type.NdarrayType)
        )

    def bind(self, *parts: Any, arguments: Sequence[Any] = (), key: Any = None, name: str = "") -> Bound:
        """Return the kernel with its parts, compiled if no instance fits.

        name: of the kernel in profiles, by default that of its function and file.
        """
        process.require_no_fork()
        settle()
        if impl.get_runtime().prog is None:
            from taichi_plume.engine.program import start  # which imports this module

            start()
        kinds = self.kinds_of(arguments) if arguments else ()
        parts = (self.function, *parts)
        known = _instances.setdefault((impl.get_runtime().prog, self.function.__code__, key, kinds), [])
        for instance in known:
            values = instance.values(parts)
            if values is not None:
                return Bound(self, instance, values)
        if not arguments:
            arguments = [None] * len(self.scalars)
        instance = Instance(self, parts, arguments, name or name_in_source([self.function]))
        values = instance.values(parts)
        if values is None:
            raise AssertionError(f"conditions of {self.__name__} do not hold for its own parts")
        known.append(instance)
        return Bound(self, instance, values)

    def __get__(self, owner: Any, kind: Any = None) -> Any:
        return self if owner is None else Method(self, owner)

    def __call__(self, *arguments: Any) -> Any:
        parts = [arguments[n] for n in self.places]
        rest = [a for n, a in enumerate(arguments) if n not in self.places]
        home = next((vars(part) for part in parts if hasattr(part, "__dict__")), None)
        known = {} if home is None else home.setdefault("_bound", {})
        key = (id(self), *(part if isinstance(part, _CONSTANTS) else id(part) for part in parts))
        bound = known.get(key)
        if bound is None or not bound.usable:
            bound = known[key] = self.bind(*parts, arguments=rest, key=type(parts[0]) if parts else None)
        return bound(*rest)


_CONSTANTS = (int, float, str, bool, type(None))


class Method:
    """Kernel of a class, with its object."""

    def __init__(self, kernel: Kernel, owner: Any):
        self.kernel, self.owner = kernel, owner

    def __call__(self, *arguments: Any) -> Any:
        return self.kernel(self.owner, *arguments)


@contextmanager
def data_flow_by_llvm() -> Iterator[None]:
    """Context in which kernels compile without Taichi's store-to-load analysis, which LLVM then does.

    The analysis takes up to half of the compile time, as it grows with the square of a kernel's length. The V-cycle
    needs it: without it Taichi 1.7 gives LLVM faulty code for those kernels, and aborts. Taichi's other simplifications
    (`advanced_optimization`) are needed too: without them the flow of the helium box is wrong by a factor of two.
    """
    before, taichi.cfg.cfg_optimization = taichi.cfg.cfg_optimization, not on_cpu()
    try:
        yield
    finally:
        taichi.cfg.cfg_optimization = before


def kernel(function: Callable) -> Kernel:
    """Decorator of kernels."""
    return Kernel(function)
