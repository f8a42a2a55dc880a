"""The README and every page in docs/ are true.

Blocks of ``python`` run and those of ``pycon`` print what they say, each page in one namespace from top to bottom. A block of ``text`` right after one of ``python``
is what that prints. Console blocks run too: what follows a line ``$ pieper ...``
is what the command prints; ``...`` stands for anything, and ``(exit code 1)`` for its exit code where that is not 0.
Commands in blocks of ``bash`` and ``sh``, and those between backticks in the text, must be ones that the command line takes; a few of them run.
Names of modules, functions and classes between backticks must be there.
"""

import contextlib
import doctest
import io
import json
import pkgutil
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.core import TyperCommand

from pieper import errors
from pieper.cli.main import main

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(python|pycon)\n(.*?)^```$(?:\n\n```text\n(.*?)^```$)?", re.MULTILINE | re.DOTALL)
CONSOLE = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHOWN = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
SHELL = re.compile(r"^```(?:bash|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
PLACEHOLDER = re.compile(r"(?<![\w-])[A-Z][A-Z0-9]*(?![\w.])|\.\.\.")  # `pieper VERB --help`
DOTTED = re.compile(r"pieper(?:\.[A-Za-z_]\w*)+")
NAMED_FILE = re.compile(r"^```yaml\n# (\S+\.yaml)\b.*?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
QUICK = ("docs/guides/planning.md", "docs/guides/pictures.md")  # their commands, but for films, run in a few seconds
# Pages that skip where these cannot be had: packages, or something that draws without a screen.
NEEDED = {
    "docs/guides/pick_and_place.md": ("ompl",),
    "docs/guides/pictures.md": ("OpenGL",),
    "docs/guides/planning.md": ("ompl",),
    "docs/guides/see_and_reach.md": ("OpenGL",),
}
LINK = re.compile(r"\]\((?!https?://|#)([^)#\s]+)[^)]*\)")


def blocks(page: Path) -> list[tuple[int, str, str, str | None]]:
    """Line number, language, text and, where the page shows it, output of each block that Python runs."""
    text = page.read_text(encoding="utf-8")
    return [(text.count("\n", 0, match.start(2)), match[1], match[2], match[3]) for match in BLOCK.finditer(text)]


def commands(page: Path) -> list[tuple[str, str]]:
    """Each command line of the console blocks, and what it is said to print."""
    found = []
    for match in CONSOLE.finditer(page.read_text(encoding="utf-8")):
        for part in re.split(r"^\$ ", match[1], flags=re.MULTILINE)[1:]:
            line, _, output = part.partition("\n")
            found.append((line, output))
    return found


def typed(page: Path) -> list[str]:
    """Each call of pieper in the blocks for a shell, with lines that go on joined."""
    lines = "".join(SHELL.findall(page.read_text(encoding="utf-8"))).replace("\\\n", " ").splitlines()
    return [
        line for line in lines if re.match(r"(?:\S+/)?pieper ", line) and "-completion" not in line
    ]  # changes a home


def mentioned(page: Path) -> list[str]:
    """Each call of pieper between backticks in the text that is written out: without VERB or FILE in it."""
    whole = [span for span in spans(page) if span.startswith("pieper ") and not PLACEHOLDER.search(span)]
    return [span for span in whole if ", " not in span and "-completion" not in span]


def spans(page: Path) -> list[str]:
    """What stands between backticks outside of blocks and headings."""
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    return SPAN.findall(re.sub(r"^#.*$", "", text, flags=re.MULTILINE))


def call(line: str) -> tuple[int, str]:
    """Exit code of a command line, and what it prints on both outputs."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = main(shlex.split(line, comments=True)[1:])
    return code, printed.getvalue()


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.fixture
def page(request: pytest.FixtureRequest) -> Path:
    """A page, where what it needs is there."""
    wanted: Path = request.param
    for package in NEEDED.get(name(wanted), ()):
        if package == "OpenGL":
            request.getfixturevalue("can_draw")
        else:
            pytest.importorskip(package, reason=f"{package} is not installed")
    return wanted


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=name, indirect=True)
def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # what a block writes stays out of the repository
    namespace: dict[str, object] = {"__name__": "__main__"}
    with np.printoptions():  # a page may set its own
        for line, language, code, output in blocks(page):
            run_block(page, line, language, code, output, namespace)


def run_block(
    page: Path, line: int, language: str, code: str, output: str | None, namespace: dict[str, object]
) -> None:
    if language == "python":
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("\n" * line + code, str(page), "exec"), namespace)
        if output is not None:
            same = doctest.OutputChecker().check_output(output, printed.getvalue(), SHOWN)
            assert same, f"{name(page)}, line {line}: the block prints\n{printed.getvalue()}"
        return
    example = doctest.DocTestParser().get_doctest(code, namespace, name(page), str(page), line)
    runner = doctest.DocTestRunner(optionflags=SHOWN | doctest.REPORT_NDIFF)
    said = io.StringIO()
    assert runner.run(example, out=said.write, clear_globs=False).failed == 0, said.getvalue()
    namespace.update(example.globs)


@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=name, indirect=True)
def test_commands_print_what_is_said(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    for line, expected in commands(page):
        assert line.split()[0] == "pieper", f"{line}: only pieper can be run here; put other commands in a bash block"
        code, printed = call(line)
        got = printed + (f"(exit code {code})\n" if code else "")
        assert doctest.OutputChecker().check_output(expected, got, SHOWN), f"$ {line}\n{got}"


@pytest.mark.parametrize("page", [p for p in PAGES if typed(p) or mentioned(p)], ids=name)
def test_commands_are_ones_that_the_command_line_takes(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TyperCommand, "invoke", lambda *_: 0)  # arguments are read, and nothing is done
    for line in typed(page):
        code, said = call(line)
        assert code == 0, f"{line}\n{said}"
    for line in mentioned(page):  # `pieper track` in a sentence goes without its video
        code, said = call(line)
        assert code == 0 or re.search("Missing |requires an argument", said), f"{line}\n{said}"


def test_a_command_with_an_option_that_is_not_there_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TyperCommand, "invoke", lambda *_: 0)
    assert call("pieper ik ur5e 0.4 0.2 0.3 --rpy 180 0 0 --deg") == (0, "")
    code, said = call("pieper ik ur5e 0.4 0.2 0.3 --roll 180")
    assert code == 2
    assert "--roll" in said


@pytest.mark.parametrize("page", [p for p in PAGES if name(p) in QUICK], ids=name, indirect=True)
def test_quick_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for file, text in NAMED_FILE.findall(page.read_text(encoding="utf-8")):
        (tmp_path / file).write_text(text, encoding="utf-8")
    lines = [line for line in typed(page) if not re.search(r"\.(?:mp4|gif)\b", line)]
    assert lines
    for line in lines:
        code, said = call(line)
        assert code == 0, f"{line}\n{said}"


@pytest.mark.parametrize("page", [p for p in PAGES if p.name != "json_output.md"], ids=name)  # its names are fields
def test_names_between_backticks_are_there(page: Path) -> None:
    for span in spans(page):
        if found := DOTTED.match(span):
            pkgutil.resolve_name(found[0])  # ModuleNotFoundError or AttributeError says which is gone


def test_guides_are_listed_by_task_and_lead_to_the_tutorials() -> None:
    folder = ROOT / "docs" / "guides"
    text = {page.name: page.read_text(encoding="utf-8") for page in folder.glob("*.md")}
    for page in text.keys() - {"index.md"}:
        assert f"]({page})" in text["index.md"], f"docs/guides/index.md does not list {page}"
    for tutorial in {*(ROOT / "docs" / "tutorials").glob("*.md")} - {ROOT / "docs" / "tutorials" / "index.md"}:
        assert any(f"../tutorials/{tutorial.name}" in page for page in text.values()), (
            f"no guide links to {tutorial.name}"
        )


def test_every_error_is_on_its_page() -> None:
    page = (ROOT / "docs" / "guides" / "errors.md").read_text(encoding="utf-8")
    for error in vars(errors).values():
        if isinstance(error, type) and issubclass(error, (errors.PieperError, errors.PieperWarning)):
            assert f"`{error.__name__}`" in page


OTHER_PAGES = [ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "examples" / "README.md"]


@pytest.mark.parametrize("page", [*PAGES, *OTHER_PAGES], ids=name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{name(page)} links to {target}, which is not there"


def test_times_told_in_the_mh12_tutorial_are_those_measured() -> None:
    rows = json.loads((ROOT / "benchmarks" / "results" / "report_loop.json").read_text(encoding="utf-8"))["rows"]
    loop, same_rule, *_, solver = (row["nanoseconds"]["median"] for row in rows)
    page = (ROOT / "docs" / "tutorials" / "mh12_by_screws.md").read_text(encoding="utf-8")
    for shown in (f"{loop / 1e9:.1f} s", f"{same_rule / 1e6:.2f} ms", f"{solver / 1e3:.1f} µs"):
        assert f"| {shown} |" in page


def test_broken_links_and_outside_requests_of_a_built_page_are_found(tmp_path: Path) -> None:
    site = tmp_path / "site"
    site.mkdir()
    (site / "good.html").write_text(
        '<a href="#here">a</a> <p id="here"></p> <a href="https://example.org">elsewhere</a>'
    )
    check = [sys.executable, str(ROOT / "scripts" / "check_site.py"), str(site)]
    assert subprocess.run(check, capture_output=True, check=False).returncode == 0
    (site / "bad.html").write_text(
        '<a href="gone.html">a</a> <a href="good.html#there">b</a> <script src="//example.org/x.js"></script>'
    )
    (site / "bad.css").write_text("@import 'https://example.org/font.css'; body { background: url(picture.png) }")
    told = subprocess.run(check, capture_output=True, check=False, text=True)
    assert told.returncode == 1
    assert told.stdout.splitlines() == [
        "bad.html: gone.html is not there",
        "bad.html: good.html#there has no such place",
        "bad.html: <script> is fetched from //example.org/x.js",
        "bad.css: @import 'https://example.org/font.css",
    ]


def test_readme_has_python() -> None:
    assert blocks(ROOT / "README.md")
