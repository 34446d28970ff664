# SPDX-License-Identifier: BSD-3-Clause
"""C++ headers as reStructuredText: what Doxygen reads, in the order of the header, for Sphinx's C++ domain."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
DIRECTIVES = {"class": "class", "struct": "struct", "function": "function", "variable": "member", "typedef": "type",
              "enum": "enum-class"}


def words(element):
    """The text of an element, on one line."""
    return re.sub(r"\s+", " ", "".join(element.itertext())).strip() if element is not None else ""


def described(element):
    """Paragraphs of the brief and the detailed description, with the marks of reStructuredText made plain.

    Names of documents become links.
    """
    blocks = []
    for para in (para for kind in ("briefdescription", "detaileddescription") for para in element.findall(f"{kind}/para")):
        lists = para.findall("itemizedlist")
        for one in lists:
            para.remove(one)
        blocks += [("", words(para))] + [("- ", words(item)) for one in lists for item in one.findall("listitem")]
    plain = [start + re.sub(r"^(?=\(?\w+[.)])|([\\*`|_])", r"\\\1", text) for start, text in blocks if text]
    return [re.sub(r"docs/([\w/-]+)\.md", linked, text) for text in plain]


def linked(name):
    """A link to a document, if it is there."""
    return f":doc:`/{name[1]}`" if (DOCS / f"{name[1]}.md").exists() else name[0]


def line_of(element):
    return int(element.find("location").get("line"))


def template(element):
    parameters = element.find("templateparamlist")
    if parameters is None:
        return ""
    given = [" ".join(filter(None, (words(p.find("type")), words(p.find("declname"))))) for p in parameters.findall("param")]
    return f"template<{', '.join(given)}> "


def signature(member):
    """The declaration, in the words of Sphinx's C++ domain."""
    kind, name = member.get("kind"), words(member.find("name"))
    start = template(member) + "static " * (member.get("static") == "yes" and kind == "function")
    if kind == "typedef":
        return f"{start}{name} = {words(member.find('type'))}"
    if kind == "enum":
        return name
    text = f"{words(member.find('type'))} {name}{words(member.find('argsstring'))}".strip()
    initial = words(member.find("initializer")).lstrip("= ")
    if kind == "variable" and 0 < len(initial) <= 30 and "[" not in initial:
        text += f" = {initial}"
    return start + text.removesuffix("= {}").strip()


def shown(member):
    """Whether a member is for users: public, and no copy, move or destructor."""
    name, arguments = words(member.find("name")), words(member.find("argsstring"))
    return (member.get("prot") == "public" and member.get("kind") in DIRECTIVES and not name.startswith("~")
            and name != "operator=" and not re.search(r"=\s*(default|delete)$", arguments)
            and not (member.get("kind") == "function" and arguments.endswith("&& other) noexcept")))


def is_function(element, name):
    return element.get("kind") == "function" and words(element.find("name")) == name


class Headers:
    """The XML that Doxygen wrote into a folder."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.files = {}
        for path in sorted(self.folder.glob("*_8hpp.xml")):
            compound = self.compound(path.stem)
            self.files[words(compound.find("compoundname")).removesuffix(".hpp")] = compound
        # Doxygen lists what a namespace declares with the namespace.
        self.free = [member for path in sorted(self.folder.glob("namespace*.xml"))
                     for member in self.compound(path.stem).findall("sectiondef/memberdef") if shown(member)]

    def compound(self, name):
        return ElementTree.parse(self.folder / f"{name}.xml").getroot().find("compounddef")

    def entries(self, compound):
        """Line, and classes and members of a file or a class."""
        for inner in compound.findall("innerclass"):
            if inner.get("prot") == "public":
                found = self.compound(inner.get("refid"))
                owner = words(found.find("compoundname")).rsplit("::", 1)[0]
                if compound.get("kind") != "file" or not any(owner == words(c) for c in compound.findall("innerclass")):
                    yield line_of(found), found
        if compound.get("kind") == "file":
            here = compound.find("location").get("file")
            members = [member for member in self.free if member.find("location").get("file") == here]
        else:
            members = [member for member in compound.findall("sectiondef/memberdef") if shown(member)]
        for member in members:
            yield line_of(member), member

    def rendered(self, element, indent):
        space = "   " * indent
        if element.tag == "compounddef":
            name = words(element.find("compoundname")).rsplit("::", 1)[-1]
            bases = ", ".join(f"public {words(base).removeprefix('tokid::')}" for base in element.findall("basecompoundref")
                              if base.get("prot") == "public")
            title = f"{template(element)}{name}{f' : {bases}' if bases else ''}"
            parts = [f"{space}.. cpp:{DIRECTIVES[element.get('kind')]}:: {title}", ""]
            inner = [part for _, entry in sorted(self.entries(element), key=lambda pair: pair[0])
                     for part in self.rendered(entry, indent + 1)]
        else:
            parts = [f"{space}.. cpp:{DIRECTIVES[element.get('kind')]}:: {signature(element)}", ""]
            inner = []
            for value in element.findall("enumvalue"):
                inner += [f"{space}   .. cpp:enumerator:: {words(value.find('name'))}", ""]
                inner += [line for text in described(value) for line in (f"{space}      {text}", "")]
        parts += [line for text in described(element) for line in (f"{space}   {text}", "")]
        return parts + inner

    def page(self, name):
        """What a header declares."""
        compound = self.files[name]
        parts = [line for text in described(compound) for line in (text, "")]
        # The function that the header is named after comes first, before the types of its arguments and result.
        for _, entry in sorted(self.entries(compound), key=lambda pair: (not is_function(pair[1], name), pair[0])):
            parts += self.rendered(entry, 0)
        return "\n".join(parts)
