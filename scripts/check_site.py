"""Check the built documentation: every link inside it leads somewhere, and nothing is fetched from elsewhere to read it.

Run after Sphinx: ``python scripts/check_site.py build/docs``. Pages that were renamed stay in that folder; empty it then.
"""

from __future__ import annotations

import re
import sys
from html import unescape
from pathlib import Path
from urllib.parse import unquote, urlsplit

LINK = re.compile(r'<(\w+)\b[^>]*?\b(?:href|src)="([^"]*)"')
ID = re.compile(r'\bid="([^"]+)"')
OUTSIDE_STYLE = re.compile(r"""(?:url\(\s*['"]?|@import\s+['"])(?:https?:)?//[^)'"]*""")


def faults(site: Path) -> list[str]:
    """Broken links and outside requests, one a line."""
    pages = {page.resolve(): page.read_text(encoding="utf-8") for page in site.rglob("*.html")}
    ids = {page: set(ID.findall(text)) for page, text in pages.items()}
    found = []
    for page, text in pages.items():
        for tag, target in LINK.findall(text):
            url = urlsplit(unescape(target))
            if url.scheme or url.netloc:
                if tag != "a" and url.scheme != "data":
                    found.append(f"{page.relative_to(site)}: <{tag}> is fetched from {target}")
                continue
            to = (page.parent / unquote(url.path)).resolve() if url.path else page
            if not to.exists():
                found.append(f"{page.relative_to(site)}: {target} is not there")
            elif url.fragment and to in ids and unquote(url.fragment) not in ids[to]:
                found.append(f"{page.relative_to(site)}: {target} has no such place")
    for style in site.rglob("*.css"):
        outside = OUTSIDE_STYLE.findall(style.read_text(encoding="utf-8", errors="replace"))
        found += [f"{style.resolve().relative_to(site)}: {match}" for match in outside]
    if not pages:
        found.append(f"{site}: no page is there")
    return found


if __name__ == "__main__":
    wrong = faults(Path(sys.argv[1]).resolve())
    print("\n".join(wrong) or "every link inside leads somewhere, nothing comes from outside")
    sys.exit(bool(wrong))
