"""Names for the branches of a closed form: shoulder front or back, elbow up or down, wrist flipped or not.

The solver tells branches apart by the signs of its square roots. What a sign looks like depends on the arm: on how its axes
point and on which way it faces at rest. So each sign is looked at on some poses of the arm, and named by what is seen there:

- ``front``: the wrist is on the side of axis 1 that the arm faces with its joints in the middle of their ranges;
- ``elbow up``: the elbow is above the line from the shoulder to the wrist, "above" along axis 1;
- ``no flip``: joint 5 is on the positive side of the straight wrist, the one nearer to the middle of its range.

An answer keeps its branch along a path until two branches meet in a singular pose.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.spatial import twist

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.ik.family import Family
    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

_POSES = 48
_FRONT, _ELBOW, _WRIST = 4, 2, 1
_CLEAR = 0.8
"""So much more often [1: always, -1: never] one sign has to look like a name than the other, to be named after it."""


class Branches(NamedTuple):
    """What the eight places of a closed form are called.

    Attributes
    ----------
    names : tuple of 8 str
        By number of the branch; ``""`` for numbers that the arm does not use.
    of_slot : tuple of 8 int
        The number of the branch that each place of `solve_closed_form` holds.
    """

    names: tuple[str, ...]
    of_slot: tuple[int, ...]


def name_branches(chain: Chain, family: Family) -> Branches:
    """Names of the branches of an arm with a closed form.

    Examples
    --------
    >>> from pieper.ik.family import find_family
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("kuka_kr210_robond").chain()
    >>> name_branches(arm, find_family(arm)).names[:2]
    ('front, elbow up, no flip', 'front, elbow up, flip')
    """
    slots = range(8)
    if family.name == "gantry":
        return Branches(("no flip", "flip", *[""] * 6) if chain.dof == 6 else ("only", *[""] * 7), tuple(slots))
    if family.name == "planar":
        names = _lefts_and_rights(chain, family) if family.max_solutions == 2 else ("only", *[""] * 7)
        return Branches(names, tuple(slots))
    if family.quartic:
        has_wrist = family.name == "spherical wrist"
        names = tuple(
            f"root {slot // 2 + 1}, {'flip' if slot % 2 else 'no flip'}" if has_wrist else f"branch {slot + 1}"
            for slot in slots
        )
        return Branches(names, tuple(slots))
    seen = _look(chain, family)
    number, words = [0] * 8, [""] * 8
    for slot in slots:
        back = _is_second(seen.front, slot, _FRONT, 0)
        down = _is_second(seen.up, slot, _ELBOW, slot & _FRONT)
        flipped = _is_second(seen.positive, slot, _WRIST, 0)
        number[slot] = _FRONT * back + _ELBOW * down + _WRIST * flipped
        words[number[slot]] = ", ".join(
            [
                ("back" if back else "front") if not family.reversed else f"forearm {'back' if back else 'front'}",
                f"elbow {'down' if down else 'up'}",
                *([("flip" if flipped else "no flip")] if chain.dof == 6 else []),
            ]
        )
    if chain.dof < 6:
        words = [word if k % 2 == 0 else "" for k, word in enumerate(words)]
    return Branches(tuple(words), tuple(number))


class _Seen(NamedTuple):
    """(poses, 8) what each place of each pose looks like: 1 or -1, 0 where it holds no answer."""

    front: FloatArray
    up: FloatArray
    positive: FloatArray


def _is_second(seen: FloatArray, slot: int, bit: int, given: int) -> int:
    """1 when the answers with this sign mostly look like the second of two names, else 0; with `given` other bits.

    A sign that does not tell is named by its bit.
    """
    others = given & ~bit

    def looks(value: int) -> float:
        places = [s for s in range(8) if s & bit == value and (not others or s & others == others)]
        counts = seen[:, places]
        return float(counts.sum() / max(np.count_nonzero(counts), 1))

    low, high = looks(0), looks(bit)
    first_is_low = low >= high or abs(low - high) < _CLEAR
    return int(bool(slot & bit) == first_is_low)


def _look(chain: Chain, family: Family) -> _Seen:
    """What the answers of some poses look like. An arm that is solved from its tip is looked at from there."""
    rng = np.random.default_rng(1968)
    lower, upper = np.clip(chain.limits, -np.pi, np.pi).T
    q = rng.uniform(lower, upper, (_POSES, chain.dof))
    middle = 0.5 * (lower + upper) + 0.02 * (np.arange(chain.dof) + 1.0)  # off the stretched pose
    answers, valid, *_ = chain.native.solve_closed_form(family.native, chain.native.fk(q), 1e-9, 1e-9, 1)
    every = np.concatenate([np.where(valid[..., None], answers, 0.0).reshape(-1, chain.dof), middle[None]])
    screws = np.asarray(family.screws)
    if family.reversed:  # tip and base change places: exp(-s_n q_n) ... exp(-s_1 q_1)
        screws, every = -screws[::-1], every[:, ::-1]
    moved = np.eye(4)
    T = []  # the motion that carries axis i
    for i in range(chain.dof):
        T.append(np.broadcast_to(moved, (len(every), 4, 4)))
        moved = moved @ twist.exp(screws[i] * every[:, i, None])
    point = [np.cross(s[3:], s[:3]) for s in screws]
    if family.name == "three parallel axes":
        elbow = point[2]
        wrist = point[3] + screws[3, 3:] * ((elbow - point[3]) @ screws[3, 3:])
    else:
        wrist = _meeting(screws[3], screws[4])
        elbow = point[2] + screws[2, 3:] * ((wrist - point[2]) @ screws[2, 3:])
    shoulder = point[1] + screws[1, 3:] * ((elbow - point[1]) @ screws[1, 3:])
    S, E, W = _carry(T[1], shoulder), _carry(T[2], elbow), _carry(T[3], wrist)
    up = screws[0, 3:] * (-1.0 if screws[0, 5] < -1e-6 else 1.0)
    # where the wrist is in the frame of link 1, against where it is in the middle pose
    away = W - point[0]
    across = np.einsum("kji,kj->ki", T[1][:, :3, :3], away - up * (away @ up)[:, None])
    front = across @ across[-1]
    along = (W - S) / np.maximum(np.linalg.norm(W - S, axis=1, keepdims=True), 1e-12)
    bend = E - S
    height = (bend - along * np.sum(bend * along, axis=1, keepdims=True)) @ up
    turned = np.ones(len(every))
    if chain.dof == 6:  # axes 4 and 6 are in line where sine * sin(q5) + cosine * cos(q5) vanishes
        w4, w5, w6 = screws[3:, 3:]
        cosine, sine = w4 @ np.cross(w5, w6), w4 @ np.cross(w5, np.cross(w5, w6))
        straight = np.arctan2(-cosine, sine)
        straight += np.pi * np.round((every[-1, 4] - straight) / np.pi)
        turned = np.sin(every[:, 4] - straight)

    def signs(values: FloatArray) -> FloatArray:
        return np.where(valid, np.sign(values[:-1]).reshape(valid.shape), 0.0)

    return _Seen(signs(front), signs(height), signs(turned))


def _lefts_and_rights(chain: Chain, family: Family) -> tuple[str, ...]:
    """The elbow of an arm in a plane, seen from the tip of its axes."""
    rng = np.random.default_rng(1968)
    q = rng.uniform(-np.pi, np.pi, (_POSES, chain.dof))
    answers, valid, *_ = chain.native.solve_closed_form(family.native, chain.native.fk(q), 1e-9, 1e-9, 1)
    screws = np.asarray(family.screws)
    turning = [i for i in range(chain.dof) if screws[i, 3:].any()]
    second = screws[turning[1]]
    towards = np.cross(second[3:], second[:3]) - np.cross(screws[turning[0], 3:], screws[turning[0], :3])
    onwards = np.cross(screws[turning[2], 3:], screws[turning[2], :3]) - np.cross(second[3:], second[:3])
    straight = np.arctan2(np.cross(onwards, towards) @ second[3:], onwards @ towards)
    first = np.sin(answers[:, 0, turning[1]] - straight)[valid[:, 0]]
    names = ("elbow right", "elbow left")  # the second link turned to the left leaves the elbow on the right
    return (*(names if np.sum(np.sign(first)) >= 0.0 else names[::-1]), *[""] * 6)


def _carry(T: NDArray[np.float64], point: FloatArray) -> FloatArray:
    return np.asarray(T[:, :3, :3] @ point + T[:, :3, 3])


def _meeting(a: FloatArray, b: FloatArray) -> FloatArray:
    """Where two axes meet."""
    points = [np.cross(s[3:], s[:3]) for s in (a, b)]
    across = [np.eye(3) - np.outer(s[3:], s[3:]) for s in (a, b)]
    right = across[0] @ points[0] + across[1] @ points[1]
    return np.asarray(np.linalg.lstsq(across[0] + across[1], right, rcond=1e-12)[0])
