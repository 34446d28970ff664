#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints a header with its plain comments as comments of Doxygen: doxygen_filter.py HEADER

"// …" above a declaration becomes "/// …", behind one "///< …". The first comment describes the file. "\\throws" begins a
paragraph. A declaration of several members becomes one for each, so that each has the comment.
"""

import re
import sys
from pathlib import Path

TRAILING = re.compile(r"""^(?P<code>(?:[^"'/]|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])'|'|/(?!/))+)//\s?(?P<text>.*)$""")


# "  Index first = 0, second;  // comment"
SEVERAL = re.compile(r"^(?P<indent> +)(?P<type>[\w:]+(?:<[^;={}()]*>)?) (?P<names>\w+(?: = [^,;()]+)?(?:, \w+(?: = [^,;()]+)?)+);"
                     r"\s*(?P<rest>(?://.*)?)$")


def safe(text):
    """Text without commands."""
    return re.sub(r"([\\@<>&#$%\"])", r"\\\1", text.replace(r"\throws", "Throws"))


def parted(lines):
    """The lines with each declaration of several members as one declaration for each, so that each gets the comments."""
    above, n = [], 0
    while n < len(lines):
        several = SEVERAL.match(lines[n])
        if several is None:
            above = above + [lines[n]] if lines[n].lstrip().startswith("//") else []
            yield lines[n]
            n += 1
            continue
        column = lines[n].find("//")  # of a comment behind the code, which may go on in the next lines
        end = n + 1
        while column >= 0 and end < len(lines) and lines[end].startswith(" " * column + "//"):
            end += 1
        own = [line for line in above if line.startswith(several["indent"] + "//")]
        for place, name in enumerate(several["names"].split(", ")):
            yield from own if place else []
            yield f"{several['indent']}{several['type']} {name};".ljust(column) + several["rest"]
            yield from lines[n + 1:end]
        above, n = [], end


def opening(lines):
    """The comment that the file begins with."""
    end = next((n for n, line in enumerate(lines) if not line.startswith("//")), len(lines))
    texts = [line[2:].strip() for line in lines[:end]]
    return ["//! \\file", *("" if text.startswith("SPDX") else f"//! {safe(text)}" for text in texts)], lines[end:]


def filtered(lines):
    """The lines of a header for Doxygen."""
    first, rest = opening(lines)
    yield from first
    column, in_list = -1, False  # of a comment behind code, which may go on in the next line
    for line in parted(rest):
        stripped = line.lstrip()
        indent, text = line[:len(line) - len(stripped)], stripped[2:].strip()
        code = TRAILING.match(line)
        if stripped.startswith(("// clang-format", "// NOLINT")):
            yield ""
        elif stripped.startswith("//"):
            in_list = text.startswith("- ") or (in_list and stripped.startswith("//   "))
            formula = stripped.startswith("//   ") and not in_list  # on a line of its own
            column = column if len(indent) == column else -1
            mark = "///<" if column >= 0 else "///"
            before, throws, errors = text.partition("\\throws") if mark == "///" else (text, "", "")
            if formula:
                yield f"{indent}///\n{indent}/// {safe(text)}\n{indent}///"
            elif throws:  # a paragraph of its own
                yield f"{indent}/// {safe(before)}".rstrip() + f"\n{indent}///\n{indent}/// {safe(throws + errors)}"
            else:
                yield f"{indent}{mark} {safe(text)}"
        elif code and not code["text"].startswith("NOLINT") and stripped[0] not in "#}":
            column = len(code["code"])
            yield f"{code['code']}///< {safe(code['text'])}"
        else:
            column = -1
            yield line


if __name__ == "__main__":
    print("\n".join(filtered(Path(sys.argv[1]).read_text(encoding="utf-8").split("\n"))))
