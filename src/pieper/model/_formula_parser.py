"""Formulas as text, read without evaluating anything as code."""

from __future__ import annotations

import re
from math import isfinite
from typing import TYPE_CHECKING, Any

from pieper.errors import DescriptionError, unknown_name

if TYPE_CHECKING:
    from collections.abc import Sequence


_MAX_DEPTH = 100  # of nested brackets

_MAX_EXPONENT = 64

RESERVED = frozenset({"sin", "cos", "sqrt", "pi"})

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<sign>\*\*|[-+*/()]))", re.ASCII
)


class FormulaParser:
    """Recursive descent over numbers, + - * / **, brackets, sin, cos, sqrt, pi and the joints."""

    def __init__(self, sympy: Any, text: str, symbols: Sequence[str], source: str, element: str) -> None:
        self.sympy, self.text, self.source, self.element = sympy, text, source, element
        self.symbols = {name: sympy.Symbol(name) for name in symbols}
        self.depth = 0
        self.tokens = self._tokens()
        self.at = 0

    def _fault(self, reason: str, place: int) -> DescriptionError:
        return DescriptionError(self.source, self.element, f"{reason} at character {place + 1} of {self._shown(place)}")

    def _shown(self, place: int) -> str:
        start = max(0, place - 20)
        return repr(
            ("..." if start else "") + self.text[start : place + 20] + ("..." if place + 20 < len(self.text) else "")
        )

    def _tokens(self) -> list[tuple[str, str, int]]:
        tokens, end, text = [], 0, self.text.rstrip()
        while end < len(text):
            match = _TOKEN.match(text, end)
            if match is None:
                place = end + len(text[end:]) - len(text[end:].lstrip())
                raise self._fault(
                    f"{text[place]!r} is not allowed; only numbers, + - * / **, brackets, sin, cos, sqrt, pi and joints are",
                    place,
                )
            kind = str(match.lastgroup)
            tokens.append((kind, match[kind], match.start(kind)))
            end = match.end()
        tokens.append(("end", "the end", len(text)))
        return tokens

    def _peek(self) -> str:
        kind, value, _ = self.tokens[self.at]
        return value if kind == "sign" else kind

    def _take(self) -> tuple[str, str, int]:
        token = self.tokens[self.at]
        self.at += 1
        return token

    def parse(self) -> Any:
        """The expression; anything that is not a formula of real numbers is refused."""
        try:
            value = self._sum()
        except RecursionError:
            raise self._fault("brackets are nested too deep", self.tokens[self.at][2]) from None
        if self._peek() != "end":
            _, token, place = self.tokens[self.at]
            raise self._fault(f"expected an operator, got {token!r}", place)
        if value.has(self.sympy.I, self.sympy.nan, self.sympy.oo, self.sympy.zoo):
            raise self._fault("the value is not a real number", 0)
        return value

    def _sum(self) -> Any:
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise self._fault(f"brackets are nested more than {_MAX_DEPTH} deep", self.tokens[self.at][2])
        terms = [self._product()]
        while self._peek() in ("+", "-"):
            _, sign, _ = self._take()
            term = self._product()
            terms.append(term if sign == "+" else -term)
        self.depth -= 1
        return self.sympy.Add(*terms)

    def _product(self) -> Any:
        factors = [self._signed()]
        while self._peek() in ("*", "/"):
            _, sign, place = self._take()
            factor = self._signed()
            if sign == "/":
                if factor == 0:
                    raise self._fault("division by zero", place)
                factor = self.sympy.Pow(factor, -1)
            factors.append(factor)
        return self.sympy.Mul(*factors)

    def _signed(self) -> Any:
        negative = False
        while self._peek() in ("+", "-"):
            negative ^= self._take()[1] == "-"
        value = self._power()
        return -value if negative else value

    def _power(self) -> Any:
        base = self._atom()
        if self._peek() != "**":
            return base
        _, _, place = self._take()
        negative = False
        while self._peek() in ("+", "-"):
            negative ^= self._take()[1] == "-"
        exponent = self._atom()
        if self._peek() == "**":
            raise self._fault("powers of powers need brackets", self.tokens[self.at][2])
        if not exponent.is_Rational or abs(exponent) > _MAX_EXPONENT or exponent.q > 2:
            raise self._fault(f"the exponent must be a whole or half number up to {_MAX_EXPONENT}", place)
        exponent = -exponent if negative else exponent
        if base == 0 and exponent <= 0:
            raise self._fault("zero to a power that is not positive", place)
        if base.is_number and base.is_Rational and max(abs(base.p), base.q) > 10**40:
            raise self._fault("the number is too large for a power", place)
        return self.sympy.Pow(base, exponent)

    def _atom(self) -> Any:
        kind, token, place = self._take()
        if kind == "number":
            return self._number(token, place)
        if kind == "sign" and token == "(":
            value = self._sum()
            self._close()
            return value
        if kind == "name":
            if self._peek() == "(":
                if token not in ("sin", "cos", "sqrt"):
                    raise self._fault(f"{token!r} is no function here; sin, cos and sqrt are", place)
                self._take()
                value = self._sum()
                self._close()
                return getattr(self.sympy, token)(value)
            if token == "pi":
                return self.sympy.pi
            if token in self.symbols:
                return self.symbols[token]
            if token in RESERVED:
                raise self._fault(f"{token!r} needs brackets", place)
            raise self._fault(str(unknown_name("joint", token, self.symbols)), place)
        raise self._fault(f"expected a number, a joint or a bracket, got {token!r}", place)

    def _close(self) -> None:
        kind, token, place = self._take()
        if kind != "sign" or token != ")":
            raise self._fault(f"expected ')', got {token!r}", place)

    def _number(self, token: str, place: int) -> Any:
        if len(token) > 60 or not isfinite(float(token)):
            raise self._fault("the number is too long or too large", place)
        if token.isdigit():
            return self.sympy.Integer(token)
        return self.sympy.Float(token, 17)
