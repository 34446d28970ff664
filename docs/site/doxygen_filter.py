#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints a header with its plain comments as comments of Doxygen: doxygen_filter.py HEADER

"// …" above a declaration becomes "/// …", behind one "///< …". The first comment describes the file.
"""

import re
import sys
from pathlib import Path

TRAILING = re.compile(r"""^(?P<code>(?:[^"'/]|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])'|'|/(?!/))+)//\s?(?P<text>.*)$""")


def safe(text):
    """Text without commands."""
    return re.sub(r"([\\@<>&#$%\"])", r"\\\1", text.replace(r"\throws", "Throws"))


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
    for line in rest:
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
            yield f"{indent}///\n{indent}/// {safe(text)}\n{indent}///" if formula else f"{indent}{mark} {safe(text)}"
        elif code and not code["text"].startswith("NOLINT") and stripped[0] not in "#}":
            column = len(code["code"])
            yield f"{code['code']}///< {safe(code['text'])}"
        else:
            column = -1
            yield line


if __name__ == "__main__":
    print("\n".join(filtered(Path(sys.argv[1]).read_text(encoding="utf-8").split("\n"))))
