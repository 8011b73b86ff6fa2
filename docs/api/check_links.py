"""Finds links in HTML pages that lead to no file, below the folders given."""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Links(HTMLParser):
    """The targets of a page's links, images and scripts."""

    def __init__(self):
        super().__init__()
        self.targets = []

    def handle_starttag(self, tag, attributes):
        self.targets += [value for name, value in attributes if name in ("href", "src") and value]


def dead_links(folder):
    """How many links the pages of a folder have, and those that lead nowhere."""
    count, dead = 0, []
    for page in sorted(folder.rglob("*.html")):
        links = Links()
        links.feed(page.read_text(encoding="utf-8"))
        for target in links.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc or not parts.path or "$" in parts.path:
                continue
            count += 1
            if not (page.parent / unquote(parts.path)).exists():
                dead.append(f"{page}: {target}")
    return count, dead


def main():
    for folder in map(Path, sys.argv[1:]):
        count, dead = dead_links(folder)
        print(f"{folder}: {count} links, {len(dead)} dead")
        if dead:
            sys.exit("\n".join(dead[:20]))


main()
