# SPDX-License-Identifier: BSD-3-Clause
"""Checks a built site: every link within it leads somewhere, and no page loads anything from another host."""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src"), ("source", "src"), ("video", "src"),
          ("object", "data")}


class Page(HTMLParser):
    """The names that a page defines, its links, and what it loads."""

    def __init__(self, path):
        super().__init__()
        self.path, self.names, self.links, self.loads = path, set(), [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        for key, value in attributes:
            if key in ("id", "name"):
                self.names.add(value)
            elif value and (tag, key) in LOADED:
                self.loads.append(value)
            elif value and (tag, key) == ("a", "href"):
                self.links.append(value)


def problems(folder):
    """Sentences, one for each problem."""
    pages = {path: Page(path) for path in sorted(Path(folder).rglob("*.html"))
             if "_static" not in path.parts}
    found = []
    for path, page in pages.items():
        name = path.relative_to(folder)
        for link in page.links + page.loads:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loads and parts.scheme != "data":
                    found.append(f"{name} loads {link} from another host.")
                continue
            wanted = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not wanted.is_file():
                found.append(f"{name}: the link {link} leads nowhere.")
            elif parts.fragment and wanted in pages and unquote(parts.fragment) not in pages[wanted].names:
                found.append(f"{name}: {link} names a place that {wanted.name} does not have.")
    for path in sorted(Path(folder).rglob("*.css")):
        for link in re.findall(r"url\(\s*[\"']?(?:https?:)?//[^)]*\)|@import\s+[\"'](?:https?:)?//", path.read_text("utf-8")):
            found.append(f"{path.relative_to(folder)} loads {link} from another host.")
    return found
