"""What import-linter cannot see for itself."""

import re
from pathlib import Path

import pieper

COMPILED = re.compile(r"^\s*(from pieper\._native\.kernels import|import pieper\._native\.kernels)", re.MULTILINE)


def test_the_compiled_module_is_imported_so_that_the_contract_sees_it() -> None:
    # import-linter knows Python files alone: `from pieper._native import kernels` names a room that it knows,
    # `from pieper._native.kernels import ...` does not
    for path in sorted(Path(pieper.__file__).parent.rglob("*.py")):
        assert not COMPILED.search(path.read_text(encoding="utf-8")), (
            f"{path}: write `from pieper._native import kernels`"
        )
