"""What the core is made of, in one word, and how it is compiled.

Imports nothing of the package: ``setup.py`` runs this file to compile the core into a wheel.
"""

import hashlib
from pathlib import Path

SOURCE = Path(__file__).parent / "source"
# No -ffast-math and no contraction into fused operations: the same bits on every machine. No
# -march=native: it gains 6 %, and a cache may be shared by machines.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno")


def fingerprint() -> str:
    """Return a hash of the sources, which the compiled core knows as ``WBC_SOURCE``."""
    content = hashlib.sha256()
    for file in sorted(SOURCE.iterdir()):
        content.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return content.hexdigest()[:32]
