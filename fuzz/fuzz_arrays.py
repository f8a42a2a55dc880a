"""Coverage-guided fuzzing of the array entry points: joints, outputs, frames, targets, chains.

    python fuzz/fuzz_arrays.py -max_total_time=600 CORPUS_FOLDER

Only `ArrayError` and `UnknownNameError` may come out, results are finite and agree with themselves, and nothing is
written behind the end of an output. A crash of the process is a finding.
"""

from __future__ import annotations

import sys

import atheris
import numpy as np

with atheris.instrument_imports(include=["pieper"]):
    import pieper
    from pieper.errors import ArrayError, UnknownNameError
    from pieper.ik.solve import solve
    from pieper.ik.solver import METHODS
    from pieper.kinematics import jacobian as jacobians
    from pieper.model.chain import Chain

DTYPES = ("f8", "f4", "f2", "i4", "u1", "c16", "?", ">f8", "O", "U3", "M8[s]")
ARMS = [pieper.load(name) for name in ("ur5e", "panda", "youbot", "mh12-report")]
SCISSORS = pieper.Arm(
    Chain(
        name="scissors",
        screws=[[0, 0, 0, 0, 0, 1], [0, -1, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0]],
        home=np.eye(4),
        limits=[[-1, 1], [-1, 1]],
        joint_names=("drive", "slide"),
        coupling=[[1, 0], [-2, 0], [0.5, 1]],
    )
)


def some_array(data: atheris.FuzzedDataProvider, last: int) -> object:
    """An array that is often almost right: its shape, type, layout and values are drawn."""
    kind = data.ConsumeIntInRange(0, 9)
    if kind == 0:
        return data.ConsumeUnicodeNoSurrogates(5)
    if kind == 1:
        return [data.ConsumeFloat() for _ in range(data.ConsumeIntInRange(0, 9))]
    if kind == 2:
        return [[data.ConsumeFloat()] * data.ConsumeIntInRange(0, 8) for _ in range(data.ConsumeIntInRange(0, 3))]
    if kind == 3:
        return None
    shape = [data.ConsumeIntInRange(0, 5) for _ in range(data.ConsumeIntInRange(0, 3))]
    shape.append(last if data.ConsumeIntInRange(0, 4) else data.ConsumeIntInRange(0, 9))
    count = int(np.prod(shape))
    if data.ConsumeBool():
        drawn = [data.ConsumeFloatInRange(-1e3, 1e3) for _ in range(7)]
    else:
        drawn = [data.ConsumeFloat() for _ in range(7)]
    values = np.resize(drawn, count).reshape(shape)
    if kind == 4:
        dtype = DTYPES[data.ConsumeIntInRange(0, len(DTYPES) - 1)]
        with np.errstate(all="ignore"):
            try:
                return values.astype(dtype)
            except (TypeError, ValueError):
                return values
    if kind == 5:
        return np.asfortranarray(values)
    if kind == 6:
        return np.repeat(values, 2, axis=-1)[..., ::2]
    if kind == 7:
        return np.broadcast_to(values, (2, *values.shape))
    if kind == 8:
        return memoryview(np.ascontiguousarray(values))
    return values


def one_input(raw: bytes) -> None:
    """One call of one entry point."""
    data = atheris.FuzzedDataProvider(raw)
    arm = [*ARMS, SCISSORS][data.ConsumeIntInRange(0, len(ARMS))]
    q = some_array(data, arm.dof)
    out = None
    room = None
    if data.ConsumeIntInRange(0, 3) == 0:
        room = np.full(16 * 256 + 8, 7.0)
        size = data.ConsumeIntInRange(0, 200)
        out = room[: 16 * size].reshape(size, 4, 4) if data.ConsumeBool() else some_array(data, 4)
    call = data.ConsumeIntInRange(0, 7)
    try:
        if call == 0:
            T = arm.fk(q, out=out)
            assert np.isfinite(T).all()
            # one configuration and a batch take different kernels: equal to rounding of the lengths and angles
            size = 1.0 + np.abs(np.array(q, dtype=float)).max(initial=0.0)
            assert np.abs(T - arm.fk(np.array(q, dtype=float))).max(initial=0.0) <= 1e-12 * size
        elif call == 1:
            arm.fk(q, up_to=data.ConsumeIntInRange(-2, 9) if data.ConsumeBool() else data.ConsumeUnicodeNoSurrogates(8))
        elif call == 2:
            jacobians.jacobian(arm.chain, q, out=out)
        elif call == 3:
            arm.jacobian_body(q)
        elif call == 4:
            arm.jacobian_rate(q, some_array(data, arm.dof))
        elif call == 5:
            arm.hessian(q)
        elif call == 6:
            target = some_array(data, 4)
            if data.ConsumeBool():  # a pose, moved by whatever was drawn
                target = np.eye(4)
                target[:3, 3] = [data.ConsumeFloatInRange(-2.0, 2.0) for _ in range(3)]
            options = {"restarts": 4}
            if data.ConsumeBool():
                options["redundancy"] = some_array(data, 2)
            if data.ConsumeBool():
                options["count"] = data.ConsumeIntInRange(-1, 3)
            if data.ConsumeBool():
                options["method"] = (*METHODS, "magic")[data.ConsumeIntInRange(0, len(METHODS))]
            if data.ConsumeBool():
                options["samples"] = data.ConsumeIntInRange(-1, 3)
            answers = solve(arm.chain, target, seed=q if data.ConsumeBool() else None, **options)
            assert not np.isnan(answers.q[answers.valid]).any()
            assert (answers.position_error[answers.valid] <= answers.position_tolerance).all()
        else:
            Chain(
                name="fuzzed",
                screws=some_array(data, 6),
                home=some_array(data, 4),
                limits=some_array(data, 2),
                joint_names=tuple(f"j{i}" for i in range(data.ConsumeIntInRange(0, 5))),
                coupling=some_array(data, 3) if data.ConsumeBool() else np.empty(0),
            )
    except (ArrayError, UnknownNameError):
        pass
    if room is not None:
        assert (room[16 * 200 :] == 7.0).all(), "wrote behind the end of out"


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
