# SPDX-License-Identifier: BSD-3-Clause
"""Sentences of the documents are short: `python3 tests/e2e/test_sentences.py [PAGE...]` prints how long, page by page.

Code, formulas, headings and cells of tables without a full stop are no sentences. Inline code, a formula and a link's
text count as they are read: code and formulas as one word, text as its words.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
AVERAGE, LONGEST = 18, 30
ABBREVIATION = re.compile(r"\b(?:e\.g|i\.e|cf|vs|Fig|Eq|No)\.$")


def readable(text):
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"(`+)(?!`).+?\1|\$[^$]+\$", "X", text)
    return re.sub(r"[*_]{1,2}(?=\S)|(?<=\S)[*_]{1,2}", "", text)


def paragraphs(text):
    """Paragraphs, items of lists and cells of tables that are sentences."""
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"^\$\$.*?\$\$[ .,;]*$|^ *(```|~~~).*?^ *\1 *$", "", text, flags=re.MULTILINE | re.DOTALL)
    current = []
    for line in [*text.splitlines(), ""]:
        stripped = "" if line.startswith("    ") else line.strip()
        starts = re.match(r"\s*(?:[-*+]|\d+\.)\s+|\s*>\s?", line)
        if not stripped or starts or stripped.startswith(("#", "|", "<")):
            if current:
                yield " ".join(current)
            current = []
        if stripped.startswith("|"):
            yield from (cell.strip() for cell in re.split(r"(?<!\\)\|", stripped) if re.search(r"\w[.!?]\)?\"?$", cell.strip()))
        elif stripped and not stripped.startswith(("#", "<")):
            current.append(line[starts.end():].strip() if starts else stripped)


def sentences(text):
    for paragraph in paragraphs(text):
        begin = 0
        paragraph = readable(paragraph)
        for end in re.finditer(r"[.!?][)\"”]*(?=\s)|$", paragraph):
            if ABBREVIATION.search(paragraph[:end.end()]):
                continue
            words = [word for word in paragraph[begin:end.end()].split() if re.search(r"\w", word)]
            if words:
                yield words
            begin = end.end()


def pages():
    others = ("CONTRIBUTING.md", "README.md", "SECURITY.md", "fuzz/README.md", "tests/studies/README.md")
    return [*(ROOT / name for name in others), *sorted((ROOT / "docs").rglob("*.md"))]


def statistics(page):
    """The number of sentences, their mean length and the longest ones."""
    found = list(sentences(page.read_text(encoding="utf-8")))
    return len(found), sum(map(len, found)) / max(1, len(found)), sorted(found, key=len, reverse=True)


def test_sentences_are_found():
    text = "# No\n\nOne `a b` two, e.g. $x y$.\nThree four! [Five](no) six\n\n```\nno\n```\n- seven\n\n| no | Eight nine. |\n"
    assert list(map(len, sentences(text))) == [5, 2, 2, 1, 2]


def test_sentences_are_short():
    long = [f"{page.relative_to(ROOT)}: {len(words)} words: {' '.join(words)}"
            for page in pages() for words in statistics(page)[2] if len(words) > LONGEST]
    assert not long, "\n".join(long)
    for page in pages():
        count, mean, _ = statistics(page)
        assert mean < AVERAGE, f"{page.relative_to(ROOT)}: {mean:.1f} words in the mean of {count} sentences"


if __name__ == "__main__":
    print("sentences   mean   longest   over 25   page")
    for shown in map(Path, sys.argv[1:]) if sys.argv[1:] else pages():
        number, average, longest = statistics(shown.resolve())
        over = sum(len(words) > 25 for words in longest)
        print(f"{number:9}   {average:4.1f}   {len(longest[0]) if longest else 0:7}   {over:7}   {shown}")
        if sys.argv[1:]:
            print(*(f"  {len(words)}: {' '.join(words)}" for words in longest if len(words) > 25), sep="\n")
