"""Files with a few bytes, words or lines that are other than they were written."""

import random

WORDS = (
    *(b"", b"\x00", b"\xff\xfe", b'"', b"nan", b"1e999", b"-inf", b"1e308", b"-1"),
    *(b",", b";", b"\n", b"\t", b" " * 50, b"x", b"{", b"}", b"#", b"9" * 400),
    *(b"[deg]", b"999999999", b"PK\x03\x04", b"{'descr': '|O'", b"(2, 3)"),
)  # fmt: skip


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Return a file of which one to five places are changed, lost or there twice."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 3, 5))):
        if not data:
            break
        at = rng.randrange(len(data))
        # Headers and directories, with lengths and counts, matter more than many numbers.
        at = rng.choice((at, at % 200, at % 3000, len(data) - 1 - at % 1000)) % len(data)
        match rng.randrange(8):
            case 0:
                data[at] = rng.choice((0, 1, 0xFF, rng.randrange(256)))
            case 1:
                data[at] ^= 1 << rng.randrange(8)
            case 2:
                data[at : at + 2] = rng.randbytes(2)
            case 3:
                del data[at : at + rng.randint(1, 100)]
            case 4:
                data[at:at] = data[at : at + rng.randint(1, 100)]
            case 5:
                word = rng.choice(WORDS)
                data[at : at + rng.choice((0, len(word)))] = word
            case 6:
                lines = data.split(b"\n")
                k = rng.randrange(len(lines))
                lines[k : k + 1] = [lines[k]] * rng.choice((0, 2))
                data = bytearray(b"\n".join(lines))
            case _:
                del data[at:]
    return bytes(data)
