"""The compiled kernels and their checked-in stub (``kernels.pyi``).

The widest instruction set that the processor has is in use from the start; the environment variable
``PIEPER_INSTRUCTION_SET`` names another, to compare or to get round a fault.
"""

from __future__ import annotations

import os

from pieper._native import kernels
from pieper.errors import UnknownNameError

INSTRUCTION_SET = "PIEPER_INSTRUCTION_SET"


def use_instruction_set_of(environment: dict[str, str]) -> None:
    """Use the instruction set that the environment names; an empty name stands for none.

    Raises
    ------
    UnknownNameError
        This build or this processor has no set of that name; the message lists those it has.

    Examples
    --------
    >>> use_instruction_set_of({"PIEPER_INSTRUCTION_SET": "mmx"})
    Traceback (most recent call last):
    pieper.errors.UnknownNameError: PIEPER_INSTRUCTION_SET must name an instruction set that this build and this processor have (...), got 'mmx'; unset it to take the widest
    """
    wanted = environment.get(INSTRUCTION_SET, "")
    if not wanted:
        return
    known = kernels.instruction_sets()
    if wanted not in known:
        raise UnknownNameError(
            f"{INSTRUCTION_SET} must name an instruction set that this build and this processor have ({', '.join(known)}), "
            f"got {wanted!r}; unset it to take the widest"
        )
    kernels.use_instruction_set(wanted)


use_instruction_set_of(dict(os.environ))
