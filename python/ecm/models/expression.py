"""Models that a user writes: equations, or a Python function, with parameters to fit.

An equation is read as a tree of sums, products, powers and a few functions, never run as code, so
that it may stand in a model file. Slopes to pose and parameters are exact: each node carries its
derivatives along.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np

from ecm.errors import EcmError, InputError, shown
from ecm.io.arrays import LARGEST, F, central_differences
from ecm.io.columns import POSE, WRENCH, is_standard
from ecm.io.events import Progress
from ecm.io.settings import check_keys, did_you_mean, read_toml
from ecm.io.table import Table
from ecm.models.maps import (
    FittedMap,
    ModelSpecification,
    Weights,
    partial_to,
    pose_and_wrench_columns,
)
from ecm.models.parameters import (
    Parameter,
    ParametrisedMap,
    fit_parameters,
    parameters_of,
    starts_of,
)

_STEP = 1e-5
"""Step of central differences, m or rad."""


@dataclass(frozen=True, eq=False)
class FunctionMap(ParametrisedMap):
    """A Python function of poses (N, n), and of parameters by name, that gives wrenches (N, m)."""

    function: Callable[..., Any]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    kind = "function"

    @property
    def name(self) -> str:
        """The function's own name."""
        name = str(getattr(self.function, "__name__", ""))
        return name if name.isidentifier() else "lambda" if name == "<lambda>" else "own"

    @property
    def gives(self) -> str:
        """`the function NAME gives`."""
        return f"the function {self.name} gives"

    def raw(self, poses: F) -> F:
        """(N, m) what the function gives, also where it is no number."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        try:
            wrench = np.asarray(self.function(poses.copy(), **self.values), dtype=np.float64)
        except EcmError:
            raise
        except Exception as error:
            raise InputError(
                f"the function {self.name} failed at poses of shape {poses.shape} "
                f"({', '.join(self.inputs)}): {type(error).__name__}: {error}"
            ) from error
        m = len(self.outputs)
        if m == 1 and wrench.shape == (len(poses),):
            wrench = wrench[:, None]
        if wrench.shape != (len(poses), m):
            raise InputError(
                f"{self.gives} shape {wrench.shape} at poses of shape "
                f"{poses.shape}, expected {(len(poses), m)}: a row a pose, a column each of "
                f"{', '.join(self.outputs)}"
            )
        return wrench

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) by central differences."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        slope = np.stack(central_differences(self.predict, poses, _STEP), axis=2)
        return partial_to(kind, slope, poses, self)

    def columns(self, poses: F) -> F:
        """(N, m, k) derivative to the parameters that vary, by central differences."""
        slopes = np.zeros((len(poses), len(self.outputs), len(self.parameter_names)))
        for j, name in enumerate(self.parameter_names):
            value, own = self.values[name], self.parameters[name]
            step = 1e-6 * max(abs(value), 1e-3 * min(own.max - own.min, 1.0))
            ends = min(value + step, own.max), max(value - step, own.min)
            above, below = (replace(self, values={**self.values, name: x}).raw(poses) for x in ends)
            slopes[:, :, j] = (above - below) / (ends[0] - ends[1])
        return slopes

    def document(self) -> dict[str, Any]:
        """Raise InputError: a model file holds numbers and equations, no code."""
        raise InputError(
            f"the function {self.name} cannot be stored in a model file, which holds no code: keep "
            'it in your program, or write it as equations, ecm.Expression("fx_N = k * x_m", k=1e3)'
        )


@dataclass(frozen=True)
class FunctionModel(ModelSpecification):
    """A function with parameters to fit: f(poses (N, n), **parameters) -> wrenches (N, m)."""

    function: Callable[..., Any]
    parameters: dict[str, Parameter] = field(default_factory=dict)

    any_columns = True
    kind = "function"

    @property
    def name(self) -> str:
        """The function's own name."""
        return FunctionMap({}, {}, self.function, (), ()).name

    def map(self, table: Table) -> FunctionMap:
        """The map at the start of the parameters, of the table's columns."""
        inputs, outputs = pose_and_wrench_columns(table)
        values = starts_of(self.parameters)
        return FunctionMap(self.parameters, values, self.function, inputs, outputs)

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares within bounds, priors counted as readings."""
        return fit_parameters(self.map(table), table, progress)


_MOST_SIGNS, _MOST_DEPTH = 20_000, 60
_CONSTANTS = {"pi": math.pi}
_Function = tuple[Callable[[F], F], Callable[[F], F]]
FUNCTIONS: dict[str, _Function] = {
    "sin": (np.sin, np.cos),
    "cos": (np.cos, lambda x: -np.sin(x)),
    "tan": (np.tan, lambda x: 1.0 / np.cos(x) ** 2),
    "atan": (np.arctan, lambda x: 1.0 / (1.0 + x**2)),
    "exp": (np.exp, np.exp),
    "log": (np.log, lambda x: 1.0 / x),
    "sqrt": (np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "sinh": (np.sinh, np.cosh),
    "cosh": (np.cosh, np.sinh),
    "tanh": (np.tanh, lambda x: 1.0 / np.cosh(x) ** 2),
    "abs": (np.abs, np.sign),
}
"""Functions of one argument, with their slopes."""
_PAIRS = {"min": (np.minimum, np.less), "max": (np.maximum, np.greater)}
"""Functions of two arguments, and when the first is taken; no number stays no number."""
_WORDS = f"+ - * / **, numbers, {', '.join((*FUNCTIONS, *_PAIRS, *_CONSTANTS))}"


class _Dual:
    """Values (N,) with slopes (N, d) to the d inputs; slopes None where they are zero."""

    def __init__(self, value: Any, slope: F | None = None) -> None:
        self.value, self.slope = np.asarray(value, dtype=np.float64), slope

    def where(self, taken: Any) -> F | None:
        """The slope at the rows (N,) that are taken; elsewhere it may be no number."""
        return None if self.slope is None else np.where(taken[..., None], self.slope, 0.0)

    def times(self, factor: Any) -> F | None:
        """The slope times a factor (N,).

        What does not change at all changes nothing, also where the factor is no number: 0.7 t**-0.3
        at t = x - x.
        """
        if self.slope is None:
            return None
        return np.where(self.slope == 0.0, 0.0, np.asarray(factor)[..., None] * self.slope)


def _sum(*slopes: F | None) -> F | None:
    there = [slope for slope in slopes if slope is not None]
    return None if not there else np.asarray(sum(there[1:], there[0]))


def _power(a: _Dual, b: _Dual) -> _Dual:
    value = a.value**b.value
    if b.slope is None and not np.any(b.value):
        return _Dual(value)
    base = a.times(b.value * a.value ** (b.value - 1.0))
    if b.slope is None:
        return _Dual(value, base)
    # 0**b stays 0 as b > 0 changes.
    log = np.where(value == 0.0, 0.0, np.log(np.where(a.value == 0.0, 1.0, a.value)))
    return _Dual(value, _sum(base, b.times(value * log)))


_BINARY: dict[type[ast.operator], Callable[[_Dual, _Dual], _Dual]] = {
    ast.Add: lambda a, b: _Dual(a.value + b.value, _sum(a.slope, b.slope)),
    ast.Sub: lambda a, b: _Dual(a.value - b.value, _sum(a.slope, b.times(-1.0))),
    ast.Mult: lambda a, b: _Dual(a.value * b.value, _sum(a.times(b.value), b.times(a.value))),
    ast.Div: lambda a, b: _Dual(
        a.value / b.value, _sum(a.times(1.0 / b.value), b.times(-a.value / b.value**2))
    ),
    ast.Pow: _power,
}


def _value(node: ast.expr, known: Mapping[str, _Dual]) -> _Dual:
    """A checked node with its slopes."""
    if isinstance(node, ast.Constant):
        return _Dual(cast("float", node.value))
    if isinstance(node, ast.Name):
        return known[node.id]
    if isinstance(node, ast.UnaryOp):
        own = _value(node.operand, known)
        return own if isinstance(node.op, ast.UAdd) else _Dual(-own.value, own.times(-1.0))
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](_value(node.left, known), _value(node.right, known))
    call = cast("ast.Call", node)
    name = cast("ast.Name", call.func).id
    first, *others = (_value(argument, known) for argument in call.args)
    if name in FUNCTIONS:
        function, slope = FUNCTIONS[name]
        return _Dual(function(first.value), first.times(slope(first.value)))
    other = others[0]
    function_of_two, takes_first = _PAIRS[name]
    taken = takes_first(first.value, other.value)
    value = function_of_two(first.value, other.value)
    return _Dual(value, _sum(first.where(taken), other.where(~taken)))


@dataclass(frozen=True)
class Equations:
    """Checked equations `NAME = EXPRESSION`, one a line; of wrench columns, or steps to them."""

    text: str

    @cached_property
    def statements(self) -> tuple[tuple[str, ast.expr], ...]:
        """Name and tree of each equation.

        Raises
        ------
        InputError
            Where a line is no equation, or holds what is not allowed.
        """
        if not isinstance(self.text, str):
            raise InputError(f'equations: found {self.text!r}, expected text: "fx_N = k * x_m"')
        if len(self.text) > _MOST_SIGNS:
            raise InputError(f"equations: more than {_MOST_SIGNS} signs; write shorter ones")
        made: list[tuple[str, ast.expr]] = []
        lines = [line.strip() for line in self.text.replace(";", "\n").splitlines()]
        for line in filter(None, lines):
            try:
                (statement,) = ast.parse(line).body
            except (SyntaxError, ValueError, RecursionError, MemoryError):
                statement = None
            match statement:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    _check(value, line)
                    made.append((name, value))
                case _:
                    raise InputError(
                        f"equation {shown(line)}: expected WRENCH_COLUMN = EXPRESSION, as in "
                        "fx_N = k * x_m + c * x_m**3"
                    )
        names = [name for name, _ in made]
        wrong = [name for name in names if names.count(name) > 1]
        wrong += [name for name in names if name in POSE or name in _RESERVED]
        if wrong:
            raise InputError(f"equations: {wrong[0]} cannot be set, or is set twice")
        if not set(names) & {*WRENCH}:
            raise InputError(
                f"equations: none sets a wrench column; expected at least one of "
                f"{', '.join(WRENCH)}, as in fx_N = k * x_m"
            )
        return tuple(made)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names that the equations use and do not set, in their order."""
        known, used = {*_CONSTANTS}, dict[str, None]()
        for target, tree in self.statements:
            own = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
            used |= dict.fromkeys(n.id for n in own if n.id not in known | {*_RESERVED})
            known.add(target)
        return tuple(used)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Pose columns."""
        return tuple(name for name in POSE if name in self.names)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Wrench columns."""
        set_ = {name for name, _ in self.statements}
        return tuple(name for name in WRENCH if name in set_)

    def wrench(self, poses: F, values: Mapping[str, float], free: tuple[str, ...]) -> tuple[F, F]:
        """(N, m) wrench and (N, m, n + k) slopes to the n inputs and the k free values."""
        names = (*self.inputs, *free)
        known = {name: _Dual(value) for name, value in {**_CONSTANTS, **values}.items()}
        for j, name in enumerate(names):
            unit = np.zeros((len(poses), len(names)))
            unit[:, j] = 1.0
            at = poses[:, j] if j < len(self.inputs) else np.full(len(poses), values[name])
            known[name] = _Dual(at, unit)
        with np.errstate(all="ignore"):
            for target, tree in self.statements:
                known[target] = _value(tree, known)
        shape = (len(poses), len(self.outputs))
        wrench, slopes = np.zeros(shape), np.zeros((*shape, len(names)))
        for i, name in enumerate(self.outputs):
            wrench[:, i] = known[name].value
            slopes[:, i] = 0.0 if known[name].slope is None else known[name].slope
        return wrench, slopes


_RESERVED = (*FUNCTIONS, *_PAIRS, *_CONSTANTS)


def _check(node: ast.expr, line: str, depth: int = 0) -> None:
    """Raise InputError for what is not allowed in an equation."""
    if depth > _MOST_DEPTH:
        raise InputError(f"equation {shown(line)}: nested too deep; write it in several lines")
    parts: list[ast.expr] = []
    allowed = False
    if isinstance(node, ast.Constant):
        number = node.value
        known = isinstance(number, int | float) and not isinstance(number, bool)
        allowed = known and abs(cast("float", number)) <= LARGEST
    elif isinstance(node, ast.Name):
        allowed = True
    elif isinstance(node, ast.UnaryOp):
        allowed, parts = isinstance(node.op, ast.UAdd | ast.USub), [node.operand]
    elif isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.BitXor):
            raise InputError(f"equation {shown(line)}: ^ is no power; write **")
        allowed, parts = type(node.op) in _BINARY, [node.left, node.right]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        count = 1 if node.func.id in FUNCTIONS else 2 if node.func.id in _PAIRS else -1
        allowed, parts = len(node.args) == count and not node.keywords, node.args
    if not allowed:
        found = shown(ast.unparse(node)) if depth < _MOST_DEPTH else "it"
        raise InputError(f"equation {shown(line)}: {found} is not known here; use {_WORDS}")
    for part in parts:
        _check(part, line, depth + 1)


@dataclass(frozen=True, eq=False)
class ExpressionMap(ParametrisedMap):
    """The wrench that equations give for a pose and their parameters.

    Examples
    --------
    >>> base = Expression("fx_N = k * x_m**3", k=2.0).map()
    >>> base.predict(np.array([[3.0]])), base.stiffness(np.array([[3.0]]))
    (array([[54.]]), array([[[54.]]]))
    """

    equations: Equations

    name = kind = "expression"
    gives = "the equations give"

    @property
    def inputs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Pose columns that the equations use."""
        return self.equations.inputs

    @property
    def outputs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Wrench columns that they set."""
        return self.equations.outputs

    def raw(self, poses: F) -> F:
        """(N, m) wrench, also where it is no number."""
        return self._evaluated(poses)[0]

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n), exact; kinds other than `partial` need all six columns on both sides."""
        partial = self._evaluated(poses)[1][:, :, : len(self.inputs)]
        self.refuse_unreal(partial, poses, "the slope of the equations to the pose is no number")
        return partial_to(kind, np.ascontiguousarray(partial), poses, self)

    def columns(self, poses: F) -> F:
        """(N, m, k) derivative to the parameters that vary."""
        slopes = self._evaluated(poses)[1][:, :, len(self.inputs) :]
        self.refuse_unreal(slopes, poses, "the slope of the equations to a parameter is no number")
        return slopes

    def _evaluated(self, poses: F) -> tuple[F, F]:
        poses = np.asarray(poses, dtype=np.float64)
        return self.equations.wrench(poses, self.values, self.parameter_names)

    def document(self) -> dict[str, Any]:
        """Equations and parameters for a model file."""
        parameters = {
            name: {
                "value": self.values[name],
                "start": own.value,
                "min": own.min if math.isfinite(own.min) else None,
                "max": own.max if math.isfinite(own.max) else None,
                "sd": own.sd,
                "vary": own.vary,
            }
            for name, own in self.parameters.items()
        }
        return self.head(equations=self.equations.text, parameters=parameters)


@dataclass(frozen=True, init=False)
class Expression(ModelSpecification):
    """A model of one's own: equations of wrench columns with named parameters.

    Parameters
    ----------
    equations
        `fx_N = k * x_m + c * x_m**3`; several by line or by `;`. Names are pose columns (m, rad),
        parameters, and what an earlier line sets. There are + - * / **, sin, cos, tan, atan, exp,
        log, sqrt, sinh, cosh, tanh, abs, min, max and pi.
    parameters
        Start of each parameter by name: a number, (value, min, max), or a dict or `Parameter` of
        value, min, max, sd (a prior) and vary.
    **named
        The same as keywords.

    Raises
    ------
    InputError
        For what is no equation, or a parameter without a value.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-0.01, 0.01, 21)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 2000.0 * x + 4e6 * x**3})
    >>> spring = Expression("fx_N = k * x_m + c * x_m**3", k=(1e3, 0, 1e6), c=0.0)
    >>> ecm.fit(table, spring).base.coefficients.round(1).tolist()
    [2000.0, 4000000.0]
    """

    equations: Equations
    parameters: Mapping[str, Parameter]

    any_columns = True
    kind = "expression"
    usage = "a TOML with [expression] (docs/models.md)"

    def __init__(self, equations: str, parameters: Any = None, **named: Any) -> None:
        made = Equations(equations)
        given = parameters_of({} if parameters is None else parameters) | parameters_of(named)
        for name in given:
            if not name.isidentifier() or is_standard(name) or name in _RESERVED:
                raise InputError(f"parameter {name}: the name means something else; take another")
        unused = [name for name in given if name not in made.names]
        if unused:
            raise InputError(f"parameter {unused[0]} is in no equation; leave it out")
        for name in made.names:
            if name not in given and name not in POSE:
                listed = (*POSE, *given)
                raise InputError(
                    f"'{name}' in the equations is no pose column and has no value: "
                    f"{did_you_mean(name, listed)} For a parameter give its start, {name} = 1.0"
                )
        if not made.inputs:
            raise InputError(f"the equations use no pose column; expected one of {', '.join(POSE)}")
        object.__setattr__(self, "equations", made)
        object.__setattr__(self, "parameters", given)

    @classmethod
    def from_name(cls, name: str) -> Expression | None:
        """Those of a TOML by its path; equations have no short name."""
        if not name.lower().endswith(".toml"):
            return None
        document = read_toml(Path(name), "description of a model")
        return cls.from_dict(document.get("expression"), "[expression]")  # the caller says the file

    @staticmethod
    def from_dict(table: Any, where: str) -> Expression:
        """The expression of the table [expression] of a TOML: `equations` and `parameters`."""
        if not isinstance(table, Mapping) or "equations" not in table:
            raise InputError(f'{where}: expected equations = "fx_N = k * x_m" and parameters')
        check_keys(table, ("equations", "parameters"), where)
        text = table["equations"]
        if isinstance(text, list) and all(isinstance(line, str) for line in text):
            text = "\n".join(text)
        try:
            return Expression(text, table.get("parameters", {}))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    def map(self) -> ExpressionMap:
        """The map at the start of the parameters."""
        return ExpressionMap(self.parameters, starts_of(self.parameters), self.equations)

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares within bounds, priors counted as readings."""
        return fit_parameters(self.map(), table, progress)

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> ExpressionMap:
        """Return the map of an opened model file; an error where it is wrong."""
        stored = dict(document["parameters"])
        limits = {"min": -math.inf, "max": math.inf}
        given = {
            name: {"value": own["start"], "sd": own["sd"], "vary": own["vary"]}
            | {key: none if own[key] is None else own[key] for key, none in limits.items()}
            for name, own in stored.items()
        }
        made = Expression(document["equations"], given).map()
        listed = (tuple(document["inputs"]), tuple(document["outputs"]))
        values = {name: float(stored[name]["value"]) for name in made.values}
        if listed != (made.inputs, made.outputs) or not np.isfinite([*values.values()]).all():
            raise ValueError("columns or values that are not those of the equations")
        return ExpressionMap(made.parameters, values, made.equations)
