"""Formulas of the forward kinematics: equal to the numbers, saved and read back without running anything."""

from __future__ import annotations

import ctypes
import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pieper.errors import ArrayError, DescriptionError, MissingExtraError
from pieper.model import symbolic
from pieper.model.dh import from_dh
from tests.model.test_dh import SEEDS, STEPS, random_arm
from tests.reference.product_of_exponentials import fk
from tests.robots import NAMES, chain

sympy = pytest.importorskip("sympy", reason="SymPy is not installed")

SAME_POSE = 1e-12  # [m, -]: what row B7 asks for
SLOW_LITERAL = {"kinova_gen3_7dof"}  # its rounded angles make formulas of half a megabyte


def some_joints(arm, count: int = 5) -> np.ndarray:
    return np.random.default_rng(7).uniform(-3, 3, (count, arm.dof))


def largest_difference(pose, arm) -> float:
    q = some_joints(arm)
    return float(np.abs(pose(q) - [fk(arm, values) for values in q]).max())


@pytest.mark.parametrize("name", NAMES)
def test_formulas_equal_numbers(name):
    arm = chain(name, nominal=True)
    pose = symbolic.end_effector(arm)
    assert pose.joint_names == arm.joint_names
    assert largest_difference(pose, arm) < SAME_POSE


@pytest.mark.parametrize("name", [name for name in NAMES if name not in SLOW_LITERAL])
def test_rounded_angles_stay_rounded(name):
    arm = chain(name)
    assert largest_difference(symbolic.end_effector(arm), arm) < SAME_POSE


def test_row_b7_yaml_has_shape_and_elements_and_equals_numbers(tmp_path):
    """Row B7: keys shape [4, 4] and elements (strings); loaded and evaluated it equals numeric FK to 1e-12."""
    for name in ("yaskawa_mh12", "mh12-report"):
        arm = chain(name)
        path = tmp_path / "T_sym_matrix.yaml"
        symbolic.save(symbolic.end_effector(arm), path)
        data = yaml.safe_load(path.read_text())
        assert data["shape"] == [4, 4]
        assert len(data["elements"]) == 16
        assert all(isinstance(element, str) for element in data["elements"])
        pose = symbolic.load(path)
        assert pose.joint_names == arm.joint_names
        assert largest_difference(pose, arm) < SAME_POSE
        del data["joints"]
        path.write_text(yaml.safe_dump(data))
        assert largest_difference(symbolic.load(path, joint_names=arm.joint_names), arm) < SAME_POSE


def test_row_b7_no_file_and_no_sympy_at_import(tmp_path):
    """Row B7: importing has no side effect."""
    code = "import sys, pieper.model.symbolic; print('sympy' in sys.modules, 'yaml' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.split() == ["False", "False"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["ur5e", "franka_panda", "kuka_youbot", "so101", "kinova_gen3_6dof"])
def test_yaml_round_trip(name):
    pose = symbolic.end_effector(chain(name, nominal=True))
    back = symbolic.from_yaml(symbolic.as_yaml(pose))
    assert (back.joint_names, back.symbols) == (pose.joint_names, pose.symbols)
    assert largest_difference(back, chain(name, nominal=True)) < SAME_POSE
    assert symbolic.from_yaml(symbolic.as_yaml(back)).matrix == back.matrix


def test_nominal_numbers_are_exact():
    x = symbolic.end_effector(chain("yaskawa_mh12", nominal=True)).matrix[0, 3]
    assert not x.atoms(sympy.Float)
    assert sympy.Rational(307, 500) in x.atoms(sympy.Rational)  # 0.614
    tool = symbolic.end_effector(chain("franka_panda", nominal=True)).matrix
    assert not tool.atoms(sympy.Float)  # the hand is turned by -pi/4


def test_a_rounded_quarter_turn_is_not_taken_for_one():
    def arm(alpha):
        return from_dh([(0.0, alpha, 0.0, 0.0), (0.3, 0.0, 0.0, 0.0)], joint_names=["a", "b"])

    assert not symbolic.end_effector(arm(np.pi / 2)).matrix.atoms(sympy.Float)
    for alpha in (1.5708, 1.570796327):
        pose = symbolic.end_effector(arm(alpha))
        assert pose.matrix.atoms(sympy.Float)
        assert largest_difference(pose, arm(alpha)) < 1e-15


def test_turns_about_parallel_axes_are_added_up():
    planar = from_dh([(0.3, 0.0, 0.0, 0.0), (0.2, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0)], joint_names=["a", "b", "c"])
    a, b, c = sympy.symbols("a b c")
    x = symbolic.end_effector(planar).matrix[0, 3]
    assert sympy.expand(x - (3 * sympy.cos(a) + 2 * sympy.cos(a + b) + sympy.cos(a + b + c)) / 10) == 0


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(STEPS, st.booleans()), min_size=0, max_size=4), SEEDS)
def test_any_arm(steps, seed):
    arm = random_arm(steps, seed)
    pose = symbolic.end_effector(arm)
    assert largest_difference(pose, arm) < SAME_POSE
    assert largest_difference(symbolic.from_yaml(symbolic.as_yaml(pose)), arm) < SAME_POSE


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_any_leading_axes(shape):
    pose = symbolic.end_effector(chain("ur5e", nominal=True))
    q = np.random.default_rng(1).uniform(-3, 3, (*shape, 6))
    stack = pose(q)
    assert stack.shape == (*shape, 4, 4)
    for index in np.ndindex(shape):
        np.testing.assert_allclose(stack[index], pose(q[index]), atol=1e-15)
    with pytest.raises(ArrayError, match=r"q must have shape \(..., 6\), got \(5,\)"):
        pose(np.zeros(5))
    with pytest.raises(ArrayError, match="q must be finite, got nan"):
        pose([0.0, float("nan"), 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ArrayError, match="q must be numbers"):
        pose("abc")


def test_coupled_joints_and_awkward_names():
    arm = chain("ur5e", nominal=True)
    names = ("sin", "joint-2", "lambda", "x0", "q[3]")
    coupled = replace(
        arm, joint_names=names, coupling=np.insert(np.eye(5), 3, [0.0, 0.5, -1.0, 0.0, 0.0], axis=0),
        limits=arm.limits[:5], max_velocity=arm.max_velocity[:5], max_effort=arm.max_effort[:5],
    )  # fmt: skip
    pose = symbolic.end_effector(coupled)
    assert pose.symbols == ("q1", "q2", "q3", "q4", "q5")
    assert largest_difference(pose, coupled) < SAME_POSE
    back = symbolic.from_yaml(symbolic.as_yaml(pose))
    assert (back.joint_names, back.symbols) == (names, pose.symbols)
    assert largest_difference(back, coupled) < SAME_POSE
    for text in (symbolic.as_c(pose), symbolic.as_python(pose)):
        assert "*/" not in text.replace("*/", "", 1)


def test_poses_can_be_pickled():
    pose = symbolic.end_effector(chain("ur5e", nominal=True))
    pose(np.zeros(6))
    again = pickle.loads(pickle.dumps(pose))
    assert np.array_equal(again(np.ones(6)), pose(np.ones(6)))
    assert "shoulder_pan_joint" in repr(again)


# --------------------------------------------------------------------------------------------------------------------
# the reader


def yaml_of(element: str, **changes) -> str:
    elements = [element, *("0" for _ in range(15))]
    return yaml.safe_dump({"shape": [4, 4], "elements": elements, "joints": ["a", "b"], **changes})


def value_of(element: str, a: float = 0.3, b: float = -0.7) -> float:
    return float(symbolic.from_yaml(yaml_of(element))([a, b])[0, 0])


@pytest.mark.parametrize(
    "element",
    [
        "1", "-1", "+1", "0.25", ".5", "2.", "1e-3", "1.5E+2", "pi", "a", "a + b", "a - b - 1", "2*a/3", "a/b/2", "a**2",
        "a**-2", "-a**2", "(-a)**2", "2**(1/2)", "sqrt(2)/2*cos(a)", "sin(a + b)*cos(a - b)", "sin( cos(sin(b)) )",
        "-(a + -b)", "- - a", "((((a))))", "3*cos(a)/10 + cos(a + b)/4", "1/(1 + a**2)", "sin(pi/4)*a", "6.123e-17*sin(a)",
    ],
)  # fmt: skip
def test_formulas_are_read_as_python_reads_them(element):
    names = {"a": 0.3, "b": -0.7, "pi": np.pi, "sin": np.sin, "cos": np.cos, "sqrt": np.sqrt}
    assert value_of(element) == pytest.approx(eval(element, {"__builtins__": {}}, names), rel=1e-14)


@pytest.mark.parametrize(
    ("element", "message"),
    [
        ("__import__('os').system('true')", r"<string>: elements\[0\]: \"'\" is not allowed; only numbers"),
        ("open(a)", r"'open' is no function here; sin, cos and sqrt are at character 1"),
        ("exec(a)", "'exec' is no function here"),
        ("a.__class__", r"'\.' is not allowed"),
        ("a[0]", r"'\[' is not allowed"),
        ("lambda: a", "':' is not allowed"),
        ("a; b", "';' is not allowed"),
        ("aa", "no joint 'aa'; did you mean 'a'\\? joints are: a, b"),
        ("sin", "'sin' needs brackets"),
        ("sin a", "'sin' needs brackets"),
        ("sin()", r"expected a number, a joint or a bracket, got '\)'"),
        ("a b", "expected an operator, got 'b' at character 3"),
        ("2a", "expected an operator, got 'a'"),
        ("(a", r"expected '\)', got 'the end'"),
        ("a)", r"expected an operator, got '\)'"),
        ("", "expected a number, a joint or a bracket, got 'the end'"),
        ("a +", "expected a number, a joint or a bracket, got 'the end'"),
        ("1/0", "division by zero"),
        ("1/(a - a)", "division by zero"),
        ("0**-1", "zero to a power that is not positive"),
        ("9**9**9", "powers of powers need brackets"),
        ("9**(9**9)", "the exponent must be a whole or half number up to 64"),
        ("a**b", "the exponent must be a whole or half number"),
        ("((9**64)**64)**64", "the number is too large for a power"),
        ("sqrt(-2)", "the value is not a real number"),
        ("1e999", "the number is too long or too large"),
        ("9" * 100, "the number is too long or too large"),
        ("(" * 5000 + "a" + ")" * 5000, "brackets are nested more than 100 deep"),
        ("sin(" * 99 + "a" + ")" * 98, r"expected '\)'"),
        ("\N{GREEK SMALL LETTER ALPHA}", "is not allowed"),
        ("\N{ARABIC-INDIC DIGIT TWO}", "is not allowed"),
    ],
)
def test_everything_else_is_refused(element, message):
    with pytest.raises(DescriptionError, match=message):
        symbolic.from_yaml(yaml_of(element))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2", "file: is not YAML"),
        ("!!python/object/apply:os.system ['true']", "file: is not YAML: could not determine a constructor"),
        ("- 1", "file: needs the keys shape and elements, got list"),
        ("shape: [4, 4]", "elements: is missing"),
        ("elements: []", "shape: is missing"),
        (yaml_of("a", shape=[3, 3]), r"shape: must be \[4, 4\], got \[3, 3\]"),
        (yaml_of("a", elements=["a"]), "elements: must be a list of 16 strings"),
        (yaml_of("a", elements=[1.0] * 16), "elements: must be a list of 16 strings"),
        (yaml_of("a", joints=None), "joints: is missing; list the joints there, or pass joint_names"),
        (yaml_of("a", joints=["a", "a"]), "joints: must be a list of different names"),
        (yaml_of("a", joints=["a b"]), "joints: 'a b' cannot name a symbol"),
        (yaml_of("a", joints=["pi"]), "joints: 'pi' cannot name a symbol"),
        (yaml_of("a", symbols=["a"]), "symbols: must name 2 joints, got 1"),
        ("[" * 5000, "file: is not YAML"),
        ("#" * (5 << 20), "file: has 5242880 characters; at most 4194304 are read"),
    ],
)
def test_malformed_files_are_named(text, message):
    with pytest.raises(DescriptionError, match=message):
        symbolic.from_yaml(text)


def test_a_bomb_of_aliases_is_only_a_malformed_file():
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 12)]
    for key in ("shape", "joints"):
        text = "\n".join([*levels, *(f"{k}: *a11" for k in ("shape", "joints", "elements"))])
        if key == "joints":
            text = text.replace("shape: *a11", "shape: [4, 4]")
        with pytest.raises(DescriptionError):
            symbolic.from_yaml(text)


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(DescriptionError, match=r"missing.yaml: file: cannot be read"):
        symbolic.load(tmp_path / "missing.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DescriptionError, match="cannot be read"):
        symbolic.load(tmp_path / "binary.yaml")


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="ab01.e+-*/() sincopqrt", max_size=25))
def test_any_text_is_a_formula_or_a_description_error(element):
    try:
        pose = symbolic.from_yaml(yaml_of(element))
    except DescriptionError:
        return
    assert pose.matrix[0, 0].free_symbols <= {sympy.Symbol("a"), sympy.Symbol("b")}


# --------------------------------------------------------------------------------------------------------------------
# LaTeX and code


def test_latex():
    text = symbolic.as_latex(symbolic.end_effector(chain("ur5e", nominal=True)))
    assert text.startswith(r"\begin{bmatrix}")
    assert text.count(r"\\") == 4
    assert "q_{6}" in text
    assert "joint" not in text
    named = symbolic.as_latex(
        symbolic.end_effector(chain("ur5e", nominal=True)), symbols=[rf"\theta_{i}" for i in range(6)]
    )
    assert r"\theta_5" in named
    with pytest.raises(ArrayError, match="symbols must name 6 joints, got 1"):
        symbolic.as_latex(symbolic.end_effector(chain("ur5e", nominal=True)), symbols=["x"])


@pytest.mark.parametrize("name", ["ur5e", "yaskawa_mh12", "franka_panda", "kuka_youbot"])
def test_python_code(name):
    arm = chain(name, nominal=True)
    namespace: dict = {}
    exec(symbolic.as_python(symbolic.end_effector(arm), name="pose"), namespace)
    for q in some_joints(arm):
        assert np.abs(np.array(namespace["pose"](q)) - fk(arm, q)).max() < SAME_POSE


@pytest.mark.skipif(os.name == "nt" or shutil.which("cc") is None, reason="no C compiler named cc")
def test_c_code(tmp_path):
    names = ["ur5e", "yaskawa_mh12", "franka_panda", "kuka_youbot"]
    still = from_dh([(0.1, 0.0, 0.0, 0.0)]).lock(joint_1=0.5)
    source = "\n".join(symbolic.as_c(symbolic.end_effector(chain(n, nominal=True)), name=f"fk_{n}") for n in names)
    source += symbolic.as_c(symbolic.end_effector(still), name="fk_still")
    (tmp_path / "fk.c").write_text(source)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", tmp_path / "fk.so", tmp_path / "fk.c", "-lm"], check=True)
    library = ctypes.CDLL(str(tmp_path / "fk.so"))
    for name, arm in [*((n, chain(n, nominal=True)) for n in names), ("still", still)]:
        for q in some_joints(arm):
            T = (ctypes.c_double * 16)()
            getattr(library, f"fk_{name}")((ctypes.c_double * max(1, arm.dof))(*q), T)
            assert np.abs(np.reshape(T, (4, 4)) - fk(arm, q)).max() < SAME_POSE


@pytest.mark.parametrize("make", [symbolic.as_c, symbolic.as_python])
def test_function_names_are_checked(make):
    pose = symbolic.end_effector(chain("ur5e", nominal=True))
    for bad in ("1x", "a b", "x(", ""):
        with pytest.raises(ArrayError, match="name must be an identifier"):
            make(pose, name=bad)


@pytest.mark.parametrize(("module", "package"), [("sympy", "SymPy"), ("yaml", "PyYAML")])
def test_missing_extra_says_what_to_install(monkeypatch, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{package} is not installed; .* pip install 'pieper\[symbolic\]'"):
        symbolic.from_yaml(yaml_of("a"))
