"""Results as data: what was measured, on what, with which versions and by which method."""

import datetime as dt
import json
import pathlib
import platform
import runpy
import subprocess
from collections.abc import Iterable
from importlib import metadata

HERE = pathlib.Path(__file__).parent
RESULTS = HERE / "results"


def machine() -> dict[str, object]:
    """Processor, its vector instructions, system and Python."""
    model, flags = platform.processor(), ""
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    if cpuinfo.exists():
        fields = dict(
            (part.strip() for part in line.split(":", 1)) for line in cpuinfo.read_text().splitlines() if ":" in line
        )
        model = f"{fields.get('model name', model)} (family {fields.get('cpu family')}, model {fields.get('model')})"
        flags = fields.get("flags", "")
    known = ("sse2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl")
    return {
        "processor": model,
        "vector_instructions": [name for name in known if name in flags.split()],
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def versions(packages: Iterable[str]) -> dict[str, str]:
    """Installed versions, for those of the packages that are there."""
    found = {}
    for name in packages:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            if name == "pieper":
                found[name] = runpy.run_path(str(HERE.parent / "src" / "pieper" / "_version.py"))["__version__"]
    return found


def commit() -> str:
    """The commit of the sources, with ``+`` when what is measured differs from it."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", "-C", str(HERE), *arguments], capture_output=True, text=True).stdout.strip()

    head = git("rev-parse", "--short=12", "HEAD") or "none"
    return head + ("+" if git("status", "--porcelain", "--", "../src", "../native") else "")


def save(question: str, *, method: str, packages: Iterable[str], **figures: object) -> pathlib.Path:
    """Write ``results/<question>.json`` and return its path."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{question}.json"
    data = {
        "question": question,
        "date": dt.datetime.now(dt.timezone.utc).date().isoformat(),
        "commit": commit(),
        "machine": machine(),
        "versions": versions(["pieper", "numpy", *packages]),
        "method": method,
        **figures,
    }
    path.write_text(json.dumps(data, indent=1, default=float) + "\n")
    return path


def load(question: str) -> dict:
    """Read what `save` wrote."""
    return json.loads((RESULTS / f"{question}.json").read_text())


def rounded(value: object, digits: int = 4) -> object:
    """Numbers cut to a few significant digits, in any nesting of lists and dictionaries."""
    if isinstance(value, dict):
        return {key: rounded(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(item, digits) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{digits}g}")
    return value
