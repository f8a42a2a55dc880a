"""The pose of the tip as formulas: SymPy expressions of the joint values, as YAML, LaTeX, C and Python.

The matrix is the product of the rows of a Hayati table (see `pieper.model.dh`), which stays accurate for every arm; turns
about parallel axes are added up, so that ``cos(q2 + q3)`` stays one cosine. Numbers that are exact in the arm stay exact:
quarter turns and other multiples of pi/12 give integers and square roots, short decimals become fractions. A number that
is only close to such a value, for example the 1.5708 of some descriptions, stays the decimal number that it is.

SymPy and PyYAML come with the extra ``pieper[symbolic]`` and are imported inside the functions. Formulas are read back by a
small parser that knows numbers, ``+ - * / **``, ``sin``, ``cos``, ``sqrt``, ``pi`` and the joints; nothing is evaluated as code.
"""

from __future__ import annotations

import keyword
import re
import reprlib
from dataclasses import dataclass
from functools import cached_property
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import write_text
from pieper.errors import ArrayError, DescriptionError, MissingExtraError
from pieper.model._chain_check import check_chain
from pieper.model._exact_pose import Product, exact_angle, exact_length
from pieper.model._formula_parser import RESERVED, FormulaParser
from pieper.model.dh import as_dh

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from pieper.model._arrays import FloatArray
    from pieper.model.chain import Chain


_MAX_BYTES = 4 << 20  # of a file: the seven joints of a Panda with offsets need 30 kB
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, eq=False)
class SymbolicPose:
    """A pose as formulas.

    Attributes
    ----------
    matrix : sympy.ImmutableMatrix
        (4, 4), tip in the base frame [m, -]; its free symbols are among ``symbols``.
    joint_names : tuple of n str
        In the order of ``q``.
    symbols : tuple of n str
        Name of the symbol of each joint [rad or m]: the joint name where that is an identifier, else ``q1``, ``q2``, ...
    """

    matrix: Any
    joint_names: tuple[str, ...]
    symbols: tuple[str, ...]

    def __call__(self, q: ArrayLike) -> FloatArray:
        """Numbers for the joints: (..., n) -> (..., 4, 4). For speed take `pieper.kinematics.fk`.

        >>> from pieper.model.catalog import describe
        >>> T = end_effector(describe("ur5e", nominal=True).chain())
        >>> T([-1.28, 4.41, 1.54, -1.16, -1.56, 0.0])[:3, 3].round(6).tolist()
        [0.224996, -0.28312, 0.589463]
        """
        try:
            values = np.asarray(q, dtype=np.float64)
        except (TypeError, ValueError) as cause:
            raise ArrayError(f"q must be numbers of shape (..., {len(self.symbols)}), got {q!r}") from cause
        if values.ndim == 0 or values.shape[-1] != len(self.symbols):
            raise ArrayError(f"q must have shape (..., {len(self.symbols)}), got {values.shape}")
        if not np.isfinite(values).all():
            raise ArrayError(f"q must be finite, got {values[~np.isfinite(values)][0]}")
        shape = values.shape[:-1]
        T = np.empty((*shape, 4, 4))
        for k, element in enumerate(self._compiled(*np.moveaxis(values, -1, 0))):
            T[..., k // 4, k % 4] = element
        return T

    @cached_property
    def _compiled(self) -> Callable[..., list[Any]]:
        """The sixteen elements as NumPy functions of the joints."""
        sympy = _sympy("evaluating formulas")
        arguments = [sympy.Symbol(name) for name in self.symbols]
        compiled: Callable[..., list[Any]] = sympy.lambdify(arguments, list(self.matrix), modules="numpy", cse=True)
        return compiled

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_compiled"}

    def __repr__(self) -> str:
        return f"SymbolicPose({', '.join(self.symbols)})"


def end_effector(chain: Chain) -> SymbolicPose:
    """The pose of the tip as formulas of the joint values.

    Parameters
    ----------
    chain : Chain
        With nominal angles, ``describe(name, nominal=True).chain()``, the formulas are short and exact.

    Returns
    -------
    SymbolicPose
        Evaluated, it equals the numeric forward kinematics to 1e-12 [m, -].

    Raises
    ------
    ArrayError
        What is given is no chain.
    MissingExtraError
        SymPy is not installed.

    Examples
    --------
    >>> from pieper.model.dh import from_dh
    >>> planar = from_dh([(0.3, 0.0, 0.0, 0.0), (0.25, 0.0, 0.0, 0.0)], joint_names=["a", "b"])
    >>> end_effector(planar).matrix[0, 3]
    3*cos(a)/10 + cos(a + b)/4
    """
    check_chain(chain)
    sympy = _sympy("formulas of the forward kinematics")
    symbols = _symbol_names(chain.joint_names)
    q = [sympy.Symbol(name) for name in symbols]
    table = as_dh(chain, convention="hayati")
    product = Product(sympy, table.T_base)
    axis = 0
    for row in table.rows:
        theta, d = exact_angle(sympy, row.theta), exact_length(sympy, row.d)
        if row.type != "fixed":
            value = sum(
                (exact_length(sympy, factor) * q[j] for j, factor in enumerate(chain.coupling[axis]) if factor),
                sympy.S.Zero,
            )
            axis += 1
            if row.type == "revolute":
                theta += row.sign * value
            else:
                d += row.sign * value
        product.turn_z(theta)
        product.move(0, 0, d)
        product.move(exact_length(sympy, row.a), 0, 0)
        product.tilt(row.alpha, row.beta)
    product.then(table.T_tool)
    return SymbolicPose(sympy.ImmutableMatrix(product.matrix()), chain.joint_names, symbols)


def _symbol_names(joint_names: Sequence[str]) -> tuple[str, ...]:
    def usable(name: str) -> bool:
        return bool(_IDENTIFIER.fullmatch(name)) and name not in RESERVED and not keyword.iskeyword(name)

    if all(usable(name) for name in joint_names):
        return tuple(joint_names)
    return tuple(f"q{i + 1}" for i in range(len(joint_names)))


# --------------------------------------------------------------------------------------------------------------------
# YAML


def as_yaml(pose: SymbolicPose) -> str:
    """The formulas as YAML with the keys ``shape`` ([4, 4]), ``elements`` (16 strings, row by row) and ``joints``.

    Raises
    ------
    MissingExtraError
        PyYAML is not installed.

    Examples
    --------
    >>> from pieper.model.dh import from_dh
    >>> text = as_yaml(end_effector(from_dh([(0.3, 0.0, 0.0, 0.0)], joint_names=["a"])))
    >>> print(text.splitlines()[0])
    shape: [4, 4]
    """
    yaml = _yaml("writing formulas as YAML")
    sympy = _sympy("writing formulas as YAML")
    elements = [sympy.sstr(element, full_prec=True) for element in pose.matrix]
    data: dict[str, Any] = {"elements": elements, "joints": list(pose.joint_names)}
    if pose.symbols != pose.joint_names:
        data["symbols"] = list(pose.symbols)
    text: str = yaml.safe_dump(data, sort_keys=False, width=1_000_000, allow_unicode=True)
    return "shape: [4, 4]\n" + text


def from_yaml(text: str, *, joint_names: Sequence[str] | None = None, source: str = "<string>") -> SymbolicPose:
    r"""Formulas from YAML, read without evaluating anything as code.

    Parameters
    ----------
    text : str
        With the keys ``shape`` and ``elements``, and ``joints`` unless `joint_names` is given.
    joint_names : sequence of n str, optional
        The joints in the order of ``q``; needed for files that do not list them. Names that occur in no element are fine.
    source : str
        Named in error messages.

    Returns
    -------
    SymbolicPose

    Raises
    ------
    DescriptionError
        Not YAML of that form, or an element is not a formula; the message names the element and the place in it.
    MissingExtraError
        SymPy or PyYAML is not installed.

    Examples
    --------
    >>> rows = "['cos(a)', '-sin(a)', '0', '1/2', 'sin(a)', 'cos(a)', '0', '0', '0', '0', '1', '0', '0', '0', '0', '1']"
    >>> from_yaml(f"shape: [4, 4]\nelements: {rows}", joint_names=["a"])([0.0])[:3, 3].tolist()
    [0.5, 0.0, 0.0]
    """
    yaml = _yaml("reading formulas")
    sympy = _sympy("reading formulas")
    if len(text) > _MAX_BYTES:
        raise DescriptionError(source, "file", f"has {len(text)} characters; at most {_MAX_BYTES} are read")
    try:
        data = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as cause:
        raise DescriptionError(source, "file", f"is not YAML: {' '.join(str(cause).split())}") from cause
    if not isinstance(data, dict):
        raise DescriptionError(source, "file", f"needs the keys shape and elements, got {type(data).__name__}")
    for key in ("shape", "elements"):
        if key not in data:
            raise DescriptionError(source, key, "is missing; the keys shape and elements are needed")
    if data["shape"] != [4, 4]:
        raise DescriptionError(source, "shape", f"must be [4, 4], got {reprlib.repr(data['shape'])}")
    elements = data["elements"]
    if not isinstance(elements, list) or len(elements) != 16 or not all(isinstance(e, str) for e in elements):
        raise DescriptionError(source, "elements", "must be a list of 16 strings, row by row")
    names, symbols = _listed_joints(data, joint_names, source)
    matrix = [
        FormulaParser(sympy, element, symbols, source, f"elements[{k}]").parse() for k, element in enumerate(elements)
    ]
    return SymbolicPose(sympy.ImmutableMatrix(4, 4, matrix), names, symbols)


def _listed_joints(
    data: dict[str, Any], joint_names: Sequence[str] | None, source: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    listed = data.get("joints") if joint_names is None else list(joint_names)
    if listed is None:
        raise DescriptionError(source, "joints", "is missing; list the joints there, or pass joint_names")
    symbols = listed if joint_names is not None else data.get("symbols", listed)
    for key, value in (("joints", listed), ("symbols", symbols)):
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value) or len(set(value)) != len(value):
            raise DescriptionError(source, key, f"must be a list of different names, got {reprlib.repr(value)}")
    if len(symbols) != len(listed):
        raise DescriptionError(source, "symbols", f"must name {len(listed)} joints, got {len(symbols)}")
    for name in symbols:
        if not _IDENTIFIER.fullmatch(name) or name in RESERVED:
            raise DescriptionError(source, "joints", f"{name!r} cannot name a symbol: letters, digits and _ are needed")
    return tuple(listed), tuple(symbols)


def save(pose: SymbolicPose, path: str | Path) -> None:
    """Write the formulas to a YAML file, see `as_yaml`."""
    write_text(path, as_yaml(pose))


def load(path: str | Path, *, joint_names: Sequence[str] | None = None) -> SymbolicPose:
    """Read formulas from a YAML file, see `from_yaml`.

    Raises
    ------
    DescriptionError
        The file is missing, too large, not YAML of that form, or an element is not a formula.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        text = content.decode("utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        raise DescriptionError(str(path), "file", f"cannot be read: {cause}") from cause
    return from_yaml(text, joint_names=joint_names, source=str(path))


# --------------------------------------------------------------------------------------------------------------------
# LaTeX and code


def as_latex(pose: SymbolicPose, *, symbols: Sequence[str] | None = None) -> str:
    r"""The matrix in LaTeX.

    Parameters
    ----------
    pose : SymbolicPose
    symbols : sequence of n str, optional
        LaTeX of each joint value; ``q_{1}``, ``q_{2}``, ... unless given.

    Returns
    -------
    str
        A ``bmatrix``, without dollar signs.

    Raises
    ------
    ArrayError
        ``symbols`` has another length.
    MissingExtraError
        SymPy is not installed.

    Examples
    --------
    >>> from pieper.model.dh import from_dh
    >>> pose = end_effector(from_dh([(0.5, 0.0, 0.0, 0.0)]))
    >>> as_latex(pose, symbols=[r"\theta"]).splitlines()[1]
    '\\cos{\\left(\\theta \\right)} & - \\sin{\\left(\\theta \\right)} & 0 & \\frac{\\cos{\\left(\\theta \\right)}}{2} \\\\'
    """
    sympy = _sympy("formulas in LaTeX")
    shown = [f"q_{{{i + 1}}}" for i in range(len(pose.symbols))] if symbols is None else list(symbols)
    if len(shown) != len(pose.symbols):
        raise ArrayError(f"symbols must name {len(pose.symbols)} joints, got {len(shown)}")
    names = {sympy.Symbol(name): text for name, text in zip(pose.symbols, shown, strict=True)}
    rows = [" & ".join(sympy.latex(pose.matrix[i, j], symbol_names=names) for j in range(4)) + r" \\" for i in range(4)]
    return "\n".join([r"\begin{bmatrix}", *rows, r"\end{bmatrix}"])


def as_c(pose: SymbolicPose, *, name: str = "forward_kinematics") -> str:
    """A C99 function ``void name(const double q[n], double T[16])``; T is row by row.

    Parameters
    ----------
    pose : SymbolicPose
    name : str
        Name of the function.

    Returns
    -------
    str
        With common sub-expressions taken out; needs ``math.h`` alone.

    Raises
    ------
    ArrayError
        ``name`` is no identifier.
    MissingExtraError
        SymPy is not installed.

    Examples
    --------
    >>> from pieper.model.dh import from_dh
    >>> print(as_c(end_effector(from_dh([(0.5, 0.0, 0.0, 0.0)])), name="fk").splitlines()[3])
    void fk(const double q[1], double T[16])
    """
    sympy = _sympy("formulas as C code")
    steps, elements = _steps(sympy, pose, name)
    lines = ["#include <math.h>", "", f"/* Pose of the tip in the base frame, row by row; q: {_listed(pose)}. */"]
    lines += [f"void {name}(const double q[{max(1, len(pose.symbols))}], double T[16])", "{"]
    if not pose.symbols:
        lines.append("    (void)q;")
    if any(value.has(sympy.pi) for value in (*(v for _, v in steps), *elements)):
        lines.append(f"    const double pi = {pi!r};")
    lines += [f"    const double {symbol} = {_c(sympy, value)};" for symbol, value in steps]
    lines += [f"    T[{k}] = {_c(sympy, value)};" for k, value in enumerate(elements)]
    return "\n".join([*lines, "}", ""])


def as_python(pose: SymbolicPose, *, name: str = "forward_kinematics") -> str:
    """A Python function ``name(q)`` that returns the rows of the matrix as lists.

    Parameters
    ----------
    pose : SymbolicPose
    name : str
        Name of the function.

    Returns
    -------
    str
        With common sub-expressions taken out; needs ``math`` alone.

    Raises
    ------
    ArrayError
        ``name`` is no identifier.
    MissingExtraError
        SymPy is not installed.

    Examples
    --------
    >>> from pieper.model.dh import from_dh
    >>> print(as_python(end_effector(from_dh([(0.5, 0.0, 0.0, 0.0)])), name="fk").splitlines()[3])
    def fk(q):
    """
    sympy = _sympy("formulas as Python code")
    steps, elements = _steps(sympy, pose, name)
    lines = ["from math import cos, pi, sin, sqrt", "", "", f"def {name}(q):"]
    lines.append(f'    """Pose of the tip in the base frame, four rows; q: {_listed(pose)}."""')
    lines += [f"    {symbol} = {_python(sympy, value)}" for symbol, value in steps]
    lines.append("    return [")
    lines += [f"        [{', '.join(_python(sympy, v) for v in elements[4 * i : 4 * i + 4])}]," for i in range(4)]
    return "\n".join([*lines, "    ]", ""])


def _steps(sympy: Any, pose: SymbolicPose, name: str) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Common sub-expressions ``t0, t1, ...`` and the sixteen elements, with joints written ``q[i]``."""
    if not _IDENTIFIER.fullmatch(name) or keyword.iskeyword(name):
        raise ArrayError(f"name must be an identifier, got {name!r}")
    joints = {sympy.Symbol(symbol): sympy.Symbol(f"q[{i}]") for i, symbol in enumerate(pose.symbols)}
    elements = [element.xreplace(joints) for element in pose.matrix]
    steps, reduced = sympy.cse(elements, symbols=sympy.numbered_symbols("t"))
    return steps, list(reduced)


def _listed(pose: SymbolicPose) -> str:
    """The joint names, safe inside a comment of either language."""
    return ", ".join(re.sub(r"[^\w .:+-]", "_", name) for name in pose.joint_names) or "none"


def _c(sympy: Any, value: Any) -> str:
    # M_PI and its like are no part of C99
    return str(sympy.ccode(value.xreplace({sympy.pi: sympy.Symbol("pi")}), standard="c99", math_macros={}))


def _python(sympy: Any, value: Any) -> str:
    return str(sympy.pycode(value, fully_qualified_modules=False))


def _sympy(purpose: str) -> Any:
    try:
        import sympy
    except ImportError as cause:
        raise MissingExtraError("SymPy", "symbolic", purpose) from cause
    return sympy


def _yaml(purpose: str) -> Any:
    try:
        import yaml
    except ImportError as cause:
        raise MissingExtraError("PyYAML", "symbolic", purpose) from cause
    return yaml
