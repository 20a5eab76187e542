r"""Names in generated C: in comments, as string literals, as identifiers.

Names of robots, joints, tasks and files may hold anything, and a compiler joins lines that end in a
backslash (C99, 5.1.1.2) and reads trigraphs such as ``??/`` (5.2.1.1) before it looks for comments
and strings. So what is written is plain ASCII of which neither can be made.
"""

from __future__ import annotations

import re

from wbc.codegen.core_parts import CodegenError

# What every compiler of C99 knows (5.2.4.1): characters of a literal, significant ones of a name.
LONGEST_LITERAL = 4095
LONGEST_IDENTIFIER = 63


def comment(text: str) -> str:
    r"""Return text as it may stand in a comment, on one line: ``*\`` and a line's end as ``*\\\n``.

    Marks of comments and trigraphs are set apart by a space.
    """
    plain = text.encode("unicode_escape").decode("ascii")
    plain = plain.replace("*/", "* /").replace("/*", "/ *")
    return re.sub(r"\?(?=\?)", "? ", plain)


def literal(text: str) -> str:
    r"""Return a string literal of the text's bytes in UTF-8, escaped by three octal digits each.

    Hexadecimal escapes would go on into the digits that follow; ``\u`` knows no surrogates and
    nothing below 160 (C99, 6.4.3).
    """
    data = text.encode("utf-8", "surrogatepass")
    if len(data) > LONGEST_LITERAL:
        name = f"{text[:40]!r}..."
        raise CodegenError(f"the name {name} has {len(data)} bytes; C takes {LONGEST_LITERAL}")
    if 0 in data:
        raise CodegenError(f"the name {text!r} has a zero in it, where C ends it")
    plain = set(range(0x20, 0x7F)) - set(b'"\\?')
    kept = (chr(byte) if byte in plain else f"\\{byte:03o}" for byte in data)
    return f'"{"".join(kept)}"'


def identifier(text: str, taken: set[str]) -> str:
    """Return a name in capitals that is none of ``taken``, and add it there.

    What a name in C has not becomes ``_``. It is unique in its first 63 characters: cut, and
    numbered if need be. The text begins with a letter.
    """
    plain = re.sub(r"\W", "_", text, flags=re.ASCII).upper()
    name, number = plain[:LONGEST_IDENTIFIER], 1
    while name in taken:
        number += 1
        tail = f"_{number}"
        name = plain[: LONGEST_IDENTIFIER - len(tail)] + tail
    taken.add(name)
    return name
