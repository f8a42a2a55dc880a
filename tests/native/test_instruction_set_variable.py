"""The environment variable that names an instruction set."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from pieper._native import kernels, use_instruction_set_of
from pieper.errors import UnknownNameError

CODE = "from pieper._native import kernels; print(kernels.instruction_set())"


@pytest.mark.parametrize("name", kernels.instruction_sets())
def test_the_set_that_is_named_is_used(name):
    use_instruction_set_of({"PIEPER_INSTRUCTION_SET": name})
    assert kernels.instruction_set() == name


@pytest.mark.parametrize("environment", [{}, {"PIEPER_INSTRUCTION_SET": ""}])
def test_no_name_changes_nothing(environment):
    kernels.use_instruction_set(kernels.instruction_sets()[0])
    use_instruction_set_of(environment)
    assert kernels.instruction_set() == kernels.instruction_sets()[0]


@pytest.mark.parametrize("name", ["mmx", "AVX2", "avx2 ", "é"])
def test_an_unknown_name_is_refused_with_those_that_there_are(name):
    with pytest.raises(UnknownNameError) as told:
        use_instruction_set_of({"PIEPER_INSTRUCTION_SET": name})
    assert str(told.value) == (
        "PIEPER_INSTRUCTION_SET must name an instruction set that this build and this processor have "
        f"({', '.join(kernels.instruction_sets())}), got {name!r}; unset it to take the widest"
    )


def test_a_process_takes_it_from_its_environment():
    widest, narrowest = kernels.instruction_sets()[-1], kernels.instruction_sets()[0]
    for name, expected in ((narrowest, narrowest), ("", widest)):
        environment = {**os.environ, "PIEPER_INSTRUCTION_SET": name}
        said = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
        assert said.stdout.split() == [expected]


def test_the_command_line_says_it_in_one_sentence():
    environment = {**os.environ, "PIEPER_INSTRUCTION_SET": "mmx"}
    command = [sys.executable, "-m", "pieper", "fk", "mh12", "0", "0", "0", "0", "0", "0"]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert said.returncode == 2
    assert said.stderr.startswith("pieper: PIEPER_INSTRUCTION_SET must name an instruction set")
    assert said.stderr.count("\n") == 1
