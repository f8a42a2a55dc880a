"""Pieces of the pages that are written from data: tables, times with a unit, where figures come from, and parts of a page between markers."""

from collections.abc import Iterable

Row = list[str]


def table(head: Row, rows: list[Row], *, left: int = 1) -> list[str]:
    """Lines of a Markdown table; all columns but the first few are right-aligned."""
    rule = ["---" if i < left else "---:" for i in range(len(head))]
    return ["| " + " | ".join(line) + " |" for line in (head, rule, *rows)]


def time_text(nanoseconds: float) -> str:
    """Three digits and a unit."""
    for unit, size in (("ns", 1.0), ("µs", 1e3), ("ms", 1e6)):
        if nanoseconds < 999.5 * size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds / 1e9:.3g} s"


def times(ratio: dict) -> str:
    """A ratio with its quartiles."""
    digits = 2 if ratio["median"] < 10 else 1 if ratio["median"] < 100 else 0
    return " ".join(
        f"{text}{ratio[key]:.{digits}f}{end}"
        for text, key, end in (("", "median", ""), ("(", "lower_quartile", " to"), ("", "upper_quartile", ")"))
    )


def commits(data: dict) -> list[str]:
    """The commits that a file of results was measured at; more than one where parts were measured anew."""
    parts = data.get("parts", {}).values()
    return list(dict.fromkeys(part["commit"] for part in parts)) or [data["commit"]]


def origin(data: dict) -> str:
    """One line: when, on what, with what."""
    versions = ", ".join(f"{name} {version}" for name, version in data["versions"].items())
    machine = data["machine"]
    method = data["method"].partition("\n\n")[0].replace("\n", " ").rstrip(".")
    return (
        f"*{data['date']}, commit {', '.join(f'`{commit}`' for commit in commits(data))}, {machine['processor']}, "
        f"Python {machine['python']}; {versions}. {sentence(method)}*"
    )


def sentence(text: str) -> str:
    return text[0].upper() + text[1:] + ("" if text.endswith("?") else ".")


def in_place(page: str, name: str, lines: Iterable[str]) -> str:
    """A page with the part between ``<!-- name: ... -->`` and ``<!-- end of name -->`` replaced."""
    begin, end = page.find(f"<!-- {name}:"), page.find(f"<!-- end of {name} -->")
    if not 0 <= begin < end:
        raise ValueError(f"the page has no part called {name!r} between markers")
    first = page.index("-->", begin) + len("-->")
    return page[:first] + "\n\n" + "\n".join(lines).strip("\n") + "\n\n" + page[end:]
