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


def filtered(lines):
    opening, last_trails, column, in_list = True, False, -1, False
    for line in lines:
        stripped = line.lstrip()
        if opening and not stripped.startswith("//"):
            opening = False
        if stripped.startswith("// clang-format") or stripped.startswith("// NOLINT"):
            yield ""
        elif stripped.startswith("//"):
            text = stripped[2:].lstrip(" ")
            if opening:
                yield "" if text.startswith("SPDX") else f"//! {'' if last_trails else chr(92) + 'file' + chr(10) + '//! '}{safe(text)}"
                last_trails = True
                continue
            indent = line[:len(line) - len(stripped)]
            in_list = text.startswith("- ") or (in_list and stripped.startswith("//   "))
            if stripped.startswith("//   ") and not in_list:  # a formula on a line of its own
                yield f"{indent}///\n{indent}/// {safe(text)}\n{indent}///"
                last_trails = False
                continue
            # A comment behind code that goes on in the next line stands in the same column.
            yield f"{indent}///{'<' if last_trails and len(indent) == column else ''} {safe(text)}"
            last_trails = last_trails and len(indent) == column
        else:
            found = TRAILING.match(line)
            if found and not found["text"].startswith("NOLINT") and stripped[0] not in "#}":
                yield f"{found['code']}///< {safe(found['text'])}"
                last_trails, column = True, len(found["code"])
            else:
                yield line
                last_trails, column = False, -1


if __name__ == "__main__":
    print("\n".join(filtered(Path(sys.argv[1]).read_text(encoding="utf-8").split("\n"))))
