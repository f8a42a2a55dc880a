"""What does it cost to have pieper: time to import it, what the command line pulls in, size of the wheel?

Every import runs in a fresh interpreter, candidates in turn; time is processor time of the whole process, and the bare
interpreter is one of the candidates. Python files are compiled before (the first round is thrown away). The wheel is
built from the committed sources alone.

    python benchmarks/import_and_size.py [--rounds 21] [--no-wheel]
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import zipfile

import paired

# isort: split
import results

STATEMENTS = {
    "the interpreter alone": "pass",
    "import numpy": "import numpy",
    "import pieper": "import pieper",
    "import pieper, load an arm, one forward kinematics": "import pieper; pieper.load('ur5e').fk([0.0] * 6)",
    "pieper --help": "import sys; sys.argv = ['pieper', '--help']; from pieper.cli.main import main; main()",
    "pieper robots": "import sys; sys.argv = ['pieper', 'robots']; from pieper.cli.main import main; main()",
}
HEAVY = ("numpy", "scipy", "sympy", "yaml", "matplotlib", "mujoco", "cv2", "viser", "rclpy", "rich")


def process_seconds(statement: str) -> float:
    """Processor seconds of a fresh interpreter with that statement."""
    command = [sys.executable, "-I", "-c", statement]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    error = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stderr.close()
    if process.returncode:
        raise RuntimeError(error.decode())
    return usage.ru_utime + usage.ru_stime


def imported(statement: str) -> list[str]:
    """Those of the heavy packages that the statement imports."""
    report = f"import atexit, sys; atexit.register(lambda: print('\\n', *sys.modules)); {statement}"
    output = subprocess.run([sys.executable, "-I", "-c", report], capture_output=True, text=True, check=True).stdout
    modules = set(output.splitlines()[-1].split())
    return [name for name in HEAVY if name in modules]


def wheel() -> dict[str, object]:
    """Size of the wheel of a clean checkout, and its largest files."""
    with tempfile.TemporaryDirectory(prefix="pieper-bench-") as folder:
        source, out = pathlib.Path(folder, "source"), pathlib.Path(folder, "out")
        source.mkdir()
        archive = subprocess.run(
            ["git", "-C", str(results.HERE.parent), "archive", "HEAD"], capture_output=True, check=True
        )
        subprocess.run(["tar", "-x", "-C", str(source)], input=archive.stdout, check=True)
        build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", str(out), str(source)]
        subprocess.run(build, check=True)
        (path,) = out.glob("*.whl")
        with zipfile.ZipFile(path) as archive:
            members = sorted(archive.infolist(), key=lambda member: -member.compress_size)
        return {
            "file": path.name,
            "bytes": path.stat().st_size,
            "installed_bytes": sum(member.file_size for member in members),
            "largest": {member.filename: member.compress_size for member in members[:5]},
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--no-wheel", action="store_true", help="keep the size that was measured before")
    options = parser.parse_args()
    paired.pin_to_one_core()

    for statement in STATEMENTS.values():
        process_seconds(statement)
    seconds: dict[str, list[float]] = {name: [] for name in STATEMENTS}
    for _ in range(options.rounds):
        for name, statement in STATEMENTS.items():
            seconds[name].append(process_seconds(statement))

    bare, numpy = seconds["the interpreter alone"], seconds["import numpy"]
    rows = [
        {
            "name": name,
            "milliseconds": paired.quartiles([value * 1e3 for value in values]),
            "imports": imported(STATEMENTS[name]),
        }
        for name, values in seconds.items()
    ]
    ratios = {
        f"{name} / import numpy, interpreter {word}": paired.ratio(
            [value - sign * less for value, less in zip(values, bare, strict=True)],
            [value - sign * less for value, less in zip(numpy, bare, strict=True)],
        )
        for name, values in seconds.items()
        if name.startswith("import pieper")
        for word, sign in (("included", 0), ("taken off", 1))
    }
    for row in rows:
        print(f"{row['name']:52} {row['milliseconds']['median']:8.1f} ms   {' '.join(row['imports'])}")
    for name, value in ratios.items():
        print(f"{name:90} {value['median']:6.2f}")
    size = results.load("import_and_size")["wheel"] if options.no_wheel else wheel()
    print(f"{size['file']}: {size['bytes'] / 1e6:.2f} MB, {size['installed_bytes'] / 1e6:.2f} MB installed")
    results.save(
        "import_and_size",
        method=f"fresh interpreters in turn, {options.rounds} rounds, processor time of the process, medians; the wheel "
        "from a clean checkout of the commit",
        packages=["scipy", "typer"],
        rows=results.rounded(rows),
        ratios=results.rounded(ratios),
        wheel=size,
    )


if __name__ == "__main__":
    main()
