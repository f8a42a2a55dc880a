"""The checked-in stub says what the compiled module has."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

import pieper


def test_stub_is_up_to_date() -> None:
    stubgen = pytest.importorskip("nanobind.stubgen", reason="nanobind is not installed")
    generator = stubgen.StubGen(import_module("pieper._native.kernels"))
    generator.put(import_module("pieper._native.kernels"))
    generated = ast.unparse(ast.parse(generator.get()))
    kept = (Path(pieper.__file__).parent / "_native" / "kernels.pyi").read_text(encoding="utf-8")
    assert generated == ast.unparse(ast.parse(kept)), (
        "run: python -m nanobind.stubgen -m pieper._native.kernels -o src/pieper/_native/kernels.pyi"
    )
