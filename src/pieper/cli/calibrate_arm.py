"""``pieper calibrate-arm``: the screws of an arm as it was built, from where its tip was measured to be."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli.arguments import ArmName, Base, Degrees, Json, Nominal, Tip, about, load, turning
from pieper.cli.outputs import keep_apart
from pieper.cli.record import screw_record
from pieper.cli.show import console, number, plain, print_columns, print_json, print_table
from pieper.errors import ArrayError, PieperError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.kinematics.calibration import Calibration, Check


class Free(str, Enum):
    """What may change."""

    SCREWS = "screws"
    HOME = "home"
    OFFSETS = "offsets"
    BASE = "base"


def calibrate_arm(
    arm: ArmName,
    measurements: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A .csv of: the joints, or q1 ... qn; x y z [m]; for poses also qx qy qz qw.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Write the result; the calibrated arm as .json (screws) or .urdf."
        ),
    ] = None,
    free: Annotated[
        list[Free] | None,
        typer.Option(
            "--free",
            metavar="WHAT",
            help="What may change: screws, home, offsets or base; screws and home by default. May be repeated.",
        ),
    ] = None,
    position_sigma: Annotated[
        float | None, typer.Option("--position-sigma", metavar="M", help="Standard deviation of a position [m].")
    ] = None,
    rotation_sigma: Annotated[
        float | None,
        typer.Option("--rotation-sigma", metavar="RAD", help="Standard deviation of an orientation [rad]."),
    ] = None,
    hold_out: Annotated[
        float, typer.Option("--hold-out", metavar="SHARE", help="Share of the rows that is kept to check the arm with.")
    ] = 0.0,
    keep_all: Annotated[bool, typer.Option("--keep-all", help="Leave no row out, however far it stands out.")] = False,
    add: Annotated[int, typer.Option("--add", metavar="N", help="Also tell N poses that should be measured next.")] = 0,
    degrees: Degrees = False,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Fit the axes of an arm to measured positions or poses of its tip, and say what the measurements can tell.

    For example:
      pieper calibrate-arm ur5e measured.csv --out ur5e-17.json
    """
    import numpy as np

    from pieper.kinematics.calibration import calibrate
    from pieper.kinematics.measurements import read_measurements

    if out is not None and out.suffix.lower() not in (".json", ".urdf"):
        raise PieperError(f"--out must end in .json or .urdf, got {str(out)!r}")
    if not 0.0 <= hold_out < 1.0:
        raise ArrayError(f"--hold-out must be a share from 0 up to 1, got {hold_out:g}")
    if add < 0:
        raise ArrayError(f"--add must be a number of poses, got {add}")
    keep_apart([arm, measurements], {"--out": out})
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    q, measured = read_measurements(measurements, robot.chain)
    if degrees:
        q = np.where(turning(robot), np.radians(q), q)
    kept = _kept(len(q), hold_out)
    sets = ["screws", "home"] if free is None else [name.value for name in free]
    found = calibrate(
        robot.chain,
        q[~kept],
        measured[~kept],
        free=sets,
        position_sigma=position_sigma,
        rotation_sigma=rotation_sigma,
        leave_out=not keep_all,
    )
    check = found.check(q[kept], measured[kept]) if kept.any() else None
    lines = [int(row) for row in np.flatnonzero(~kept)[found.left_out]]
    more = found.poses_to_add(add) if add else np.empty((0, robot.dof))
    if out is not None:
        _write(found, out)
    if as_json:
        print_json(_record(robot, found, check, lines, more))
    else:
        _print(robot, found, check, lines, more)
        if out is not None:
            console().print(f"wrote {out}", markup=False, soft_wrap=True)
    return 0 if found.converged else 1


def _kept(count: int, share: float) -> NDArray[np.bool_]:
    """Rows that are kept out of the fit, evenly over the file."""
    import numpy as np

    number = round(share * count)
    kept = np.zeros(count, dtype=bool)
    kept[np.round((np.arange(number) + 0.5) * count / max(number, 1) - 0.5).astype(int)] = True
    return kept


def _write(found: Calibration, out: Path) -> None:
    import json

    if out.suffix.lower() == ".urdf":
        from pieper.model.urdf import as_urdf

        text = as_urdf(found.chain)
    else:
        text = json.dumps(plain(screw_record(found.chain)), indent=2)
    from pieper.atomic_file import write_bytes

    write_bytes(out, (text.rstrip("\n") + "\n").encode())


def _print(
    robot: Arm, found: Calibration, check: Check | None, lines: Sequence[int], more: NDArray[np.float64]
) -> None:
    import numpy as np

    page = console()
    known = found.identifiability
    page.print(f"{robot.name}  {found.chain.base} -> {robot.tip}\n", style="bold", markup=False)

    def told(value: float, unit: str) -> str:
        return number(1e3 * value if unit == "m" else float(np.degrees(value)), 4)

    rows = [
        [p.of, p.motion, told(change, p.unit), told(sigma, p.unit), "mm" if p.unit == "m" else "deg"]
        for p, change, sigma in zip(known.parameters, found.change, known.sigma, strict=True)
    ]
    print_table(page, ["of", "change", ">by", ">sigma", "unit"], rows)
    page.print()
    used = len(found.residuals) - len(found.left_out)

    def say(words: str, style: str | None = None) -> None:
        page.print(words, style=style, markup=False, soft_wrap=True)

    say(f"measurements  {used} used, {len(found.left_out)} left out" + _rows(lines))
    say(f"left          {1e3 * found.position_rms:.4g} mm root mean square")
    if np.isfinite(found.probability):
        say(
            f"noise         {found.noise:.3g} times what was stated: chi-square {found.chi_square:.4g} for "
            f"{found.degrees_of_freedom} degrees of freedom, probability {found.probability:.2g}"
        )
    if check is not None:
        before, after = 1e3 * check.position_before, 1e3 * check.position_error
        say(
            f"held out      {len(after)} rows: median {np.median(before):.4g} mm, largest {before.max():.4g} mm before; "
            f"{np.median(after):.4g} mm and {after.max():.4g} mm after"
        )
    say(f"seen          {known.rank} of {len(known.parameters)} parameters, condition {known.condition:.3g}")
    for words in known.unseen:
        say(f"not seen      {words}", "yellow")
    if not found.converged:
        say(f"not converged {found.reason}", "red")
    if len(more):
        shown = np.where(turning(robot), np.degrees(more), more)
        page.print()
        columns = [[str(k), *(number(value, 1) for value in row)] for k, row in enumerate(shown.tolist(), start=1)]
        print_columns(page, "pose", list(robot.joint_names), columns, title="measure next, deg or m")


def _rows(lines: Sequence[int]) -> str:
    if not len(lines):
        return ""
    shown = ", ".join(str(int(row) + 1) for row in lines[:8])
    return f": {'row' if len(lines) == 1 else 'rows'} {shown}{' ...' if len(lines) > 8 else ''}"


def _record(
    robot: Arm, found: Calibration, check: Check | None, lines: Sequence[int], more: NDArray[np.float64]
) -> dict[str, Any]:
    known = found.identifiability
    return {
        **about(robot),
        "calibrated": screw_record(found.chain),
        "converged": found.converged,
        "reason": found.reason,
        "parameters": [
            {"kind": p.kind, "of": p.of, "motion": p.motion, "unit": p.unit, "change": change, "sigma": sigma}
            for p, change, sigma in zip(known.parameters, found.change.tolist(), known.sigma.tolist(), strict=True)
        ],
        "rank": known.rank,
        "condition": known.condition,
        "unseen": list(known.unseen),
        "position_rms": found.position_rms,
        "noise": found.noise,
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "probability": found.probability,
        "left_out_rows": [int(row) + 1 for row in lines],
        "T_frame_base": found.T_frame_base,
        "offsets": found.offsets,
        "held_out": None if check is None else check._asdict(),
        "measure_next": more,
    }
