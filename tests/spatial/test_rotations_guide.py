"""The sessions in the guide on rotations give what they print."""

import doctest
import re
from pathlib import Path

import numpy as np

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "rotations.md"
SESSION = re.compile(r"^```pycon\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_sessions_of_the_guide_run() -> None:
    text = GUIDE.read_text(encoding="utf-8")
    session = "\n".join(SESSION.findall(text))
    examples = doctest.DocTestParser().get_doctest(session, {}, GUIDE.name, str(GUIDE), 0)
    assert len(examples.examples) > 40
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    report: list[str] = []
    with np.printoptions():
        runner.run(examples, out=report.append)
    assert not runner.failures, "".join(report)
