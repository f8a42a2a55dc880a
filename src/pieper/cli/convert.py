"""``pieper convert``: one description of an arm to another."""

from __future__ import annotations

import json
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pieper.atomic_file import write_text
from pieper.cli.arguments import ArmName, Base, Json, Nominal, Tip, load
from pieper.cli.record import screw_record
from pieper.cli.show import matrix, numbers, plain

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.model.dh import Convention


class Format(str, Enum):
    """What an arm can be written as."""

    DH = "dh"
    MDH = "mdh"
    HAYATI = "hayati"
    SCREWS = "screws"
    URDF = "urdf"
    SYMPY = "sympy"
    LATEX = "latex"
    C = "c"
    PYTHON = "python"


def convert(
    arm: ArmName,
    to: Annotated[
        Format, typer.Option("--to", metavar="FORM", help=f"What to write: {', '.join(form.value for form in Format)}.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the result; instead of printing it.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Write an arm as Denavit-Hartenberg rows, screws, URDF, or formulas.

    For example:
      pieper convert ur5e --to dh
      pieper convert ur5e --to urdf --out arm.urdf
    """
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    text = _json(robot, to) if as_json else _text(robot, to)
    text = text.rstrip("\n") + "\n"
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_text(out, text)
        typer.echo(f"wrote {out}", err=True)
    return 0


_CONVENTIONS: dict[Format, Convention] = {Format.DH: "standard", Format.MDH: "modified", Format.HAYATI: "hayati"}


def _text(robot: Arm, to: Format) -> str:
    chain = robot.chain
    if to in _CONVENTIONS:
        from pieper.model import dh

        return str(dh.as_dh(chain, convention=_CONVENTIONS[to]))
    if to is Format.SCREWS:
        return _screws(robot)
    if to is Format.URDF:
        from pieper.model.urdf import as_urdf

        return as_urdf(chain)
    from pieper.model import symbolic

    T = symbolic.end_effector(chain)
    if to is Format.SYMPY:
        return symbolic.as_yaml(T)
    if to is Format.LATEX:
        return symbolic.as_latex(T)
    return symbolic.as_c(T) if to is Format.C else symbolic.as_python(T)


def _json(robot: Arm, to: Format) -> str:
    if to in _CONVENTIONS:
        from pieper.model import dh

        return json.dumps(dh.as_record(dh.as_dh(robot.chain, convention=_CONVENTIONS[to])), indent=2)
    if to is Format.SCREWS:
        return json.dumps(plain(screw_record(robot.chain)), indent=2)
    return json.dumps({"name": robot.name, "format": to.value, "text": _text(robot, to)}, indent=2)


def _screws(robot: Arm) -> str:
    chain = robot.chain
    lines = [f"{chain.name}, screws in {chain.base} at home, linear part first"]
    lines += [numbers(screw, 9, 13) for screw in chain.screws]
    lines += [f"pose of {chain.tip} at home", matrix(chain.home, 9)]
    return "\n".join(lines)
