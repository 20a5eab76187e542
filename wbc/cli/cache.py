"""``wbc cache``: the cached collision shapes."""

from __future__ import annotations

from typing import Annotated

import typer


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete all that is kept.")] = False,
) -> None:
    """Say where fitted shapes are kept, and how much; WBC_CACHE names another folder, or off."""
    from wbc.files import CACHE_VARIABLE, cache_folder

    folder = cache_folder()
    if folder is None:
        typer.echo(f"nothing is kept: {CACHE_VARIABLE}=off")
        return
    files = [file for file in folder.glob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    if clear:
        for file in files:
            file.unlink(missing_ok=True)
    done = "deleted" if clear else "kept"
    typer.echo(f"{folder}: {len(files)} files, {size / 1e6:.1f} MB {done}")
