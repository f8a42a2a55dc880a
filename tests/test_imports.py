"""What import-linter cannot see for itself."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import pieper

COMPILED = re.compile(r"^\s*(from pieper\._native\.kernels import|import pieper\._native\.kernels)", re.MULTILINE)


def test_the_compiled_module_is_imported_so_that_the_contract_sees_it() -> None:
    # import-linter knows Python files alone: `from pieper._native import kernels` names a room that it knows,
    # `from pieper._native.kernels import ...` does not
    for path in sorted(Path(pieper.__file__).parent.rglob("*.py")):
        assert not COMPILED.search(path.read_text(encoding="utf-8")), (
            f"{path}: write `from pieper._native import kernels`"
        )


@pytest.mark.parametrize(
    "used",
    [
        "import pieper",
        "arm.fk(q)",
        "arm.jacobian(q)",
        "arm.ik(T)",
        "arm.ik(pieper.ik.target.position_and_axis(T[:3, 3], T[:3, 2]), seed=q)",
        "rotation.as_quaternion(T[:3, :3]); rotation.as_rpy(T[:3, :3]); pose.inverse(T)",
    ],
)
def test_what_a_first_answer_takes_imports_no_scipy(used: str) -> None:
    """SciPy takes longer to import than everything else that a first answer needs."""
    code = f"""
import sys
import pytest

import pieper
import pieper.ik.target
from pieper.spatial import pose, rotation
arm = pieper.load("ur5e")
q = [0.1, -1.2, 1.4, -1.7, -1.5, 0.3]
T = arm.fk(q)
{used}
print(*(name for name in sys.modules if name.partition(".")[0] in ("scipy", "cv2", "mujoco", "matplotlib", "typer")))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stdout.split()
