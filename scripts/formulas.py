"""Formulas of the book: LaTeX in Markdown becomes MathML, and formulas of comments LaTeX.

Markdown has formulas as code-hosting sites show them: between a dollar with a backtick and a
backtick with a dollar in a line, and in blocks fenced as `math`. They may have Greek letters as
such. MathML is drawn by the browser, without scripts, fonts or other files.

Comments of the sources have plain text, as `F_n = √(δR*) k_n δ`. `latex` translates a formula,
`marked` finds those in sentences.
"""

from __future__ import annotations

import re
from textwrap import fill as fill_lines
from unicodedata import normalize
from xml.etree.ElementTree import Element, tostring

# What converts LaTeX; tests have it by python/pyproject.toml.
PACKAGES = ["latex2mathml>=3.81,<4"]

CODE = re.compile(
    r"(?P<code>^(?P<fence>```+|~~~+).*?^(?P=fence)`*\s*$|(?P<ticks>`+).+?(?P=ticks))", re.M | re.S
)
FORMULA = re.compile(
    r"^(?P<indent> *)```math\n(?P<block>.*?)^ *```$|\$`(?P<inline>[^`\n]+)`\$"
    rf"|{CODE.pattern}|(?P<open>(?<![^\s(])\$`)",
    re.M | re.S,
)
# Sites take a dollar for one only between these.
BEFORE = re.compile(r"(?:^|[\s(\[|*—–])$")
AFTER = re.compile(r"^(?:$|[^\w$])")
# Characters that TeX sets badly, or not at all.
PLAIN = re.compile("[√½¼¾⅓⅔⁰¹²³⁴⁵⁶⁷⁸⁹⁻ᵀ←→≤≥·×…∞Σ±\u0300-\u036f]")
# Names of functions, set upright.
WORDS = ("max", "min", "ln", "exp", "tan", "sin", "cos", "tr")
# What Markdown would read in the text of an element.
MARKS = re.compile(r"[*_`|\\~\[\]]")


class FormulaError(Exception):
    """A formula that is not LaTeX, or not for a code-hosting site."""


def mathml(latex: str, *, block: bool = False) -> str:
    """Converts a formula to an element of MathML, in which Markdown finds nothing to read."""
    from latex2mathml.converter import convert_to_element

    if found := PLAIN.search(latex):
        raise FormulaError(f"write {found[0]} as a command of LaTeX: {latex}")
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", latex):
        depth += 1 if brace == "{" else -1
        if depth < 0:
            break
    if depth:
        raise FormulaError(f"braces do not match: {latex}")
    # `aligned` is what sites know; the package has the same as `align*`.
    given = latex.replace("{aligned}", "{align*}")
    try:
        element = convert_to_element(given, display="block" if block else "inline")
    # The exceptions of the package have no common class.
    except Exception as error:
        raise FormulaError(f"{type(error).__name__}: {latex}") from error
    for part in element.iter():
        # The package passes what it does not know as the name of a symbol.
        text = "".join(re.findall(r"&(?!#x?[0-9A-F]+;)|\\\S*", part.text or ""))
        if text:
            raise FormulaError(f"{text} is not understood: {latex}")
        # The package writes characters as references, `tostring` would escape them again.
        part.text = unescaped(part.text)
    space(element)
    # HTML knows the element without a name space.
    element.attrib.pop("xmlns", None)
    written = tostring(element, encoding="unicode", short_empty_elements=False)
    return re.sub(r">[^<]+<", lambda text: MARKS.sub(lambda c: f"&#{ord(c[0])};", text[0]), written)


def space(parent: Element) -> None:
    """Sets the spaces of TeX, where the package leaves them to the browser.

    Names of functions are upright, with a thin space before and after where it is due.
    """
    before = None
    bars = 0
    for child in parent:
        space(child)
        if child.tag == "mo" and child.text == "|":
            bars += 1
            child.attrib |= {"form": "prefix" if bars % 2 else "postfix", "stretchy": "false"}
        if child.tag == "mo" and child.text == "¯":
            # The macron of most fonts is too short, and does not stretch.
            child.text = "‾"
        if child.tag == "mo" and child.text == "/":
            child.attrib |= {"lspace": "0", "rspace": "0"}
        if child.tag == "mo" and child.text == "−" and is_open(before):
            child.attrib["form"] = "prefix"
        before = child
        # As operators they would be set apart from their brackets.
        if child.tag == "mo" and (child.text or "").isalpha() and (child.text or "").isascii():
            child.tag = "mi"
    children = list(parent)
    for at in reversed(range(len(children))):
        name = children[at]
        if name.tag != "mi" or name.text not in WORDS:
            continue
        if at + 1 < len(children) and children[at + 1].tag != "mo":
            parent.insert(at + 1, Element("mspace", width="0.17em"))
        if at and children[at - 1].tag not in ("mo", "mspace"):
            parent.insert(at, Element("mspace", width="0.17em"))


def is_open(before: Element | None) -> bool:
    """Whether a minus after this is a sign."""
    if before is None or before.tag == "mspace":
        return True
    return before.tag == "mo" and before.text not in (")", "]", "|", "′", "!")


def unescaped(text: str | None) -> str | None:
    """The characters of numeric references."""
    if text is None:
        return None
    return re.sub(r"&#x([0-9A-Fa-f]+);", lambda found: chr(int(found[1], 16)), text)


def typeset(markdown: str) -> str:
    """Replaces the formulas of a page.

    Raises:
        FormulaError: With a line for each formula that does not convert.
    """
    faults = []

    def converted(found: re.Match[str]) -> str:
        latex = found["inline"] or found["block"]
        if found["open"]:
            faults.append(f"a formula without an end: {markdown[found.start() :][:40]!r}")
        if latex is None:
            return found.group()
        try:
            if found["block"] is not None:
                element = mathml(" ".join(latex.split()), block=True)
                return f'{found["indent"]}<div class="formula">{element}</div>'
            line = markdown[: found.start()].rpartition("\n")[2]
            if not BEFORE.search(line) or not AFTER.search(markdown[found.end() :][:1]):
                raise FormulaError(f"no space or bracket beside it: {found.group()}")
            return mathml(latex)
        except FormulaError as error:
            faults.append(str(error))
            return found.group()

    text = FORMULA.sub(converted, markdown)
    if faults:
        raise FormulaError("\n".join(faults))
    return text


ACCENTS = {"\u0302": "hat", "\u0304": "bar", "\u0307": "dot", "\u0308": "ddot"}
SIGNS = {
    "½": r"\tfrac12",
    "←": r"\leftarrow",
    "≤": r"\le",
    "≥": r"\ge",
    "≈": r"\approx",
    "·": r"\cdot",
    "×": r"\times",
    "±": r"\pm",
    "…": r"\dots",
    "∞": r"\infty",
    "Σ": r"\sum",
    "′": "'",
    "⊗": r"\otimes",
}
RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-", strict=True)) | {"ᵀ": r"\mathsf{T}"}
# A symbol with what is beside it: Δx, k_t', F_t^e, m*, δ^(3/2), a².
LETTER = "[A-Za-zℓα-ωΑ-ΡΤ-Ω]\u0302?\u0304?\u0307?\u0308?"
RAISING = r"(?:\^(?:-?\d+|\w|\{[^}]*\}|\([^()]*\)))|[⁰¹²³⁴⁵⁶⁷⁸⁹⁻ᵀ]+"
SYMBOL = (
    rf"(?P<letter>{LETTER})(?:_(?P<below>\{{[^}}]*\}}|\d+|[a-z]+|[A-Z]))?"
    rf"(?P<above>{RAISING})?(?P<after>(?:'|\*(?!\*))*)(?P<above2>{RAISING})?"
)
TOKEN = re.compile(
    r"(?P<label>\((?:BO|LH|FR) [^)]*\))"
    rf"|(?P<word>{'|'.join(WORDS)})(?![a-z])"
    r"|\((?P<over>\d+)/(?P<under>\d+)\)"
    rf"|{SYMBOL}"
    rf"|(?P<close>\))(?:_(?P<close_below>\w))?(?P<close_above>{RAISING})?"
    r"|(?P<number>\d+(?:\.\d+)?)(?:e(?P<power>-?\d+))?"
    r"(?P<number_above>\^-?\d+|[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)?"
    r"|(?P<root>√)|(?P<bar>\|)|(?P<space>\s+)|(?P<sign>.)"
)


def raised(text: str) -> str:
    """The exponent of `^(3/2)`, `^e` or `²`."""
    return "".join(RAISED.get(c, c) for c in text.removeprefix("^").strip("(){}"))


def symbol(found: re.Match[str]) -> str:
    """A symbol with its indices."""
    letter, accents = found["letter"][0], list(found["letter"][1:])
    text = "".join(rf"\{ACCENTS[accent]}{{" for accent in reversed(accents))
    text += letter + "}" * len(accents)
    if found["below"]:
        below = found["below"].strip("{}")
        if len(below) == 1:
            text += f"_{below}"
        else:
            # Two letters are two indices, but for the steady state.
            word = below == "ss" or len(below) > 2
            text += rf"_\mathrm{{{below}}}" if word else f"_{{{below}}}"
    above = "".join(
        [
            raised(found["above"] or ""),
            found["after"].replace("'", r"\prime ").strip(),
            raised(found["above2"] or ""),
        ]
    )
    if above == r"\prime":
        text += "'"
    elif above:
        text += f"^{above}" if len(above) == 1 else f"^{{{above}}}"
    return text


def latex(plain: str) -> str:
    """Translates a formula of a comment, one line."""
    out: list[str] = []
    # Brackets that a root has opened close as braces.
    brackets: list[str] = []
    rooted = False
    open_bar = True
    for found in TOKEN.finditer(normalize("NFD", plain.strip())):
        if found["root"]:
            rooted = True
            continue
        if found["letter"]:
            text = rf"\sqrt{{{symbol(found)}}}" if rooted else symbol(found)
        elif found["close"]:
            text = brackets.pop() if brackets else ")"
            if found["close_below"]:
                text += f"_{found['close_below']}"
            if found["close_above"]:
                text += f"^{{{raised(found['close_above'])}}}"
        elif found["sign"] == "(":
            brackets.append("}" if rooted else ")")
            text = r"\sqrt{" if rooted else "("
        elif found["number"]:
            text = rf"\sqrt{{{found['number']}}}" if rooted else found["number"]
            if found["power"]:
                text = rf"{text}\cdot 10^{{{found['power']}}}".removeprefix(r"1\cdot ")
            if found["number_above"]:
                text += f"^{{{raised(found['number_above'])}}}"
        elif found["label"]:
            text = rf"\text{{{found['label']}}}"
        elif found["word"]:
            word = found["word"]
            text = r"\operatorname{tr}" if word == "tr" else rf"\{word} "
        elif found["over"]:
            text = rf"\tfrac{{{found['over']}}}{{{found['under']}}}"
        elif found["bar"]:
            text = r"\lvert " if open_bar else r"\rvert "
            open_bar = not open_bar
        elif found["space"]:
            text = " " if len(found["space"]) == 1 else r" \qquad "
        else:
            text = SIGNS.get(found["sign"], found["sign"])
            # A space ends a command before a letter.
            text += " " if text[0] == "\\" else ""
        rooted = False
        out.append(text)
    text = re.sub(r" {2,}", " ", "".join(out)).strip()
    return re.sub(rf"(\\(?:{'|'.join(WORDS)}|tfrac12)) (?=[(\\])", r"\1", text)


def block(lines: list[str]) -> str:
    """A fenced block of formulas, aligned at their signs of relation if there are several lines."""
    if len(lines) == 1:
        return f"```math\n{latex(lines[0])}\n```"
    rows = []
    for line in lines:
        cells = [latex(part) for part in re.split(r"\s{2,}", line.strip())]
        rows.append(
            " & ".join(
                re.sub(r"=|\\leftarrow|\\le(?![a-z])|\\ge", r"&\g<0>", c, count=1) for c in cells
            )
        )
    return "```math\n\\begin{aligned}\n" + " \\\\\n".join(rows) + "\n\\end{aligned}\n```"


# Formulas in sentences: symbols, numbers and brackets, and what joins them.
# Two Latin letters are a word, but for these.
BARE = r"(?:(?<![A-Za-z])(?:(?=mR|ft)|(?![A-Za-z]{2}))|(?<=m)(?=R)|(?<=f)(?=t))" + re.sub(
    r"[?]P<\w+>", "?:", SYMBOL
)
NUMBER = rf"(?![23]D\b)\d+(?:\.\d+)?(?:e-?\d+)?(?:{RAISING})?"
ATOMS = rf"(?:(?:{'|'.join(WORDS)})(?=[( ])|½|√|{NUMBER}|{BARE})+"
JOINT = r"(?: ?(?:[-+=<>≤≥≈/←·×⊗]|\d/\d) ?| )"
BARS = rf"\|{ATOMS}\|"
ITEM = rf"(?:{BARS}|{ATOMS})"
# Brackets within brackets, three deep.
for _ in range(3):
    SUM = rf"-?{ITEM}(?:{JOINT}?-?{ITEM})*"
    ITEM = rf"(?:\({SUM}\)(?:_\w)?(?:{RAISING})?|{BARS}|{ATOMS})"
INLINE = re.compile(
    rf"(?!g?D²)(?<![\w`'/^_\]*.])(?<!type )[-±]?{ITEM}(?:{JOINT}?-?{ITEM})*"
    r"(?![\w`'/^_\[%]|[-*]\w|\.\d)"
)
STRONG = re.compile("[|^_√½α-ωΑ-Ωℓ²³\u0302\u0304\u0307\u0308]|[A-Za-z][*^]")
SKIP = re.compile(
    rf"(?P<skip>{CODE.pattern}|\]\([^)]*\)|^#[^\n]*|<[^>]*>)|(?P<inline>{INLINE.pattern})",
    re.M | re.S,
)

# Numbers with a unit, units, letters that are words, and labels of equations.
NO_FORMULA = re.compile(
    rf"{NUMBER} ?(?:[msNJKgb]|m/s|s/m)?|{NUMBER} ?[-·×] ?{NUMBER}"
    r"|\(?[1msNJ/ ]*[/)][1msNJ/ ²)]*|[aAI]|[ABS]\d+"
)


def is_formula(plain: str, after: str) -> bool:
    """Whether symbols and numbers in a sentence are a formula; `after`: what follows them."""
    if STRONG.search(plain):
        return True
    if NO_FORMULA.fullmatch(plain) or not re.search("[A-Za-z]", plain):
        return False
    # Initials of a name.
    return not re.match(r"\.(?: [A-Z]|,)", after) or len(plain) > 1 or plain.islower()


def marked(text: str) -> str:
    """Marks the formulas in sentences of plain text, and translates them."""
    text = normalize("NFD", text)

    def mark(found: re.Match[str]) -> str:
        plain = found["inline"]
        if plain is None:
            return found.group()
        # A word beside a formula is not a part of it.
        before = re.match(r"(?:a|A|I) (?![-+=<≤/])", plain)
        start = before.end() if before else 0
        # Nor is a unit after it.
        end = re.search(r"(?: \(m\))?$", plain).start()  # type: ignore[union-attr]
        rest = plain[start:end]
        if "\n" in rest or not is_formula(rest, text[found.start() + start + len(rest) :]):
            return plain
        line = text[: found.start() + start].rpartition("\n")[2]
        if not (start or BEFORE.search(line)) or not AFTER.search(text[found.end() :][:1]):
            return plain
        return f"{plain[:start]}$`{latex(rest)}`${plain[end:]}"

    return normalize("NFC", SKIP.sub(mark, text))


def wrapped(text: str) -> str:
    """Wraps at 100 columns, but not within formulas, the paragraphs that have longer lines."""

    def fill(paragraph: str) -> str:
        lines = paragraph.split("\n")
        if all(len(line) <= 100 for line in lines) or re.match(r"```|\||#|!\[", lines[0].lstrip()):
            return paragraph
        item = re.match(r"( *)((?:- |\d+\. )?)", paragraph)
        first, mark = item.groups()  # type: ignore[union-attr]
        kept = re.sub(r"\$`[^`\n]+`\$|`[^`\n]+`", lambda f: f[0].replace(" ", "\0"), paragraph)
        filled = fill_lines(
            first + re.sub(r"\s*\n *", " ", kept.strip()),
            100,
            subsequent_indent=first + " " * len(mark),
            break_long_words=False,
            break_on_hyphens=False,
        )
        return filled.replace("\0", " ") + "\n" * paragraph.endswith("\n")

    parts = re.split(r"(\n\n+|\n(?= *- |\d+\. )|^```.*?^```$)", text, flags=re.M | re.S)
    return "".join(part if part.startswith(("\n", "```")) else fill(part) for part in parts)
