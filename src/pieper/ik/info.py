"""How an arm is solved, in words and numbers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class IKInfo:
    """How an arm is solved.

    Attributes
    ----------
    method : str
        ``"closed form"``, ``"general"`` (the polynomial of six joints), ``"redundancy"`` (seven joints, one of them given) or
        ``"numeric"``.
    structure : str
        What was found in the joint axes, in words.
    level : str
        ``"exact"`` or ``"rounded"`` for a closed form, see `pieper.ik.family`; else ``""``.
    deviation : float
        The largest amount by which a relation between the axes is off [rad, or m in units of the size of the arm].
    max_solutions : int
        Isolated answers that one pose can have at most, for one value of the redundancy where there is one; 0 where that is
        not known.
    complete : bool
        True when every isolated answer of a pose is listed.
    self_test : str
        What the method did on poses of the arm itself when it was chosen.
    branch_names : tuple of str
        What the branches are called, as in `IKSolutions.labels`.
    """

    method: str
    structure: str
    level: str
    deviation: float
    max_solutions: int
    complete: bool
    self_test: str
    branch_names: tuple[str, ...]

    def __str__(self) -> str:
        how = {
            "closed form": "in closed form",
            "general": "by its polynomial",
            "redundancy": "for values of one joint",
            "numeric": "by iteration",
        }[self.method]
        every = "every answer is listed" if self.complete else "some answers are found"
        if self.method == "redundancy":
            every = "every answer for each value is listed"
        return f"solved {how}, {every}: {self.structure}" + (f"; {self.self_test}" if self.self_test else "")
